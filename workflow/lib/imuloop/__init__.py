"""From the raw log of an accelerometer and gyroscope to calibration, noise and diagnosis.

``imuloop.calibrate(t, acceleration, angular_rate)`` does it all for one device. What cannot be used
raises an ``imuloop.ImuloopError``; what should be looked at is an ``imuloop.ImuloopWarning``.
"""

import sys
from importlib import import_module

__version__ = "0.2.0"
# where each name is
_PLACES = {
    "Calibration": "model.calibration",
    "ImuloopError": "core.errors",
    "ImuloopWarning": "core.errors",
    "Result": "result",
    "allan": "noise.allan",
    "calibrate": "calibrate",
    "load": "result",
    "plot": "plot",
    "read": "calibrate_logs",
}
__all__ = [*_PLACES]


def __getattr__(name):
    # by name, so that a script that needs no calibration neither loads nor depends on the model
    if name not in _PLACES:
        of = sys.modules[__name__]
        raise AttributeError(f"module 'imuloop' has no attribute '{name}'", name=name, obj=of)
    # a calibration may hold any effect of the library
    import_module("imuloop.effects")
    module = import_module(f"imuloop.{_PLACES[name]}")
    # the stage of that name is called
    return module if name in ("calibrate", "plot") else getattr(module, name)


def __dir__():
    return sorted([*globals(), *__all__])
