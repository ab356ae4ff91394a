"""The keys of a config: types, limits, units and meaning.

These models check a config; ``workflow/schemas/config.schema.yaml`` and ``docs/settings.md`` are
made from them. The settings of a stage are in its ``settings.py``.
"""

import os
from datetime import datetime
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from imuloop.calibrate.settings import CalibrateSettings
from imuloop.config import known_figures
from imuloop.config_keys import Keys, either, kind_of
from imuloop.core.errors import ImuloopError
from imuloop.core.units import (
    MOST_COUNT_OFFSET,
    SCALE_OF_COUNTS,
    STANDARD_GRAVITY,
    needed_by_counts,
)
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.file_faults import file_fault, path_fault
from imuloop.ingest.sources import file_name
from imuloop.ingest.spellings import SENSORS, UNITS
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.settings import SegmentSettings
from imuloop.sensors import LARGEST, PARTS, find_sensor

# names of the log formats; their readers, in imuloop.ingest.formats, take long to import
FORMATS = ("csv", "tsv", "euroc", "imu_tk", "jsonl", "parquet", "feather", "numpy", "netcdf")
FORMATS += ("matlab", "ros", "phone", "ulog", "dataflash")
# patterns of texts
NAME = "^[A-Za-z][A-Za-z0-9_-]{0,63}$"
SHA256 = "^[0-9a-f]{64}$"
URL = r"^(https?|ftp|file)://\S*[^/\s]$"
WHEEL = "^[A-Za-z0-9][A-Za-z0-9._-]*==[A-Za-z0-9][A-Za-z0-9.+!_-]*$"
MEMBER = r"^[^/\n].*[^/\n]$"


def _source_kind(value):
    """Return the name of the type for the value of a source: a path, a url or a wheel."""
    if isinstance(value, dict):
        return "wheel" if "wheel" in value else "url"
    return kind_of(value)


def _file_kind(value):
    """Return the name of the type for the value of a file: a pair of sources, or one source."""
    pair = isinstance(value, dict) and {*SENSORS} & {*value}
    return "pair" if pair else _source_kind(value)


def name_except(*reserved):
    """Return the type of a name that becomes a folder; `reserved` names are for other results."""

    def check(name):
        """Return a name; raise a ValueError if it is reserved."""
        if name in reserved:
            raise ValueError(f"'{name}' is reserved for other results; name it otherwise")
        return name

    return Annotated[Name, AfterValidator(check)]


def check_different(columns):
    """Return a list of columns; raise a ValueError if a column is named twice."""
    if len({*columns}) < len(columns):
        raise ValueError(f"{columns} names a column twice")
    return columns


def columns(count):
    """Return the type of a list of `count` columns."""
    limits = Field(min_length=count, max_length=count)
    return Annotated[list[Column], limits, AfterValidator(check_different)]


Text = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Position = Annotated[int, Field(strict=True, ge=0)]
Column = either(text=str, number=Position)
Name = Annotated[str, Field(pattern=NAME)]
Sha256 = Annotated[str, Field(pattern=SHA256, description="SHA-256 of the file, hexadecimal")]
Format = Annotated[
    Literal[FORMATS], Field(description="By the first bytes, else the name, if not given")
]
Positive = Annotated[float, Field(gt=0, strict=True, allow_inf_nan=False)]
Gravity = Annotated[Number, Field(ge=9.7, le=9.9)]
Rate = Annotated[Positive, Field(description="Hz; only where the log has no time column")]
Axis = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"],
    Field(description="Axis of the sensor that is turned about; -x is x backwards"),
]
Angle = Annotated[
    Number, Field(description="Angle of the turn, degrees, right-handed about the axis")
]


class OfEachSensor(Keys):
    """A column of each sensor's table.

    Attributes
    ----------
    acceleration
        Of the accelerometer's table.
    angular_rate
        Of the gyroscope's.
    """

    acceleration: Column
    angular_rate: Column


class Download(Keys):
    """A file that is not on this machine."""

    @classmethod
    def faults(cls, keys, context):
        """Yield the fault, if any, of the name that the file gets on this machine."""
        if None not in map(keys.get, cls.model_fields) and (text := path_fault(file_name(keys))):
            yield (), text


class Url(Download):
    """A file on the network, kept in the folder of downloads.

    Attributes
    ----------
    url
        Address of the file.
    """

    url: str = Field(pattern=URL)
    sha256: Sha256


