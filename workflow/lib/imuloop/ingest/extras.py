"""Libraries of formats that few need: imported when such a log is read."""

from importlib import import_module

from imuloop.core.errors import ImuloopError


def needed(module, extra):
    """Return a library's module.

    Parameters
    ----------
    module : str
        Name of the module.
    extra : str
        Name of the project's extra that brings it.

    Raises
    ------
    ImuloopError
        If it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImuloopError(
            f"this format needs the package {package}, which is not installed: "
            f"pip install '.[{extra}]'"
        ) from error
