"""Calibration from attitudes at rest.

The package can be called: ``imuloop.calibrate(...)`` calls `imuloop.calibrate_logs.calibrate`.
"""

import inspect
import sys
from importlib import import_module
from types import ModuleType


def _load_function():
    # imported late and by name, so that a stage does not depend on all others
    return import_module("imuloop.calibrate_logs").calibrate


class _CallableModule(ModuleType):
    """The package as a function: its call, signature and help are those of `calibrate`."""

    def __call__(self, *logs, **how):
        return _load_function()(*logs, **how)

    @property
    def __signature__(self):
        return inspect.signature(_load_function())

    @property
    def __doc__(self):
        function = _load_function()
        return f"{function.__name__}{self.__signature__}\n\n{inspect.getdoc(function)}"


sys.modules[__name__].__class__ = _CallableModule