class Wheel(Download):
    """A file inside a wheel of the package registry; unpacked, never imported.

    Attributes
    ----------
    wheel
        The package and its exact version, NAME==VERSION.
    member
        Path of the file inside the wheel.
    """

    wheel: str = Field(pattern=WHEEL)
    member: str = Field(pattern=MEMBER)
    sha256: Sha256


def existing(folder=False):
    """Return the type of a path to a file that exists, or a folder of files if `folder`.

    If a log is declared without a config, the validation has no context, and no path is checked.
    """

    def check(path, info):
        """Return a path; raise a ValueError if it has a fault."""
        if info.context and (text := file_fault(path, info.context["replicas"], folder)):
            raise ValueError(text)
        return path

    return Annotated[Text, AfterValidator(check)]


Source = either(_source_kind, text=existing(), url=Url, wheel=Wheel)
LogPath = existing(folder=True)
LogSource = either(_source_kind, text=LogPath, url=Url, wheel=Wheel)


class Pair(Keys):
    """A file of each sensor, each on its own clock.

    Attributes
    ----------
    acceleration
        Of the accelerometer; as file.
    angular_rate
        Of the gyroscope.
    """

    acceleration: LogSource
    angular_rate: LogSource

    @classmethod
    def faults(cls, keys, context):
        """Yield a fault if both sensors have the same file."""
        one, other = map(keys.get, SENSORS)
        if one is not None and one == other:
            name = one if isinstance(one, str) else file_name(one)
            yield (), f"{name} is given for both sensors; each has its own file"


class Columns(Keys):
    """Columns of the log where they do not have the usual names.

    Attributes
    ----------
    time
        Stamps: a column, [sec, nsec] or [sec, usec], or one of each sensor's table; null for
        none.
    acceleration
        x, y, z by name or, without header, by number from 0; or one stream that holds all three;
        null for a log without this sensor.
    angular_rate
        The same.
    temperature
        A column; null for none.
    interval
        Interval of increments, as time; null for the steps of the stamps.
    """

    time: either(list=columns(2), text=str, number=Position, mapping=OfEachSensor, null=None) = None
    acceleration: either(list=columns(3), text=Text, null=None) = None
    angular_rate: either(list=columns(3), text=Text, null=None) = None
    temperature: either(text=str, number=Position, null=None) = None
    interval: either(text=str, number=Position, mapping=OfEachSensor, null=None) = None


class Units(Keys):
    """Units of the log.

    Attributes
    ----------
    time
        Of the stamps.
    acceleration
        count needs nominal or sensor; m/s, mm/s are increments.
    angular_rate
        count needs nominal or sensor; rad, mrad, deg are increments.
    temperature
        Of the temperature.
    interval
        Of the interval.
    """

    time: Literal[*UNITS["time"], "ISO 8601"] = "s"
    acceleration: Literal[UNITS["acceleration"]] = "m/s^2"
    angular_rate: Literal[UNITS["angular_rate"]] = "rad/s"
    temperature: Literal[UNITS["temperature"]] = "degC"
    interval: Literal[UNITS["interval"]] = "s"


class Marks(Keys):
    """1PPS marks, which make the log's time, a local counter, GNSS time.

    Attributes
    ----------
    file
        A text table; without it, columns of the log.
    counter
        Local counter at the mark, units.time; of a file its first column.
    time
        GNSS time of the mark, whole s or ISO 8601; of a file its second column.
    """

    file: Source = None
    counter: Column = None
    time: Column = None

    @classmethod
    def faults(cls, keys, context):
        """Yield a fault if only one of the two columns of marks in the log is given."""
        columns = {"counter", "time"}
        for key in columns - {*keys} if keys and {*keys} < columns else ():
            yield (key,), "missing; marks are two columns of the log, or a file"


class ReferenceColumns(Keys):
    """Columns of a reference.

    Attributes
    ----------
    orientation
        The quaternion, w, x, y, z.
    position
        The place, x, y, z.
    time
        Its stamps.
    """

    orientation: columns(4)
    position: columns(3) = None
    time: Column = None


class ReferenceUnits(Keys):
    """Units of a reference.

    Attributes
    ----------
    time
        Of its stamps.
    position
        Of the place.
    """

    time: Literal[*UNITS["time"], "ISO 8601"] = "s"
    position: Literal["m", "cm", "mm"] = "m"


