"""The keys of a session in a config: its file, columns, units and what was done."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from imuloop.config_files import LogPath, Pair, Source, Url, Wheel, source_kind
from imuloop.config_keys import Keys, Number, Positive, Text, either
from imuloop.ingest.spellings import UNITS

# names of the log formats; their readers, in imuloop.ingest.formats, take long to import
FORMATS = ("csv", "tsv", "euroc", "imu_tk", "jsonl", "parquet", "feather", "numpy", "netcdf")
FORMATS += ("matlab", "ros", "phone", "ulog", "dataflash")


def check_different(columns):
    """Return a list of columns, `columns`; raise a ValueError if a column is named twice."""
    if len({*columns}) < len(columns):
        raise ValueError(f"{columns} names a column twice")
    return columns


def columns(count):
    """Return the pydantic type of a list of `count` different columns of a log."""
    limits = Field(min_length=count, max_length=count)
    return Annotated[list[Column], limits, AfterValidator(check_different)]


Position = Annotated[int, Field(strict=True, ge=0)]
Column = either(text=str, number=Position)
Format = Annotated[
    Literal[FORMATS], Field(description="By the first bytes, else the name, if not given")
]
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
        """Yield (path, text) if only one of the two columns of marks in the log is given.

        The path is a tuple of keys that lead to the fault. `keys` are the keys of ``pps`` as
        written; `context` is not used.
        """
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
        """Yield (path, text) if neither the angle nor the rate of the turn is given.

        The path is a tuple of keys that lead to the fault. `keys` are the keys of the section as
        written; `context` is not used.
        """
        if not {"angle", "rate"} & {*keys}:
            yield ("angle",), "missing; give an angle or a rate"


def _check_time_range(limits):
    """Return a time range, `limits`; raise a ValueError if its start is not before its end.

    `limits` is a list of start and end: seconds, texts in ISO 8601, or None for an open side.
    """
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


# keys that a kind of session needs
NEEDED = {"reference_motion": ("reference",), "known_rotation": ("axis", "angle")}


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
    file: either(source_kind, text=LogPath, url=Url, wheel=Wheel, pair=Pair)
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
        """Yield (path, text) for each key that this kind of session lacks, or cannot have.

        The path is a tuple of keys that lead to the fault. `keys` are the keys of the session as
        written; `context` is not used.
        """
        kind = keys.get("kind")
        instead = {"axis", "angle"} if "sections" in keys else {*()}
        for key in {*NEEDED.get(kind, ())} - {*keys} - instead:
            yield (key,), f"missing; a session of kind {kind} needs it"
        if "reference" in keys and kind not in (None, "reference_motion"):
            yield ("reference",), "only a session of kind reference_motion has one"
