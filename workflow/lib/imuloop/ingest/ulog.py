"""PX4 ULog files: the topics of the inertial sensors, each instance a stream."""

import io

import numpy as np

from imuloop.core.errors import RejectedLog
from imuloop.ingest.spellings import AXES
from imuloop.ingest.streams import AUTOPILOT, Stream, names_in, rates, raw_log

# topic of PX4 to the fields of each sensor, by number or name of the axis; from `_CORRECTED` PX4
# has removed its own calibration
_TOPICS = {
    "sensor_combined": {"acceleration": "accelerometer_m_s2[{0}]", "angular_rate": "gyro_rad[{0}]"},
    "sensor_accel": {"acceleration": "{1}"},
    "sensor_gyro": {"angular_rate": "{1}"},
    "sensor_accel_fifo": {"acceleration": "{1}"},
    "sensor_gyro_fifo": {"angular_rate": "{1}"},
    "vehicle_imu": {"acceleration": "delta_velocity[{0}]", "angular_rate": "delta_angle[{0}]"},
}
_CORRECTED = ("sensor_combined", "vehicle_imu")
# length of the intervals, in us, of the increments
_INTERVALS = {"acceleration": "delta_velocity_dt", "angular_rate": "delta_angle_dt"}
# of each sensor: what PX4 calls it, and fields with its device id, in its topic and in others
_IDS = {
    "acceleration": ("accelerometer", "ACC", ("device_id", "accel_device_id")),
    "angular_rate": ("gyroscope", "GYRO", ("device_id", "gyro_device_id")),
}
# PX4 has parameters of at most four calibrated sensors
_SLOTS = range(4)
# the library reads each byte of a sound file twice at most
_MOST_TIMES = 10
# accelerometer_timestamp_relative of a row without acceleration
_NO_ACCELERATION = 0x7FFFFFFF


def read(paths, columns=None):
    """Read a ULog file.

    The streams are the topics with their instance, ``sensor_accel_0``. `columns` names streams or
    ``STREAM.FIELD``, also of topics of other sensors. Increments become rates by their own
    interval. Buffers become one row per sample.
    """
    # a library that few need
    from pyulog import ULog

    with open(paths["log"], "rb") as file:
        tape = _Tape(file.read())
    log = ULog(tape, sorted({*_TOPICS} | names_in(columns)))
    damage = ["the file ends inside a message: the log was cut off"] if tape.cut else []
    if log.file_corruption:
        damage.append("parts of the file are damaged; the rows in them are lost")
    streams = [stream for topic in log.data_list for stream in _streams(topic)]
    if not streams:
        raise RejectedLog(f"the log holds no rows of {', '.join(_TOPICS)}")
    notes = list(damage)
    if log.dropouts:
        lost = sum(dropout.duration for dropout in log.dropouts) / 1000
        notes.append(f"{len(log.dropouts)} dropouts while logging, {lost:.4g} s together")
    raw = raw_log(streams, columns, notes, damage)
    topics = {f"{topic.name}_{topic.multi_id}": topic.data for topic in log.data_list}
    for quantity, names in raw.found.items():
        if quantity in _IDS:
            data = topics[names[0].partition(".")[0]]
            raw.sensor_ids |= _sensor_id(quantity, data, log.initial_parameters)
    return raw


def _sensor_id(quantity, data, parameters):
    """Return the name of a sensor -> its device id and slot, as PX4 has them in CAL_ACC0_ID.

    The id is that in the `data` of the sensor's topic, else of PX4's parameters where these know
    one sensor; the result is empty without.
    """
    sensor, short, fields = _IDS[quantity]
    slots = {parameters.get(f"CAL_{short}{k}_ID"): k for k in reversed(_SLOTS)}
    known = {int(x) for name in fields for x in np.unique(data.get(name, ()))} - {0}
    known = known or {*slots} - {0, None}
    if len(known) != 1 or not 0 < (one := known.pop()) < 1 << 31:
        return {}
    return {sensor: {"id": one, "slot": slots.get(one, 0)}}


class _Tape(io.BytesIO):
    """A file in memory that knows whether reading ended inside a message.

    Damage can lead the library in circles: it may read the file a few times over, no more.
    """

    cut, asked = False, 0

    def read(self, size=-1):
        got = super().read(size)
        self.asked += 1 + len(got)
        if self.asked > _MOST_TIMES * (1 + self.getbuffer().nbytes):
            raise ValueError("reading it goes in circles")
        # the next header's three bytes may be missing, nothing else
        self.cut |= len(got) < size and (size != 3 or bool(got))
        return got


# damaged numbers can be any, a signalling one too
@np.errstate(over="ignore", invalid="ignore")
def _streams(topic):
    """Return the streams of one topic and instance: its fields, and the sensors' usual names."""
    fields, name = dict(topic.data), f"{topic.name}_{topic.multi_id}"
    sampled = fields.get("timestamp_sample")
    stamps = sampled if sampled is not None and sampled.any() else fields.get("timestamp")
    if stamps is None or stamps.dtype.kind not in "iu":
        return []
    stamps, notes = stamps.astype(np.int64), []
    if topic.name in _CORRECTED:
        notes.append(
            f"{name} is corrected by PX4's own calibration; in newer logs sensor_accel and "
            "sensor_gyro are not"
        )
    if topic.name.endswith("_fifo"):
        stamps, fields = _unpacked(stamps, fields)
    for quantity, form in _TOPICS.get(topic.name, {}).items():
        names = {f"{quantity}.{axis}": form.format(i, axis) for i, axis in enumerate(AXES)}
        if {*names.values()} <= {*fields}:
            usual = {axis: fields[x] for axis, x in names.items()}
            if (interval := fields.get(_INTERVALS[quantity])) is not None:
                usual = {axis: rates(x, interval, 1e6) for axis, x in usual.items()}
            fields |= usual
    relative = fields.get("accelerometer_timestamp_relative")
    if relative is None or "acceleration.x" not in fields:
        return [Stream(name, stamps, fields, AUTOPILOT, notes)]
    missing = relative == _NO_ACCELERATION
    force = {f"acceleration.{a}": fields.pop(f"acceleration.{a}") for a in AXES}
    force = {key: np.where(missing, np.nan, x) for key, x in force.items()}
    later = np.where(missing, 0, relative.astype(np.int64))
    if not later.any():
        return [Stream(name, stamps, fields | force, AUTOPILOT, notes)]
    # the two sensors were sampled at different times
    force = Stream(f"{name}.accelerometer", stamps + later, force, AUTOPILOT, notes)
    return [Stream(name, stamps, fields, AUTOPILOT), force]


def _unpacked(stamps, fields):
    """Return stamps and x, y, z of each sample of first-in first-out buffers.

    `timestamp_sample` is the last sample's, `dt` the step between two, in us.
    """
    width = sum(name.startswith("x[") for name in fields)
    k = np.arange(width)
    if not width or not {"dt", "scale", "samples"} <= {*fields}:
        return stamps, fields
    count = np.minimum(fields["samples"].astype(int), width)[:, None]
    step, scale = (fields[name].astype(float)[:, None] for name in ("dt", "scale"))
    buffers = {axis: np.stack([fields[f"{axis}[{i}]"] for i in k], axis=1) for axis in AXES}
    values = {axis: (rows * scale)[k < count] for axis, rows in buffers.items()}
    return (stamps[:, None] - (count - 1 - k) * step)[k < count], values