class Reference(Keys):
    """Attitude and place by motion capture or a robot, for a reference_motion.

    Attributes
    ----------
    file
        Without it, it is in the log.
    format
        Of its file.
    rate
        Hz; only without time.
    convention
        What the quaternion takes to what.
    """

    file: Source = None
    format: Literal["csv", "tsv", "parquet", "matlab"] = None
    rate: Positive = None
    columns: ReferenceColumns
    units: ReferenceUnits = None
    convention: Literal["body_to_world", "world_to_body"]


class Section(Keys):
    """One of several turns of a known_rotation.

    Attributes
    ----------
    rate
        Or the rate of a turntable about the axis, deg/s.
    start
        s from the log's first sample.
    end
        s from the log's first sample.
    """

    axis: Axis
    angle: Angle = None
    rate: Number = None
    start: Number
    end: Number

    @classmethod
    def faults(cls, keys, context):
        """Yield a fault if neither the angle nor the rate is given."""
        if not {"angle", "rate"} & {*keys}:
            yield ("angle",), "missing; give an angle or a rate"


def _check_time_range(limits):
    """Return the limits of a time range; raise a ValueError if the start is not before the end."""
    times = [datetime.fromisoformat(x) if isinstance(x, str) else x for x in limits]
    try:
        if None not in times and times[0] >= times[1]:
            raise ValueError("the start is not before the end")
    except TypeError as error:
        raise ValueError("start and end are not both seconds, or times with a zone") from error
    return limits


TimeRange = Annotated[
    list[either(number=Number, text=str, null=None)],
    Field(min_length=2, max_length=2),
    AfterValidator(_check_time_range),
]


class Session(Keys):
    """One log.

    Attributes
    ----------
    kind
        What was done with the device.
    file
        A path, in a storage too (s3://bucket/key), or a pattern (logs/*.csv) or folder of logs,
        each a session named by its file.
    time_range
        [start, end), s from the first sample, or ISO 8601 where stamps are dates; null leaves a
        side open.
    sections
        Several turns, instead of axis and angle.
    """

    kind: Literal["static", "six_position", "multi_position", "known_rotation", "reference_motion"]
    file: either(_file_kind, text=LogPath, url=Url, wheel=Wheel, pair=Pair)
    format: Format = None
    columns: Columns = None
    units: Units = None
    rate: Rate = None
    time_range: TimeRange = None
    pps: Marks = None
    reference: Reference = None
    axis: Axis = None
    angle: Angle = None
    sections: Annotated[list[Section], Field(min_length=1, max_length=1000)] = None

    @classmethod
    def faults(cls, keys, context):
        """Yield each key that the kind of session needs, and a reference that it cannot have."""
        needed = ()
        if keys.get("kind") == "reference_motion":
            needed = ("reference",)
        elif keys.get("kind") == "known_rotation" and "sections" not in keys:
            needed = ("axis", "angle")
        for key in needed:
            if key not in keys:
                yield (key,), f"missing; a session of kind {keys['kind']} needs it"
        if "reference" in keys and keys.get("kind") not in (None, "reference_motion"):
            yield ("reference",), "only a session of kind reference_motion has one"


class Place(Keys):
    """Place for which gravity is computed.

    Attributes
    ----------
    latitude
        Geodetic, degrees.
    height
        Above the ellipsoid, m.
    """

    latitude: Number = Field(ge=-90, le=90)
    height: Number = Field(ge=-1000, le=20000)


class FullScale(Keys):
    """Largest values; clipped samples are left out, and counted.

    Attributes
    ----------
    acceleration
        m/s^2.
    angular_rate
        rad/s.
    """

    acceleration: Positive = None
    angular_rate: Positive = None


class Tolerance(Keys):
    """Standard deviations of the prior.

    Attributes
    ----------
    misalignment
        rad.
    scale_factor
        As a share.
    bias
        m/s^2 or rad/s.
    """

    misalignment: Positive = Field(None, le=LARGEST.misalignment)
    scale_factor: Positive = Field(None, le=LARGEST.scale_factor)
    bias: Positive = Field(None, le=LARGEST.bias)


class Count(Keys):
    """SI = (raw - offset) * scale.

    Attributes
    ----------
    scale
        m/s^2 or rad/s per count.
    offset
        Raw value that is zero.
    """

    scale: Number = Field(None, ge=SCALE_OF_COUNTS[0], le=SCALE_OF_COUNTS[1])
    offset: Number = Field(0.0, ge=-MOST_COUNT_OFFSET, le=MOST_COUNT_OFFSET)
    tolerance: Tolerance = None


