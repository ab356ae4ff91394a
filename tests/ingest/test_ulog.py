"""Logs of PX4, beside the round trip: ULog."""

import struct
from functools import partial

import numpy as np
import pytest
from pyulog import ULog

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import CHANNELS
from imuloop.ingest import ulog as reader
from ingest import written
from ingest.autopilots import STAMPS, WARM, of_own_interval
from ingest.written import ACCELERATION, RATE

SIX = [*CHANNELS]


# bytes of a row of `combined`: header, number of the topic, stamp, six axes
ROW = 3 + 2 + 8 + 6 * 4


@pytest.fixture
def ulog(tmp_path):
    return partial(written.ulog, tmp_path / "log.ulg")


def combined(table, **more):
    return written.combined(STAMPS, table[SIX].to_numpy(), **more)


def sensor(table, kind, instance, **more):
    columns = ACCELERATION if kind == "accel" else RATE
    delay = 100 * len(kind)
    return written.px4_sensor(kind, instance, STAMPS, table[columns].to_numpy(), delay, **more)


def test_topics_of_px4_and_their_warmth_are_read(run, single, ulog, same):
    done = run(ulog(combined(single)))
    same(done, single)
    assert done.quality["columns"]["acceleration"][0] == "sensor_combined_0.acceleration.x"
    assert any("PX4's own calibration" in note for note in done.quality["warnings"])
    done = run(ulog(sensor(single, "accel", 2, temperature=WARM), sensor(single, "gyro", 1)))
    same(done, single)
    np.testing.assert_array_equal(done.samples.temperature, WARM)
    assert done.quality["columns"]["angular_rate"][2] == "sensor_gyro_1.angular_rate.z"
    assert done.quality["warnings"] == []
    fields = {"timestamp": STAMPS, **written.vector(single[ACCELERATION].to_numpy(), "force[{}]")}
    fields |= written.vector(single[RATE].to_numpy(), "turn_{}")
    path = ulog(("my_imu", 3, fields))
    columns = {"acceleration": [f"my_imu_3.force[{i}]" for i in range(3)]}
    columns["angular_rate"] = [f"my_imu_3.turn_{i}" for i in range(3)]
    same(run(path, columns=columns), single)
    assert "no rows of sensor_combined, sensor_accel" in run(path).quality["reasons"][0]


def test_px4s_own_numbers_of_its_sensors_are_kept(run, single, ulog):
    """The topic's device id, and its slot; of a topic without one the only calibrated sensor."""

    def ids(*topics, **parameters):
        return run(ulog(*topics, parameters=parameters)).metadata["sensor_ids"]

    number = {"device_id": np.full(500, 1310988, dtype="u4")}
    accel, gyro = sensor(single, "accel", 0, **number), sensor(single, "gyro", 0)
    found = ids(accel, gyro, CAL_ACC0_ID=7, CAL_ACC1_ID=1310988, CAL_GYRO0_ID=9, CAL_GYRO1_ID=0)
    assert found == {"accelerometer": {"id": 1310988, "slot": 1}, "gyroscope": {"id": 9, "slot": 0}}
    # which of two was logged is not known
    assert ids(combined(single), CAL_ACC0_ID=7, CAL_ACC1_ID=8, CAL_GYRO2_ID=9) == {
        "gyroscope": {"id": 9, "slot": 2}
    }
    assert ids(combined(single)) == {}


def test_an_accelerometer_read_later_than_the_gyroscope_keeps_its_time(run, single, ulog):
    relative = np.full(500, -2_500, "i4")
    done = run(ulog(combined(single, accelerometer_timestamp_relative=relative)))
    np.testing.assert_array_equal(done.samples.ay, single.ay)
    np.testing.assert_allclose(done.samples.t_accelerometer, done.samples.t - 2.5e-3, atol=1e-12)
    relative = np.where(np.isin(np.arange(500), [3, 4]), 0x7FFFFFFF, 0).astype("i4")
    done = run(ulog(combined(single, accelerometer_timestamp_relative=relative)))
    np.testing.assert_array_equal(done.samples.ay, single.ay.drop([3, 4]))
    assert done.quality["non_finite"] == 2


def test_increments_of_px4_are_of_their_own_interval(run, single, ulog):
    us = np.random.default_rng(3).integers(4000, 6000, (500, 2)).astype("u4")
    ticks = us[:, [0, 0, 0, 1, 1, 1]]
    increments = (single[SIX].to_numpy() * ticks * 1e-6).astype("f4")
    us[7, 1] = 0
    fields = {"timestamp": STAMPS + np.uint64(90), "timestamp_sample": STAMPS}
    for i, (name, part) in enumerate((("velocity", slice(0, 3)), ("angle", slice(3, 6)))):
        fields |= written.vector(increments[:, part], f"delta_{name}[{{}}]")
        fields[f"delta_{name}_dt"] = us[:, i].copy()
    done = run(ulog(("vehicle_imu", 0, fields)))
    expected = of_own_interval(increments, us[:, [0, 0, 0, 1, 1, 1]], 10**6)
    np.testing.assert_array_equal(done.samples[SIX], expected)
    assert done.quality["non_finite"] == 1
    # rates of a still sensor whose interval jitters by 20 % are as quiet as the log's
    np.testing.assert_allclose(done.samples.az, single.az.drop(7), rtol=1e-6)


def test_buffers_of_px4_are_one_row_a_sample(run, ulog):
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
    done = run(ulog(*topics), units={"time": "ms"})
    np.testing.assert_array_equal(done.samples[SIX], counts.T * float(np.float32(0.1)))
    # stamps of whole microseconds, steps of 125.5
    np.testing.assert_allclose(np.diff(done.samples.t) * 1e3, 125.5, atol=1)


def test_a_ulog_cut_off_is_read_up_to_there_and_dropouts_are_named(run, single, ulog):
    path = ulog(combined(single), dropouts=[(30, STAMPS[100]), (1500, STAMPS[200])])
    assert "2 dropouts while logging, 1.53 s together" in run(path).quality["warnings"]
    path = ulog(combined(single))
    content = path.read_bytes()
    for lost in (1, ROW, 100 * ROW + 5):
        path.write_bytes(content[:-lost])
        done = run(path)
        np.testing.assert_array_equal(done.samples.az, single.az[: (500 * ROW - lost) // ROW])
        reported = "the file ends inside a message: the log was cut off" in done.quality["warnings"]
        assert reported == bool(lost % ROW)
    for size in (5, len(content) - 500 * ROW):
        path.write_bytes(content[:size])
        with pytest.raises(RejectedLog):
            reader.read({"log": path})


def test_damage_to_a_ulog_costs_its_rows(run, single, ulog):
    path = ulog(combined(single))
    content = path.read_bytes()
    # PX4 marks a place to go on from several times a second
    mark = struct.pack("<HB", len(ULog.SYNC_BYTES), ord("S")) + ULog.SYNC_BYTES
    rows = [content[at : at + ROW] for at in range(len(content) - 500 * ROW, len(content), ROW)]
    marked = (b"".join([*rows[i : i + 20], mark]) for i in range(0, 500, 20))
    content = content[: -500 * ROW] + b"".join(marked)
    half = len(content) // 2
    path.write_bytes(content[:half] + b"\x03" * 200 + content[half + 200 :])
    done = run(path)
    assert 460 <= len(done.samples) < 500 and done.quality["gaps"]["count"] == 1
    assert "parts of the file are damaged" in " ".join(done.quality["warnings"])
    # a row whose end alone is overwritten cannot be known
    assert np.isin(done.samples.az, single.az).sum() >= len(done.samples) - 1
