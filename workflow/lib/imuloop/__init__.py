"""From the raw log of an accelerometer and gyroscope to calibration, noise and diagnosis."""

from importlib import import_module

_LAZY = {"Calibration": "imuloop.core.model"}


def __getattr__(name):
    # by name, so that a script that needs no calibration neither loads nor depends on the model
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'imuloop' has no attribute '{name}'")
