"""PX4 ULog files: the topics of the inertial sensors, each instance a stream."""

import io

import numpy as np

from imuloop.ingest.spellings import AXES
from imuloop.ingest.streams import AUTOPILOT, Stream, names_in, raw_log, sensor_fields

# fields of each sensor in the topics of PX4, with {0} for the number and {1} for the name of the
# axis; topics in `_CORRECTED` are corrected by PX4's own calibration
_TOPICS = {
    "sensor_combined": {"acceleration": "accelerometer_m_s2[{0}]", "angular_rate": "gyro_rad[{0}]"},
    "sensor_accel": {"acceleration": "{1}"},
    "sensor_gyro": {"angular_rate": "{1}"},
    "sensor_accel_fifo": {"acceleration": "{1}"},
    "sensor_gyro_fifo": {"angular_rate": "{1}"},
    "vehicle_imu": {"acceleration": "delta_velocity[{0}]", "angular_rate": "delta_angle[{0}]"},
}
_CORRECTED = ("sensor_combined", "vehicle_imu")
# field with the interval of the increments of each sensor, us
_INTERVALS = {"acceleration": "delta_velocity_dt", "angular_rate": "delta_angle_dt"}
# for each sensor: its name, PX4's short name, and the fields with its device id, in its topic and
# in other topics
_IDS = {
    "acceleration": ("accelerometer", "ACC", ("device_id", "accel_device_id")),
    "angular_rate": ("gyroscope", "GYRO", ("device_id", "gyro_device_id")),
}
# numbers of calibrated sensors in the parameters of PX4
_SLOTS = range(4)
# most times that the library may read the file; it reads each byte of a sound file at most twice
_MOST_TIMES = 10
# value of accelerometer_timestamp_relative in a row without acceleration
_NO_ACCELERATION = 0x7FFFFFFF


def read(paths, columns=None):
    """Return the RawLog of a PX4 ULog file, the log as it was read.

    ``paths["log"]`` is the path of the file. `columns` are the declared columns by quantity, or
    None: each is a stream or ``STREAM.FIELD``; they may be of topics other than the usual ones. A
    stream has the rows of a topic of one instance (sensor), such as ``sensor_accel_0``. Increments
    are divided by their own interval. A buffer of samples becomes one row per sample.
    """
    # imported late, as few logs need this library
    from pyulog import ULog

    with open(paths["log"], "rb") as file:
        tape = _Tape(file.read())
    log = ULog(tape, sorted({*_TOPICS} | names_in(columns)))
    damage = ["the file ends inside a message: the log was cut off"] if tape.cut else []
    if log.file_corruption:
        damage.append("parts of the file are damaged; the rows in them are lost")
    streams = [stream for topic in log.data_list for stream in _streams(topic)]
    notes = []
    if log.dropouts:
        lost = sum(dropout.duration for dropout in log.dropouts) / 1000
        notes.append(f"{len(log.dropouts)} dropouts while logging, {lost:.4g} s together")
    raw = raw_log(streams, columns, notes, damage)
    topics = {f"{topic.name}_{topic.multi_id}": topic.data for topic in log.data_list}
    for quantity, names in raw.names.items():
        if quantity in _IDS:
            data = topics[names[0].partition(".")[0]]
            raw.sensor_ids |= _sensor_id(quantity, data, log.initial_parameters)
    return raw


def _sensor_id(quantity, data, parameters):
    """Return {name: {"id": device id, "slot": slot}} of a sensor in PX4, with the sensor's name.

    `quantity` is what the sensor measures, such as "acceleration". The id comes from `data`, the
    fields of the sensor's topic, or else from CAL_…_ID in PX4's `parameters`. The slot is the
    number in the name of the parameter that holds the id, 0 for CAL_ACC0_ID, and 0 as well if
    no parameter holds it. The result is empty if there is no id or more than one.
    """
    sensor, short, fields = _IDS[quantity]
    slots = {parameters.get(f"CAL_{short}{k}_ID"): k for k in reversed(_SLOTS)}
    ids = {int(x) for name in fields for x in np.unique(data.get(name, ()))} - {0}
    ids = ids or {*slots} - {0, None}
    if len(ids) != 1:
        return {}
    [device_id] = ids
    return {sensor: {"id": device_id, "slot": slots.get(device_id, 0)}}


class _Tape(io.BytesIO):
    """A file in memory that notes in `cut` whether it ended inside a message.

    Damage can lead the library in circles. So an error ends the reading once the library has read
    `_MOST_TIMES` times the size of the file.
    """

    cut, asked = False, 0

    def read(self, size=-1):
        """Return the next `size` bytes, or all; raise a ValueError if reading goes in circles."""
        got = super().read(size)
        self.asked += 1 + len(got)
        if self.asked > _MOST_TIMES * (1 + self.getbuffer().nbytes):
            raise ValueError("reading it goes in circles")
        # at the end of a sound file only the three bytes of a next header are missing
        self.cut |= len(got) < size and (size != 3 or bool(got))
        return got


# damaged numbers can be any, a signalling one too
@np.errstate(over="ignore", invalid="ignore")
def _streams(topic):
    """Return the Streams, rows with one clock each, of one instance (sensor) of a topic, a list.

    `topic` is the data set of pyulog. A Stream also has the fields of the sensors under their usual
    names. The acceleration is a Stream by itself if it was sampled at other times than the angular
    rate. The list is empty without time stamps.
    """
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
        names = [form.format(i, axis) for i, axis in enumerate(AXES)]
        fields |= sensor_fields(quantity, fields, names, _INTERVALS[quantity], 1e6)
    relative = fields.get("accelerometer_timestamp_relative")
    if relative is not None and "acceleration.x" in fields:
        missing = relative == _NO_ACCELERATION
        force = {key: fields.pop(key) for key in (f"acceleration.{axis}" for axis in AXES)}
        force = {key: np.where(missing, np.nan, x) for key, x in force.items()}
        later = np.where(missing, 0, relative.astype(np.int64))
        if later.any():
            # the two sensors were sampled at different times
            force = Stream(f"{name}.accelerometer", stamps + later, force, AUTOPILOT, notes)
            return [Stream(name, stamps, fields, AUTOPILOT), force]
        fields |= force
    return [Stream(name, stamps, fields, AUTOPILOT, notes)]


def _unpacked(stamps, fields):
    """Return time stamp, us, (m,), and fields x, y, z, (m,) each, of all m samples in buffers.

    `fields` has columns of a topic by name; each row of them is a buffer of samples. `stamps` has
    the time of the last sample of each buffer, us, and the field ``dt`` the step between two
    samples, us. If `fields` has no buffers, `stamps` and `fields` are returned as they are.
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
