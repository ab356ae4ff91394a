"""The library of effects: all modules of the package are loaded, and their effects register."""

from importlib import import_module
from pkgutil import iter_modules

from imuloop.model.effect import Effect

# order of the effects in results; an effect that is not named here comes last
_ORDER = """anisoinertia asymmetry bias_drift bias_temperature bias_temperature_rate cross_coupling
    cubic vibration_rectification earth_rate g2_sensitivity g_sensitivity
    gyro_axis_delay lever_arm product quadratic ramp rate_sensitivity reorientation scale_asymmetry
    scale_nonlinearity scale_temperature steps thermal_hysteresis time_offset turn_on_bias
    warm_up""".split()

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
Effect.library = {name: Effect.library[name] for name in _ORDER} | Effect.library
