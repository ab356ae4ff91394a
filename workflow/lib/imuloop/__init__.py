"""From the raw log of an accelerometer and gyroscope to calibration, noise and diagnosis."""

from importlib import import_module


def __getattr__(name):
    # by name, so that a script that needs no calibration neither loads nor depends on the model
    if name == "Calibration":
        # a calibration may hold any effect of the library
        import_module("imuloop.effects")
        return import_module("imuloop.core.model").Calibration
    raise AttributeError(f"module 'imuloop' has no attribute '{name}'")
