"""The keys of a config: types, limits, units and meaning.

These models check a config; ``workflow/schemas/config.schema.yaml`` and ``docs/settings.md`` are
made from them. The settings of a stage are in its ``settings.py``.
"""

import os
from typing import Annotated

from pydantic import AfterValidator, Field

from imuloop.calibrate.settings import CalibrateSettings
from imuloop.config_files import existing
from imuloop.config_keys import Keys, Number, Positive, Text, either
from imuloop.config_session import Columns, Format, Rate, Session, Units
from imuloop.core.errors import ImuloopError
from imuloop.core.units import (
    MOST_COUNT_OFFSET,
    SCALE_OF_COUNTS,
    STANDARD_GRAVITY,
    needed_by_counts,
)
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.file_faults import path_fault
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.settings import SegmentSettings
from imuloop.sensors import LARGEST, PARTS, device_figures, find_sensor

# pattern of a name that becomes a folder
NAME = "^[A-Za-z][A-Za-z0-9_-]{0,63}$"


def name_except(*reserved):
    """Return the pydantic type of a name that becomes a folder, except the reserved names.

    The names `reserved` are for other results in the same folder.
    """

    def check(name):
        """Return a name; raise a ValueError if it is reserved."""
        if name in reserved:
            raise ValueError(f"'{name}' is reserved for other results; name it otherwise")
        return name

    return Annotated[Name, AfterValidator(check)]


Name = Annotated[str, Field(pattern=NAME)]
Gravity = Annotated[Number, Field(ge=9.7, le=9.9)]


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
    """Return the name of a sensor; raise a ValueError if no data sheet for it is known."""
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
    gravity: either(number=Gravity, mapping=Place) = STANDARD_GRAVITY
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
        """Yield (path, text) for each wrong range, and for each session in counts without a scale.

        The path is a tuple of keys that lead to the fault. `keys` are the keys of the device as
        written; `context` is not used.
        """
        sensor, ranges = keys.get("sensor", ""), keys.get("range", {})
        nominal = keys.get("nominal", {})
        if None in (sensor, ranges, nominal):
            return
        wrong = {}
        for quantity, name in ranges.items():
            try:
                device_figures(sensor, {quantity: name})
            except ImuloopError as error:
                wrong[quantity] = str(error)
        yield from ((("range", quantity), text) for quantity, text in wrong.items())
        # with a wrong range it is unknown which units need a scale
        scales = {} if wrong else device_figures(sensor, ranges, nominal)["nominal"]
        sessions = {} if wrong else keys.get("sessions") or {}
        for name, session in sessions.items():
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
        """Yield (path, text) for each fault of the folders `mirror` and `cache`.

        The path is a tuple of keys that lead to the fault. `keys` are the keys of the config as
        written; `context` is not used.
        """
        mirror, cache = keys.get("mirror") or "", keys.get("cache") or ""
        if mirror and not os.path.isdir(mirror):
            yield ("mirror",), f"there is no folder {mirror}"
        if text := path_fault(cache):
            yield ("cache",), text
        elif os.path.exists(cache) and not os.path.isdir(cache):
            yield ("cache",), f"{cache} is a file, not a folder"
