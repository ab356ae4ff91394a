"""A calibration applied to a file gives the same as applied to the samples in it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, filled
from imuloop.core.units import RawUnit
from imuloop.model.apply_file import apply_file
from imuloop.model.calibration import Calibration
from imuloop.model.effect import Channels, Effect, FittedEffect
from imuloop.model.sensor_calibration import SensorCalibration

N = 4001
DESIGNED = [
    name
    for name, cls in Effect.library.items()
    # one of power cycles is zero in a log
    if "design" in vars(cls) and "power_cycle" not in cls.needs
]


def draw_effect(name, kind):
    settings = {"steps": {"times": (20.0,)}}
    settings["product"] = {"formula": "θ f_x w_y", "axis": "z", "sensor": kind}
    effect = Effect.library[name](**settings.get(name, {}))
    rng = np.random.default_rng(len(name))
    return FittedEffect(effect, dict.fromkeys(effect.parameters, 1e-3 * rng.uniform(1, 2)), {})


def calibration(names):
    def sensor(kind, unit, scale):
        effects = tuple(draw_effect(n, kind) for n in names if kind in Effect.library[n].sensors)
        T = np.eye(3) + 0.01 * np.triu(np.ones((3, 3)), 1)
        return SensorCalibration(
            RawUnit(unit, 1.0), T, np.full(3, scale), np.array([0.1, -0.2, 0.3]), effects=effects
        )

    return Calibration(
        "d", 9.8, sensor("accelerometer", "m/s^2", 1.01), sensor("gyroscope", "rad/s", 0.99)
    )


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log with turns, vibration, uneven steps, a gap, and a thermometer that is slower."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.008, 0.012, N)) - 0.01
    t[2500:] += 3.0
    angle = 0.3 * t
    f = 9.8 * np.column_stack([np.sin(angle), np.cos(angle), np.zeros(N)])
    table = pd.DataFrame({"t": t - t[0]})
    table[["ax", "ay", "az"]] = f + rng.normal(0, 0.3, (N, 3))
    table[["gx", "gy", "gz"]] = rng.normal(0, 0.2, (N, 3))
    warm = 20 + 15 * np.sin(t / 7)
    warm[np.arange(N) % 40 != 20] = np.nan
    warm[1000:1900] = np.nan
    table["temperature"] = warm
    table["marker"] = np.arange(N) % 7
    path = tmp_path_factory.mktemp("pieces") / "samples.parquet"
    table.to_parquet(path, index=False)
    return path


def with_late_thermometer():
    device = calibration(["bias_temperature"])
    effects = [replace(e, effect=replace(e.effect, lag=20.0)) for e in device.accelerometer.effects]
    return replace(device, accelerometer=replace(device.accelerometer, effects=tuple(effects)))


def with_delays(seconds):
    """Samples of another time; no range holds them: a knock beyond the range seen is as late."""
    device = calibration([])
    for sensor, name, values in (
        ("accelerometer", "time_offset", {"dt": seconds}),
        ("gyroscope", "gyro_axis_delay", {"dtx": seconds, "dty": -seconds / 2}),
    ):
        ranges = dict.fromkeys(values, (-1e-9, 1e-9))
        one = replace(FittedEffect(Effect.library[name](), values, {}), ranges=ranges)
        device = replace(device, **{sensor: replace(getattr(device, sensor), effects=(one,))})
    return device


# a calibration, another that it differs from, and by how much at least
WITHOUT = calibration([])
CASES = {
    "all effects": (calibration(DESIGNED), WITHOUT, 1e-6),
    "a late thermometer": (with_late_thermometer(), calibration(["bias_temperature"]), 1e-3),
    "9 ms late": (with_delays(9e-3), WITHOUT, 0.1),
    "100 ms early": (with_delays(-0.1), WITHOUT, 0.1),
}


@pytest.mark.parametrize("case", CASES)
def test_a_file_gives_what_its_samples_give(log, tmp_path, case):
    (device, other, least), table = CASES[case], pd.read_parquet(log)
    apply_file(device, log, tmp_path / "out.parquet")
    applied, expected = pd.read_parquet(tmp_path / "out.parquet"), device.apply(table)
    assert list(applied) == list(expected)
    axes = [*ACCELERATION, *ANGULAR_RATE]
    assert np.abs(expected[axes] - other.apply(table)[axes]).to_numpy().max() > least
    np.testing.assert_allclose(applied, expected, rtol=0, atol=1e-9 if least == 0.1 else 1e-12)


def test_samples_that_are_held_are_counted(log, tmp_path):
    device = calibration(["bias_temperature", "bias_drift"])
    table = pd.read_parquet(log)
    first = Channels(
        table["t"][:1000].to_numpy(),
        *(table[list(c)][:1000].to_numpy() for c in (ACCELERATION, ANGULAR_RATE)),
        np.linspace(20.0, 30.0, 1000),
    )
    sensor = device.gyroscope
    sensor = replace(sensor, effects=tuple(e.with_ranges([first]) for e in sensor.effects))
    counts = apply_file(replace(device, gyroscope=sensor), log, tmp_path / "out.parquet")
    assert set(counts) == {("gyroscope", "bias_temperature"), ("gyroscope", "bias_drift")}
    assert counts["gyroscope", "bias_drift"] == np.sum(table["t"] > table["t"][999])
    warmth = filled(table["t"].to_numpy(), table["temperature"].to_numpy())
    reference = Effect.library["bias_temperature"]().reference_temperature
    outside = (warmth < 20) | (warmth > 30)
    assert counts["gyroscope", "bias_temperature"] == np.sum(outside & (warmth != reference))


def test_an_empty_log_stays_empty(log, tmp_path):
    pq.write_table(pq.read_table(log).slice(0, 0), tmp_path / "empty.parquet")
    calibration(["warm_up"]).apply_file(tmp_path / "empty.parquet", tmp_path / "out.parquet")
    assert len(pd.read_parquet(tmp_path / "out.parquet")) == 0


def test_what_cannot_be_applied_is_refused(log, tmp_path):
    """A log that was calibrated before, tests/test_apply.py has; no whole file, tests/core."""
    device = calibration([])
    with pytest.raises(ImuloopError, match=r"\.csv or \.parquet"):
        device.apply_file(log, tmp_path / "out.txt")
    pq.write_table(pa.table({"t": [0.0], "ax": [1.0]}), tmp_path / "few.parquet")
    with pytest.raises(ImuloopError, match=r"few\.parquet: no column ay, az, gx, gy, gz"):
        device.apply_file(tmp_path / "few.parquet", tmp_path / "out.parquet")
