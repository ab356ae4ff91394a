"""Calibration from attitudes at rest: the package, and as a call ``imuloop.calibrate(...)``."""

import inspect
import sys
from importlib import import_module
from types import ModuleType


def _function():
    # by name, so that a stage does not depend on all others
    return import_module("imuloop.calibrate_logs").calibrate


class _Call(ModuleType):
    """The package, which is called and documented as `calibrate_logs.calibrate`."""

    def __call__(self, *logs, **how):
        return _function()(*logs, **how)

    @property
    def __signature__(self):
        return inspect.signature(_function())

    @property
    def __doc__(self):
        function = _function()
        return f"{function.__name__}{self.__signature__}\n\n{inspect.getdoc(function)}"


sys.modules[__name__].__class__ = _Call
