"""Increments of velocity and angle become rates by the interval that they are really of."""

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS
from imuloop.ingest.columns import resolve
from imuloop.ingest.streams import Stream, raw_log

FORCE, RATE = list(CHANNELS[:3]), list(CHANNELS[3:])
DELTA = [f"dv{axis}" for axis in "xyz"] + [f"dtheta_{axis}" for axis in "xyz"]
# a sensor whose intervals vary by a tenth, whole us
TICKS = np.random.default_rng(3).integers(9_500, 10_500, 500)


@pytest.fixture
def summed(log):
    """Increments over `TICKS`, stamps at the end of each in us; the rates are those of `log`."""
    table = log.rename(columns=dict(zip(CHANNELS, DELTA, strict=True)))
    table[DELTA] *= TICKS[:, None] * 1e-6
    return table.rename(columns={"t": "time_us"}).assign(time_us=10**9 + np.cumsum(TICKS))


@pytest.fixture
def ingested(run, tmp_path):
    """Ingest a table as CSV, the same in small batches."""

    def call(table, **declared):
        path = tmp_path / "log.csv"
        table.to_csv(path, index=False, float_format="%.17g")
        done = run(path, **declared)
        whole = done.path.read_bytes(), done.quality
        small = run(path, batch_rows=7, **declared)
        assert (small.path.read_bytes(), small.quality) == whole
        assert done.quality["status"] == "ok", done.quality["reasons"]
        return done

    return call


def rates(log, rows=slice(None)):
    return log[list(CHANNELS)].to_numpy()[rows]


def test_by_the_steps_of_the_stamps(log, summed, ingested):
    done = ingested(summed)
    np.testing.assert_allclose(done.samples[list(CHANNELS)], rates(log, slice(1, None)), rtol=1e-14)
    np.testing.assert_allclose(done.samples.t, (np.cumsum(TICKS)[1:] - sum(TICKS[:2])) * 1e-6)
    assert done.metadata["raw_units"]["acceleration"]["name"] == "m/s^2"
    assert done.metadata["raw_units"]["angular_rate"]["name"] == "rad/s"
    assert done.metadata["units"] == {"time": "us", "acceleration": "m/s", "angular_rate": "rad"}
    figures = done.quality["increments"]
    assert (figures["without_interval"], figures["by_usual_step"]) == (1, 0)
    assert figures["usual_step_s"] == pytest.approx(np.median(TICKS[2:]) * 1e-6, rel=1e-12)
    line, jitter = done.quality["warnings"][:2]
    assert line == (
        "increments of acceleration (m/s) and angular_rate (rad) divided by their interval: step "
        "of the stamps that ends at the row; 1 at the start has none and is dropped"
    )
    share = TICKS[2:].std() / TICKS[2:].mean()
    assert f"jitter by {share:.1%} of a step" in jitter


@pytest.mark.parametrize("name", ["dt_us", "delta_t [us]", "interval"])
def test_by_the_logged_interval(log, summed, ingested, name):
    summed[name] = TICKS
    units = {} if "us" in name else {"units": {"interval": "us"}}
    # stamps of a host, which say nothing of the intervals
    summed["time_us"] += np.random.default_rng(5).integers(-1000, 1000, 500)
    done = ingested(summed, **units)
    np.testing.assert_allclose(done.samples[list(CHANNELS)], rates(log), rtol=1e-14)
    assert done.quality["columns"]["interval"] == [name]
    assert done.quality["warnings"][:1] == [
        "increments of acceleration (m/s) and angular_rate (rad) divided by their interval: logged"
    ]


def test_each_sensor_with_an_interval_of_its_own(log, run, tmp_path):
    # as ulog2csv writes a vehicle_imu
    other = TICKS + 37
    table = {"timestamp": np.cumsum(TICKS), "delta_angle_dt": other, "delta_velocity_dt": TICKS}
    for i, (force, rate) in enumerate(zip(FORCE, RATE, strict=True)):
        table[f"delta_velocity[{i}]"] = log[force] * TICKS * 1e-6
        table[f"delta_angle[{i}]"] = log[rate] * other * 1e-6
    log.assign(**table)[list(table)].to_csv(tmp_path / "log.csv", index=False)
    units = {"units": {"time": "us", "interval": "us"}}
    found = run(tmp_path / "log.csv", **units)
    np.testing.assert_allclose(found.samples[list(CHANNELS)], rates(log), rtol=1e-13)
    assert found.quality["columns"]["interval"] == ["delta_velocity_dt", "delta_angle_dt"]
    interval = {"acceleration": "delta_velocity_dt", "angular_rate": "delta_angle_dt"}
    declared = run(tmp_path / "log.csv", columns={"interval": interval}, **units)
    assert declared.path.read_bytes() == found.path.read_bytes()
    # by the stamps where that is declared
    none = run(tmp_path / "log.csv", columns={"interval": None}, units={"time": "us"})
    assert len(none.samples) == 499


def test_an_interval_after_lost_rows_is_that_of_the_sensor(log, summed, ingested):
    summed["time_us"] = 10_000 * np.arange(500)
    summed[DELTA] = rates(log) * 0.01
    lost = [*range(100, 150), 300]
    done = ingested(summed.drop(lost))
    rows = np.delete(np.arange(1, 500), np.array(lost) - 1)
    np.testing.assert_allclose(done.samples[list(CHANNELS)], rates(log, rows), rtol=1e-13)
    assert done.quality["gaps"]["count"] == 2
    assert done.quality["increments"]["by_usual_step"] == 2
    assert "2 after gaps are of one interval too, the usual step 0.01 s" in str(
        done.quality["warnings"]
    )


