"""Calibration from attitudes at rest.

The package can be called: ``imuloop.calibrate(...)`` calls `imuloop.calibrate_logs.calibrate`.
"""

import inspect
import sys
from importlib import import_module
from types import ModuleType


class _CallableModule(ModuleType):
    """The package as a function, with the call, signature and help of `calibrate`."""

    @property
    def _function(self):
        """The function `imuloop.calibrate_logs.calibrate`."""
        # imported late and by name, so that a stage does not depend on all others
        return import_module("imuloop.calibrate_logs").calibrate

    def __call__(self, *logs, **options):
        return self._function(*logs, **options)

    __signature__ = property(lambda self: inspect.signature(self._function))
    __doc__ = property(
        lambda self: f"calibrate{self.__signature__}\n\n{inspect.getdoc(self._function)}"
    )


sys.modules[__name__].__class__ = _CallableModule