def _check_sensor(name):
    """Return the name of a sensor; raise a ValueError if the table has no such sensor."""
    try:
        find_sensor(name)
    except ImuloopError as error:
        raise ValueError(str(error)) from error
    return name


FullScaleName = either(text=Text, number=Positive)


class Range(Keys):
    """Range of the sensor, where it has several.

    Attributes
    ----------
    acceleration
        Such as 16 g.
    angular_rate
        Such as 2000 deg/s.
    """

    acceleration: FullScaleName = None
    angular_rate: FullScaleName = None


class Nominal(Keys):
    """Scales and tolerances, before the named sensor's."""

    acceleration: Count = None
    angular_rate: Count = None


class Device(Keys):
    """One device; `columns`, `units`, `format` and `rate` are of all its logs.

    Attributes
    ----------
    label
        Name shown in the report; the device's name if not given.
    type
        Name of its type; three or more of a type are compared.
    prior
        In place of the data sheet: an earlier calibration.json of the device, or a family.json of
        its type.
    gravity
        Local gravity, m/s^2, or computed for a place.
    sensor
        Name; `imuloop sensors` lists them.
    sessions
        Logs by name, but not exports; any number of each kind.
    """

    label: Annotated[Text, Field(max_length=200)] = None
    type: Name = None
    prior: Annotated[existing(), Field(max_length=1000)] = None
    gravity: either(number=Annotated[Number, Field(ge=9.7, le=9.9)], mapping=Place) = (
        STANDARD_GRAVITY
    )
    full_scale: FullScale = None
    sensor: Annotated[Text, AfterValidator(_check_sensor)] = None
    range: Range = None
    nominal: Nominal = None
    format: Format = None
    columns: Columns = None
    units: Units = None
    rate: Rate = None
    sessions: Annotated[dict[name_except("exports"), Session], Field(min_length=1)]
    segment: SegmentSettings = None
    noise: NoiseSettings = None
    calibrate: CalibrateSettings = None
    diagnose: DiagnoseSettings = None

    @classmethod
    def faults(cls, keys, context):
        """Yield the faults of the ranges and of the scales of counts."""
        sensor, nominal, sound = keys.get("sensor"), keys.get("nominal") or {}, True
        for quantity, name in (keys.get("range") or {}).items():
            try:
                if "sensor" not in keys:
                    raise ImuloopError("needs the device's sensor")
                if sensor:
                    find_sensor(sensor).choose_range(quantity, name)
            except ImuloopError as error:
                sound = False
                yield ("range", quantity), str(error)
        for quantity, counts in nominal.items():
            if "sensor" not in keys and "offset" in counts and "scale" not in counts:
                sound = False
                yield ("nominal", quantity, "scale"), "missing; offset needs it"
        # without the scales of counts it is unknown which units need them
        if not sound or None in (keys.get(key, 0) for key in ("sensor", "range", "nominal")):
            return
        scales = known_figures(keys)["nominal"]
        for name, session in (keys.get("sessions") or {}).items():
            for quantity in PARTS:
                stated = scales.get(quantity, {})
                unit = session.get("units", {}).get(quantity)
                if unit == "count" and "scale" not in stated:
                    text = f"'count' needs the device's {needed_by_counts(quantity, stated)}"
                    yield ("sessions", name, "units", quantity), text


class Config(Keys):
    """Devices, their sessions and the settings of the stages.

    Attributes
    ----------
    devices
        Devices by name, but not figures or types.
    defaults
        Any key of a device, which overrides it, merged key by key.
    cache
        Folder for downloads.
    mirror
        Folder searched for a file before the network; the environment variable IMULOOP_MIRROR
        goes first.
    """

    devices: Annotated[dict[name_except("figures", "types"), Device], Field(min_length=1)]
    defaults: dict = None
    cache: Text = "data/cache"
    mirror: Text = None

    @classmethod
    def faults(cls, keys, context):
        """Yield the faults of the folders."""
        mirror, cache = keys.get("mirror") or "", keys.get("cache") or ""
        if mirror and not os.path.isdir(mirror):
            yield ("mirror",), f"there is no folder {mirror}"
        if text := path_fault(cache):
            yield ("cache",), text
        elif os.path.exists(cache) and not os.path.isdir(cache):
            yield ("cache",), f"{cache} is a file, not a folder"
