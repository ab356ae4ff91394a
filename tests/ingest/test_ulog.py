"""PX4 ULog files, written with the format's own library."""

import struct
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from pyulog import ULog

from imuloop.core.errors import RejectedLog
from imuloop.ingest import ulog
from ingest.tables import ACCELERATION, RATE, same

pytestmark = pytest.mark.usefixtures("in_process")

# PX4 counts from its start; odd, so that no stamp is a whole number of anything
STAMPS = (12_345_678_901 + 10_003 * np.arange(500)).astype("u8")
# bytes of a row of `combined`: header, number of the topic, stamp, six axes
ROW = 3 + 2 + 8 + 6 * 4
TYPES = {"u8": "uint64_t", "f4": "float", "i4": "int32_t", "i2": "int16_t", "u1": "uint8_t"}
TYPES |= {"u4": "uint32_t"}


@pytest.fixture
def write(tmp_path):
    def call(*topics, name="log.ulg", dropouts=(), parameters=None):
        log = ULog(None)
        log._initial_parameters.update(parameters or {})
        for number, (topic, instance, fields) in enumerate(topics):
            fields = {key: np.asarray(x) for key, x in fields.items()}
            kinds = [ULog._FieldData(key, TYPES[x.dtype.str[1:]]) for key, x in fields.items()]
            stems = [(field.type_str, *field.field_name.partition("[")[:2]) for field in kinds]
            # type, length of an array, name
            formats = [(k, stems.count((k, n, a)) * bool(a), n) for k, n, a in dict.fromkeys(stems)]
            log._message_formats[topic] = SimpleNamespace(name=topic, fields=formats)
            data = {"multi_id": instance, "msg_id": number, "name": topic, "data": fields}
            log._data_list.append(SimpleNamespace(field_data=kinds, **data))
        for duration, stamp in dropouts:
            content = struct.pack("<H", duration)
            log._dropouts.append(ULog.MessageDropout(content, SimpleNamespace(), int(stamp)))
        path = tmp_path / name
        log.write_ulog(str(path))
        return path

    return call


@pytest.fixture
def single(log):
    """The log as PX4 keeps it: single precision, whole microseconds."""
    return log.astype(np.float32).assign(t=np.arange(500) * 10_003 * 1e-6)


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def vector(table, columns, name):
    return {name.format(i): table[c].to_numpy(np.float32) for i, c in enumerate(columns)}


def axes(table, columns):
    return {axis: table[c].to_numpy(np.float32) for axis, c in zip("xyz", columns, strict=True)}


def combined(table, **more):
    fields = {"timestamp": STAMPS, **vector(table, RATE, "gyro_rad[{}]")}
    return (
        "sensor_combined",
        0,
        fields | more | vector(table, ACCELERATION, "accelerometer_m_s2[{}]"),
    )


def sensor(table, kind, instance, **more):
    columns = ACCELERATION if kind == "accel" else RATE
    # published later than sampled, each by its own delay
    stamps = {"timestamp": STAMPS + np.uint64(100 * len(kind)), "timestamp_sample": STAMPS}
    return f"sensor_{kind}", instance, stamps | axes(table, columns) | more


def test_sensor_combined(run, single, write):
    done = run(write(combined(single), name="log.ulog"))
    assert same(done.samples, single)
    assert same(run(done.path.parents[1] / "log.ulog", batch_rows=7).samples, single)
    assert done.quality["columns"]["acceleration"][0] == "sensor_combined_0.acceleration.x"
    assert done.metadata["units"]["time"] == "us"
    assert any("PX4's own calibration" in note for note in done.quality["warnings"])


@pytest.mark.parametrize("topic", ["combined", "single sensors"])
def test_every_bit(hard, every_bit, write, topic):
    values = pd.DataFrame(hard.astype("f4"), columns=ACCELERATION + RATE)
    # beyond what float64 holds
    stamps = (2**60 + 1 + 10_003 * np.arange(300)).astype("u8")
    fields = {"timestamp": stamps, "timestamp_sample": stamps}
    force = {**fields, **axes(values, ACCELERATION)}
    rate = {**fields, **axes(values, RATE)}
    topics = [("sensor_accel", 0, force), ("sensor_gyro", 0, rate)]
    if topic == "combined":
        vectors = vector(values, RATE, "gyro_rad[{}]")
        vectors |= vector(values, ACCELERATION, "accelerometer_m_s2[{}]")
        topics = [("sensor_combined", 0, {"timestamp": stamps, **vectors})]
    every_bit(write(*topics), hard.astype("f4"), stamps.astype("i8"))


def test_raw_sensors_at_the_same_times(run, single, write):
    warm = np.linspace(20, 30, 500, dtype=np.float32)
    path = write(sensor(single, "accel", 2, temperature=warm), sensor(single, "gyro", 1))
    done = run(path)
    assert same(done.samples, single)
    np.testing.assert_array_equal(done.samples.temperature, warm)
    assert done.quality["columns"]["angular_rate"][2] == "sensor_gyro_1.angular_rate.z"
    assert done.quality["warnings"] == []


def test_px4s_own_numbers_of_its_sensors(run, single, write):
    """The topic's device id, and its slot; of a topic without one the only calibrated sensor."""

    def ids(*topics, **parameters):
        return run(write(*topics, parameters=parameters)).metadata["sensor_ids"]

    number = {"device_id": np.full(500, 1310988, dtype="u4")}
    accel, gyro = sensor(single, "accel", 0, **number), sensor(single, "gyro", 0)
    found = ids(accel, gyro, CAL_ACC0_ID=7, CAL_ACC1_ID=1310988, CAL_GYRO0_ID=9, CAL_GYRO1_ID=0)
    assert found == {"accelerometer": {"id": 1310988, "slot": 1}, "gyroscope": {"id": 9, "slot": 0}}
    # which of two was logged is not known
    assert ids(combined(single), CAL_ACC0_ID=7, CAL_ACC1_ID=8, CAL_GYRO2_ID=9) == {
        "gyroscope": {"id": 9, "slot": 2}
    }
    assert ids(combined(single)) == {}


