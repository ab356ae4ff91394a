"""A device whose biases and scale factors follow the temperature, and its samples."""

from dataclasses import replace

import numpy as np

from export.devices import device, g_sensitivity, samples
from imuloop.core.effect import Channels, FittedEffect
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.effects.scale_temperature import ScaleTemperature

# degC, of the data
COLD, WARM = -5.0, 45.0
SENSORS = ("accelerometer", "gyroscope")


def fitted(effect, sizes, seed=3):
    """Return an effect with parameters of these sizes, three a size."""
    values = np.random.default_rng(seed).uniform(0.5, 1, 3 * len(sizes)) * np.repeat(sizes, 3)
    values[1::3] *= -1
    names = effect.parameters
    return FittedEffect(effect, dict(zip(names, map(float, values), strict=True)), {})


def warm_device(label="Board A", accelerometer=None, gyroscope=None):
    """Return the device of `device` with effects of the temperature on both sensors."""
    cubic, square = BiasTemperature(3, 18.0), BiasTemperature(2, 21.0)
    if accelerometer is None:
        accelerometer = (fitted(cubic, (5e-3, 2e-4, 4e-6)), fitted(ScaleTemperature(18.0), (2e-4,)))
    if gyroscope is None:
        gyroscope = (fitted(square, (4e-4, 6e-6)), g_sensitivity())
    board = device(label, gyroscope)
    sensor = replace(board.calibration.accelerometer, effects=accelerometer)
    board = replace(board, calibration=replace(board.calibration, accelerometer=sensor))
    return replace(board, temperature_range=(COLD, WARM))


def narrow_device(board=None, accelerometer=(10.0, 30.0), gyroscope=(10.0, 30.0)):
    """Return a device, mostly the warm one, its effects seen at these temperatures, in 0.5 g."""
    board, n = board or warm_device(), 200
    f = 4.9 * np.sin(np.linspace(0, 6, n)[:, None] + np.arange(3))
    for name, ends in zip(SENSORS, (accelerometer, gyroscope), strict=True):
        seen = [Channels(np.zeros(n), f, f, np.linspace(*ends, n))]
        sensor = board.sensor(name)
        held = replace(sensor, effects=tuple(e.held_to(seen) for e in sensor.effects))
        board = replace(board, calibration=replace(board.calibration, **{name: held}))
    return board


def warm_samples(cold=COLD, warm=WARM):
    """Return samples at temperatures across those of the data, held between `cold` and `warm`."""
    table = samples()
    table["temperature"] = np.clip(np.linspace(COLD, WARM, len(table)), cold, warm)
    return table


def carried(board, effects, aligned):
    """Return the calibration of a device with only these effects, and T where `aligned`."""
    bare = board.calibration
    for name in SENSORS:
        sensor = board.sensor(name)
        kept = tuple(e for e in sensor.effects if e.name in effects)
        T = sensor.T if aligned else np.eye(3)
        bare = replace(bare, **{name: replace(sensor, T=T, effects=kept)})
    return bare
