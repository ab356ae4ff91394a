"""Logs of robots and autopilots: what several topics or messages give together."""

import numpy as np
import pytest

from ingest import written
from ingest.vehicle_forms import (
    SIX,
    STAMPS,
    WARM,
    bag,
    combined,
    marked_ulog,
    messages,
    sampled,
    sensors,
)

IMT = "QBfffffffff", "TimeUS,I,DelT,DelvT,DelaT,DelAX,DelAY,DelAZ,DelVX,DelVY,DelVZ"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.ulg"


def test_temperatures_of_their_topics_are_read(log, single, run, path):
    done = run(*bag(path, log, topics=("imu", "warm")))
    np.testing.assert_array_equal(done.samples.temperature, 20 + log.ax)
    for write, name in ((sensors, "log.ulg"), (messages, "log.bin")):
        write(path.with_name(name), single)
        np.testing.assert_array_equal(run(path.with_name(name)).samples.temperature, WARM)


@pytest.mark.parametrize(
    ("write", "options"),
    [
        (combined, {"accelerometer_timestamp_relative": np.full(500, -2_500, "i4")}),
        (sampled, {"later": 2_500}),
    ],
)
def test_a_sensor_read_later_keeps_its_time(single, run, path, write, options):
    write(path, single, **options)
    done = run(path)
    np.testing.assert_array_equal(done.samples.ay, single.ay)
    np.testing.assert_allclose(done.samples.t_accelerometer, done.samples.t - 2.5e-3, atol=1e-12)
    assert any("has a clock of its own" in line for line in done.quality["warnings"])


@pytest.mark.parametrize("pilot", ["px4", "ardupilot"])
def test_increments_are_of_their_own_interval(single, run, path, pilot):
    """Protects the division, of exact products: the result is the float64 nearest to it."""
    rng, of = np.random.default_rng(3), [0, 0, 0, 1, 1, 1]
    if pilot == "px4":
        ticks, per_s = rng.integers(4000, 6000, (500, 2)).astype("u4"), 10**6
    else:
        ticks, per_s = rng.uniform(0.009, 0.011, (500, 2)).astype("f4"), 1
    increments = (single[SIX].to_numpy() * ticks[:, of] / per_s).astype("f4")
    expected = increments.astype(float) * per_s / ticks[:, of]
    ticks[7, 1] = 0
    if pilot == "px4":
        fields = {"timestamp": STAMPS + np.uint64(90), "timestamp_sample": STAMPS}
        for i, name in enumerate(("velocity", "angle")):
            part = increments[:, 3 * i : 3 * i + 3]
            fields |= written.vector(part, f"delta_{name}[{{}}]")
            fields[f"delta_{name}_dt"] = ticks[:, i].copy()
        done = run(written.ulog(path, ("vehicle_imu", 0, fields)))
    else:
        rows = zip(STAMPS, ticks, increments, strict=True)
        rows = [(t, 0, 0.01, *dt, *x[3:], *x[:3]) for t, dt, x in rows]
        path.write_bytes(written.binary(("IMT", IMT, rows)))
        done = run(path)
    np.testing.assert_array_equal(done.samples[SIX], np.delete(expected, 7, axis=0))
    assert done.quality["non_finite"] == 1


def test_buffers_of_px4_are_one_row_a_sample(run, path):
    counts = np.random.default_rng(1).integers(-3000, 3000, (6, 500)).astype("i2")
    sizes = np.tile([2, 4, 3, 1], 50)
    ends = np.cumsum(sizes)
    times = 12_345_678_901 + 125.5 * np.arange(500)
    topics = []
    for name, rows in (("accel", counts[:3]), ("gyro", counts[3:])):
        buffers = np.zeros((3, 4, 200), "i2")
        for i, (end, size) in enumerate(zip(ends, sizes, strict=True)):
            buffers[:, :size, i] = rows[:, end - size : end]
        fields = {"timestamp": STAMPS[:200], "timestamp_sample": times[ends - 1].astype("u8")}
        fields |= {"dt": np.full(200, 125.5, "f4"), "scale": np.full(200, 0.1, "f4")}
        fields["samples"] = sizes.astype("u1")
        fields |= {f"{axis}[{k}]": buffers[a, k] for a, axis in enumerate("xyz") for k in range(4)}
        topics.append((f"sensor_{name}_fifo", 0, fields))
    done = run(written.ulog(path, *topics), units={"time": "ms"})
    np.testing.assert_array_equal(done.samples[SIX], counts.T * float(np.float32(0.1)))
    # stamps of whole microseconds, steps of 125.5
    np.testing.assert_allclose(np.diff(done.samples.t) * 1e3, 125.5, atol=1)


def test_damage_to_a_ulog_costs_its_rows(single, run, path):
    marked_ulog(path, single)
    done = run(path)
    assert 460 <= len(done.samples) < 500 and done.quality["gaps"]["count"] == 1
    assert "parts of the file are damaged" in " ".join(done.quality["warnings"])
    # a row whose end alone is overwritten cannot be known
    assert np.isin(done.samples.az, single.az).sum() >= len(done.samples) - 1
