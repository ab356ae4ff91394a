"""From the raw log of an accelerometer and gyroscope to calibration, noise and diagnosis.

``imuloop.calibrate(t, acceleration, angular_rate)`` does all of this for one device. Input that
cannot be used raises an ``imuloop.ImuloopError``; a fact that the user should look at is shown as
an ``imuloop.ImuloopWarning``.
"""

import sys
from importlib import import_module

__version__ = "0.2.0"
# module of each public name
_PLACES = {
    "Calibration": "model.calibration",
    "ImuloopError": "core.errors",
    "ImuloopWarning": "core.errors",
    "Result": "result",
    "allan": "noise.allan",
    "calibrate": "calibrate",
    "load": "result",
    "read": "calibrate_logs",
}
__all__ = [*_PLACES]


def __getattr__(name):
    """Return the public object called `name`, and import its module if this is the first use.

    So a script that needs no calibration does not load the model. Raises an AttributeError for a
    name that is not public.
    """
    if name not in _PLACES:
        of = sys.modules[__name__]
        raise AttributeError(f"module 'imuloop' has no attribute '{name}'", name=name, obj=of)
    # a calibration may hold any effect of the library
    import_module("imuloop.effects")
    module = import_module(f"imuloop.{_PLACES[name]}")
    # the package is callable itself
    return module if name == "calibrate" else getattr(module, name)


def __dir__():
    """Return all names of the module, including public names that are not imported yet."""
    return sorted([*globals(), *__all__])
