"""Libraries of formats that few need: imported when such a log is read."""

from importlib import import_module

from imuloop.core.errors import ImuloopError


def needed(module, extra):
    """Return a library's module by its name; the error says which extra of the project brings it.

    Raises
    ------
    ImuloopError
        If it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise ImuloopError(
            f"this format needs the package {module.partition('.')[0]}, which is not installed: "
            f"pip install '.[{extra}]'"
        ) from error
