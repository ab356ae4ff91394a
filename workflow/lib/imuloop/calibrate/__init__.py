"""Calibration from attitudes at rest: the package, and as a call ``imuloop.calibrate(...)``."""

import sys
from importlib import import_module
from types import ModuleType


class _Call(ModuleType):
    def __call__(self, *logs, **how):
        """Calibrate and diagnose one device; see `imuloop.result.calibrate`."""
        # by name, so that a stage does not depend on all others
        return import_module("imuloop.result").calibrate(*logs, **how)


sys.modules[__name__].__class__ = _Call