def test_a_topic_that_is_not_of_px4(run, single, write):
    fields = {"timestamp": STAMPS, **vector(single, ACCELERATION, "force[{}]")}
    path = write(("my_imu", 3, fields | axes(single, RATE)))
    columns = {"acceleration": [f"my_imu_3.force[{i}]" for i in range(3)]}
    columns["angular_rate"] = [f"my_imu_3.{axis}" for axis in "xyz"]
    assert same(run(path, columns=columns).samples, single)
    assert "no rows of sensor_combined, sensor_accel" in run(path).quality["reasons"][0]


def test_an_accelerometer_read_later_than_the_gyroscope(run, single, write):
    path = write(combined(single, accelerometer_timestamp_relative=np.full(500, -2_500, "i4")))
    done = run(path)
    np.testing.assert_array_equal(done.samples.ay, single.ay)
    np.testing.assert_allclose(done.samples.t_accelerometer, done.samples.t - 2.5e-3, atol=1e-12)
    late = np.zeros(500, "i4")
    late[[3, 4]] = 0x7FFFFFFF
    done = run(write(combined(single, accelerometer_timestamp_relative=late)))
    np.testing.assert_array_equal(done.samples.ay, single.ay.drop([3, 4]))
    assert done.quality["non_finite"] == 2


def test_increments_over_their_own_interval(run, single, write):
    rng = np.random.default_rng(3)
    dt = {n: rng.integers(4000, 6000, 500).astype("u4") for n in ("delta_angle", "delta_velocity")}
    fields = {"timestamp": STAMPS + np.uint64(90), "timestamp_sample": STAMPS}
    increments = {}
    for name, columns in (("delta_angle", RATE), ("delta_velocity", ACCELERATION)):
        for i, column in enumerate(columns):
            increments[column] = (single[column] * dt[name] * 1e-6).to_numpy(np.float32)
            fields[f"{name}[{i}]"] = increments[column]
        fields[f"{name}_dt"] = dt[name]
    fields["delta_angle_dt"] = fields["delta_angle_dt"].copy()
    fields["delta_angle_dt"][7] = 0
    done = run(write(("vehicle_imu", 0, fields)))
    kept = np.arange(500) != 7
    for column in ACCELERATION + RATE:
        step = dt["delta_velocity" if column in ACCELERATION else "delta_angle"]
        pairs = zip(increments[column].tolist(), step.tolist(), strict=True)
        # the float64 nearest to the increment over its own interval
        rate = np.array([float(Fraction(x) * 10**6 / us) for x, us in pairs])
        np.testing.assert_array_equal(done.samples[column], rate[kept])
    assert done.quality["non_finite"] == 1
    # rates of a still sensor whose interval jitters by 20 % are as quiet as the log's
    np.testing.assert_allclose(done.samples.az, single.az[kept], rtol=1e-6)


def test_buffers_are_one_row_a_sample(run, write):
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
    done = run(write(*topics), units={"time": "ms"})
    scale = float(np.float32(0.1))
    for name, x in zip(ACCELERATION + RATE, counts, strict=True):
        np.testing.assert_array_equal(done.samples[name], x * scale)
    # stamps of whole microseconds, steps of 125.5
    np.testing.assert_allclose(np.diff(done.samples.t) * 1e3, 125.5, atol=1)


def test_dropouts_are_reported(run, single, write):
    path = write(combined(single), dropouts=[(30, STAMPS[100]), (1500, STAMPS[200])])
    assert "2 dropouts while logging, 1.53 s together" in run(path).quality["warnings"]


def test_a_log_cut_off_is_read_up_to_there(run, single, write):
    path = write(combined(single))
    content = path.read_bytes()
    for lost in (1, ROW - 1, ROW, 100 * ROW + 5):
        path.write_bytes(content[:-lost])
        done = run(path)
        rows = (500 * ROW - lost) // ROW
        np.testing.assert_array_equal(done.samples.az, single.az[:rows])
        reported = "the file ends inside a message: the log was cut off" in done.quality["warnings"]
        assert reported == bool(lost % ROW)
    for size in (5, len(content) - 500 * ROW):
        path.write_bytes(content[:size])
        with pytest.raises(RejectedLog):
            ulog.read({"log": path})


def test_damage_costs_its_rows(run, single, write):
    path = write(combined(single))
    content = path.read_bytes()
    # PX4 marks a place to go on from several times a second
    rows = [content[at : at + ROW] for at in range(len(content) - 500 * ROW, len(content), ROW)]
    marked = (
        b"".join([*rows[i : i + 20], message("S", ULog.SYNC_BYTES)]) for i in range(0, 500, 20)
    )
    content = content[: -500 * ROW] + b"".join(marked)
    half = len(content) // 2
    path.write_bytes(content[:half] + b"\x03" * 200 + content[half + 200 :])
    done = run(path)
    assert 460 <= len(done.samples) < 500
    assert "parts of the file are damaged" in " ".join(done.quality["warnings"])
    # a row whose end alone is overwritten cannot be known
    assert np.isin(done.samples.az, single.az).sum() >= len(done.samples) - 1
    assert done.quality["gaps"]["count"] == 1
