"""Increments of velocity and angle become rates by the interval that they are really of."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core.samples import CHANNELS
from imuloop.core.units import DEGREE
from ingest.logs import FORCE, RATE

SIX = [*CHANNELS]
DELTA = [f"dv{axis}" for axis in "xyz"] + [f"dtheta_{axis}" for axis in "xyz"]
# a sensor whose intervals vary by a tenth, whole us
TICKS = np.random.default_rng(3).integers(9_500, 10_500, 500)
INTO = "increments of acceleration (m/s) and angular_rate (rad) divided by their interval: "


@pytest.fixture
def rates(log):
    return log[SIX].to_numpy()


@pytest.fixture
def ingested(run):
    """Ingest increments over some seconds, and other columns."""

    def call(values, seconds, drop=(), names=DELTA, **columns):
        declared = {key: columns.pop(key) for key in {*columns} & {"units", "columns"}}
        table = pd.DataFrame(values * np.reshape(seconds, (-1, 1)), columns=names).assign(**columns)
        done = run(table.drop(index=[*drop]), **declared)
        assert done.quality["status"] == "ok", done.quality["reasons"]
        return done

    return call


def test_increments_are_of_the_steps_of_the_stamps(rates, ingested):
    done = ingested(rates, TICKS * 1e-6, time_us=10**9 + np.cumsum(TICKS))
    np.testing.assert_allclose(done.samples[SIX], rates[1:], rtol=1e-14)
    np.testing.assert_allclose(done.samples.t, (np.cumsum(TICKS)[1:] - sum(TICKS[:2])) * 1e-6)
    names = [done.metadata["raw_units"][q]["name"] for q in ("acceleration", "angular_rate")]
    assert names == ["m/s^2", "rad/s"]
    assert done.metadata["units"] == {"time": "us", "acceleration": "m/s", "angular_rate": "rad"}
    figures = done.quality["increments"]
    assert (figures["without_interval"], figures["by_usual_step"]) == (1, 0)
    assert figures["usual_step_s"] == pytest.approx(np.median(TICKS[2:]) * 1e-6, rel=1e-12)
    line, jitter = done.quality["warnings"][:2]
    how = "step of the stamps that ends at the row; 1 at the start has none and is dropped"
    assert line == f"{INTO}{how}"
    assert f"jitter by {TICKS[2:].std() / TICKS[2:].mean():.1%} of a step" in jitter


@pytest.mark.parametrize("name", ["dt_us", "delta_t [us]", "interval"])
def test_increments_are_of_the_logged_interval(rates, ingested, name):
    units = {} if "us" in name else {"units": {"interval": "us"}}
    # stamps of a host, which say nothing of the intervals
    stamps = np.cumsum(TICKS) + np.random.default_rng(5).integers(-1000, 1000, 500)
    done = ingested(rates, TICKS * 1e-6, time_us=stamps, **{name: TICKS}, **units)
    np.testing.assert_allclose(done.samples[SIX], rates, rtol=1e-14)
    assert done.quality["columns"]["interval"] == [name]
    assert done.quality["warnings"][0] == f"{INTO}logged"


def test_each_sensor_may_have_an_interval_of_its_own(rates, ingested):
    # as ulog2csv writes a vehicle_imu
    names = [f"delta_{each}[{i}]" for each in ("velocity", "angle") for i in range(3)]
    other = np.repeat([TICKS, TICKS + 37], 3, axis=0).T
    more = {"timestamp": np.cumsum(TICKS), "names": names}
    more |= {"delta_velocity_dt": other[:, 0], "delta_angle_dt": other[:, 5]}
    interval = {"acceleration": "delta_velocity_dt", "angular_rate": "delta_angle_dt"}
    units = {"time": "us", "interval": "us"}
    for columns in ({}, {"columns": {"interval": interval}}):
        done = ingested(rates * other * 1e-6, 1, units=units, **columns, **more)
        np.testing.assert_allclose(done.samples[SIX], rates, rtol=1e-13)
        assert done.quality["columns"]["interval"] == ["delta_velocity_dt", "delta_angle_dt"]
    # by the stamps where that is declared
    none = {"units": {"time": "us"}, "columns": {"interval": None}}
    assert len(ingested(rates * other * 1e-6, 1, **none, **more).samples) == 499


def test_faults_of_other_rows_do_not_reach_an_increment(rates, ingested):
    # lost rows: the interval of the next is that of the sensor
    lost = [*range(100, 150), 300]
    done = ingested(rates, 0.01, time_us=10_000 * np.arange(500), drop=lost)
    np.testing.assert_allclose(done.samples[SIX], np.delete(rates, [0, *lost], 0), rtol=1e-13)
    assert (done.quality["gaps"]["count"], done.quality["increments"]["by_usual_step"]) == (2, 2)
    line = "2 after gaps are of one interval too, the usual step 0.01 s"
    assert line in str(done.quality["warnings"])
    # a roll-over, a missing value, a repeated and a late stamp, and a clock that starts again
    stamps = (2**32 - 1_000_000 + 10_000 * np.arange(500)) % 2**32
    stamps[40], stamps[[60, 61]] = stamps[39], stamps[[61, 60]]
    stamps[380:] -= stamps[380]
    values = rates.copy()
    values[20, 1] = np.nan
    done = ingested(values, 0.01, time_us=stamps)
    np.testing.assert_allclose(done.samples[SIX], np.delete(rates, [0, 20, 40, 61], 0), rtol=1e-12)
    counts = [done.quality[key] for key in ("non_finite", "duplicates", "out_of_order")]
    clock = done.quality["clock"]
    assert [*counts, clock["rollovers"], clock["resets"]] == [1, 1, 1, 1, 1]


def test_increments_of_stamps_in_bursts_are_of_the_step_of_the_line(rates, ingested):
    late = np.repeat(np.random.default_rng(6).gamma(2, 0.001, 100), 5)
    t = 0.05 * (np.arange(500) // 5) + late + 0.002 * (np.arange(500) % 5)
    done = ingested(rates, 0.01, t=t)
    step = done.samples.t[499] / 499
    assert done.quality["clock"]["rebuilt"] and step == pytest.approx(0.01, rel=5e-3)
    np.testing.assert_allclose(done.samples[SIX], rates * (0.01 / step), rtol=1e-12)
    assert done.quality["increments"]["interval"] == "step of the rows, rebuilt"


def test_increments_of_packets_are_of_the_step_of_the_sensor(rates, ingested):
    """Protects increments whose usual step is that of packets, of which each holds a part."""
    # a sensor that pauses, so that the stamps stay but for those within a packet
    t = 0.05 * (np.arange(500) // 5) + 3.0 * (np.arange(500) >= 250)
    done = ingested(rates, 0.01, t=t)
    assert done.quality["increments"]["usual_step_s"] == pytest.approx(0.01)
    np.testing.assert_allclose(done.samples[SIX], rates[1:], rtol=1e-9)


def test_columns_of_any_name_are_increments_where_their_unit_says_so(log, run):
    units = {"acceleration": "mm/s", "angular_rate": "deg"}
    done = run(log.assign(**log[FORCE] * 10, **log[RATE] * 0.01 / DEGREE), units=units)
    np.testing.assert_allclose(done.samples[SIX], log[SIX].iloc[1:], rtol=1e-9)