def test_faulty_rows_do_not_reach_their_neighbours(log, summed, ingested):
    summed["time_us"] = 2**32 - 1_000_000 + 10_000 * np.arange(500)
    summed["time_us"] %= 2**32
    summed[DELTA] = rates(log) * 0.01
    summed.loc[20, "dvy"] = np.nan
    summed.loc[40, "time_us"] = summed.time_us[39]
    summed.loc[[60, 61], "time_us"] = summed.time_us[[61, 60]].to_numpy()
    # starts again
    summed.loc[380:, "time_us"] -= summed.time_us[380]
    done = ingested(summed)
    rows = np.delete(np.arange(1, 500), [19, 39, 60])
    np.testing.assert_allclose(done.samples[list(CHANNELS)], rates(log, rows), rtol=1e-12)
    counts = [done.quality[key] for key in ("non_finite", "duplicates", "out_of_order")]
    assert counts == [1, 1, 1]
    assert (done.quality["clock"]["rollovers"], done.quality["clock"]["resets"]) == (1, 1)


def test_of_stamps_in_bursts_the_step_of_the_line(log, summed, ingested):
    late = np.repeat(np.random.default_rng(6).gamma(2, 0.001, 100), 5)
    table = summed.drop(columns="time_us")
    table[DELTA] = rates(log) / 100
    table["t"] = 0.05 * (np.arange(500) // 5) + late + 0.002 * (np.arange(500) % 5)
    done = ingested(table)
    assert done.quality["clock"]["rebuilt"]
    step = done.samples.t[499] / 499
    assert step == pytest.approx(0.01, rel=5e-3)
    expected = rates(log) * (0.01 / step)
    np.testing.assert_allclose(done.samples[list(CHANNELS)], expected, rtol=1e-12)
    assert done.quality["increments"]["interval"] == "step of the rows, rebuilt"


@pytest.mark.parametrize(
    ("force", "rate", "scales"),
    [("m/s", "deg", (1, np.pi / 180)), ("mm/s", "mrad", (1e-3, 1e-3)), ("m/s", "rad", (1, 1))],
)
def test_declared_units_of_columns_of_any_name(log, run, tmp_path, force, rate, scales):
    table = log.copy()
    table[FORCE] *= 0.01 / scales[0]
    table[RATE] *= 0.01 / scales[1]
    table.to_csv(tmp_path / "log.csv", index=False)
    units = {"acceleration": force, "angular_rate": rate}
    done = run(tmp_path / "log.csv", units=units)
    np.testing.assert_allclose(done.samples[list(CHANNELS)], rates(log, slice(1, None)), rtol=1e-9)
    # one of the two alone
    table[RATE] = log[RATE]
    table.to_csv(tmp_path / "log.csv", index=False)
    done = run(tmp_path / "log.csv", units={"acceleration": force})
    np.testing.assert_allclose(done.samples[list(CHANNELS)], rates(log, slice(1, None)), rtol=1e-9)


@pytest.mark.parametrize(
    "names",
    [
        "dvx dvy dvz dax day daz",
        "imu.delta_velocity.x imu.delta_velocity.y imu.delta_velocity.z imu.delta_angle.x"
        " imu.delta_angle.y imu.delta_angle.z",
        "deltaVelX deltaVelY deltaVelZ deltaAngX deltaAngY deltaAngZ",
        "delta_velocity[0] delta_velocity[1] delta_velocity[2] dang[0] dang[1] dang[2]",
    ],
)
def test_usual_names(names):
    found = resolve(["t", *names.split()])
    assert (found.acceleration, found.angular_rate) == ((1, 2, 3), (4, 5, 6))
    assert found.units == {"acceleration": "m/s", "angular_rate": "rad"}
    assert found.increments == {"acceleration", "angular_rate"}
    stated = [f"{name} [deg]" for name in names.split()[3:]]
    if "[" not in names:
        assert resolve(["t", *names.split()[:3], *stated]).units["angular_rate"] == "deg"


def test_who_logs_the_rate_too_has_it_from_there():
    names = "t ax ay az gx gy gz dvx dvy dvz dax day daz dt".split()
    found = resolve(names)
    assert (found.acceleration, found.angular_rate) == ((1, 2, 3), (4, 5, 6))
    assert (found.units, found.others) == ({}, {})
    chosen = resolve(names, {"acceleration": ["dvx", "dvy", "dvz"]})
    assert chosen.units == {"acceleration": "m/s"}
    assert chosen.others == {"interval.acceleration": 13, "interval.angular_rate": 13}
    # who writes deg beside a rate means deg/s
    beside = resolve(["t", "ax", "ay", "az", "gx [deg]", "gy [deg]", "gz [deg]"])
    assert (beside.units, beside.increments) == ({"angular_rate": "deg/s"}, frozenset())


def test_what_cannot_be_is_one_line(log, summed, run, tmp_path):
    path = tmp_path / "log.csv"
    summed.drop(columns="time_us").to_csv(path, index=False)
    with pytest.raises(ImuloopError, match="no time column"):
        run(path)
    with pytest.raises(ImuloopError, match=r"columns.interval: no column 'step'; there are dvx"):
        run(path, columns={"interval": "step"}, rate=100)
    with pytest.raises(ImuloopError, match=r"units.interval: 'usec' is not a unit; .* 'us'\?"):
        run(path, columns={"interval": "dvx"}, units={"interval": "usec"})
    streams = [Stream("imu", np.arange(9), {})]
    with pytest.raises(ImuloopError, match=r"columns.interval: only tables have one"):
        raw_log(streams, {"interval": "dt"})
