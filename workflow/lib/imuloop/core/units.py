"""Units of logs and configs; everything inside the library is SI."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.errors import ImuloopError

# standard gravity, m/s^2: the unit g of data sheets, not the local gravity
STANDARD_GRAVITY = 9.80665
# one degree, rad
DEGREE = np.pi / 180
# angular rate of the Earth, rad/s, WGS 84
EARTH_RATE = 7.292115e-5
# one hour, s
HOUR = 3600.0
# 0 degC, K
ZERO_CELSIUS = 273.15

# limits of the scale of counts, SI per count, and of their offset, counts
SCALE_OF_COUNTS = (1e-12, 1e5)
MOST_COUNT_OFFSET = 1e12

# factor from each unit to SI
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": HOUR}
ACCELERATION = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY * 1e-3}
ACCELERATION |= {"cm/s^2": 0.01, "ft/s^2": 0.3048}
ANGULAR_RATE = {"rad/s": 1.0, "deg/s": DEGREE, "mrad/s": 1e-3, "deg/h": DEGREE / HOUR}
ANGULAR_RATE |= {"rpm": 2 * np.pi / 60}
# factor from increments to the unit that they have per second
INCREMENTS = {
    "acceleration": {"m/s": 1.0, "mm/s": 1e-3},
    "angular_rate": {"rad": 1.0, "mrad": 1e-3, "deg": DEGREE},
}
# degC per unit, and the value in the unit at 0 degC
TEMPERATURE = {"degC": (1.0, 0.0), "K": (1.0, ZERO_CELSIUS), "degF": (5 / 9, 32.0)}

FACTORS = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}
_SI = {"acceleration": "m/s^2", "angular_rate": "rad/s"}


@dataclass(frozen=True)
class RawUnit:
    """The unit in which a sensor was logged: ``SI = (raw - offset) * scale``.

    The scale is in SI units per raw unit, the offset in raw units, 0 except for counts.
    """

    name: str
    scale: float
    offset: float = 0.0

    def to_si(self, raw):
        """Return `raw`, values in this unit, converted to SI: ``(raw - offset) * scale``."""
        return (np.asarray(raw, dtype=float) - self.offset) * self.scale

    def from_si(self, value):
        """Return `value`, values in SI, converted to this unit: ``value / scale + offset``."""
        return np.asarray(value, dtype=float) / self.scale + self.offset


def needed_by_counts(quantity, nominal=None):
    """Return the config keys that counts need for their scale, a text for a message.

    `quantity` is ``acceleration`` or ``angular_rate``. `nominal` is a dict of nominal figures of
    the sensor; if it has ``ranges``, the names of its measuring ranges, the text lists them.
    """
    if ranges := (nominal or {}).get("ranges"):
        return f"range.{quantity}, one of {', '.join(ranges)}"
    return f"nominal.{quantity}.scale (increments: × rate), or the name of the sensor and its range"


def raw_unit(quantity, name, nominal=None):
    """Return the RawUnit, the unit of logged values, with a name such as ``deg/s``.

    Ingest converts increments, such as ``deg``, to rates, so their unit is the SI unit of the rate.
    Raises an ImuloopError for an unknown unit, or for counts without a scale.

    Parameters
    ----------
    quantity : str
        ``acceleration`` or ``angular_rate``.
    name : str
        Name of the unit in the config.
    nominal : dict, optional
        ``scale`` of counts, SI per count, and their ``offset``, counts, 0 by default. Other units
        do not need it.
    """
    if name == "count":
        if "scale" not in (nominal or {}):
            raise ImuloopError(f"{quantity} in counts needs {needed_by_counts(quantity, nominal)}")
        return RawUnit("count", float(nominal["scale"]), float(nominal.get("offset", 0.0)))
    if name in INCREMENTS[quantity]:
        return RawUnit(_SI[quantity], 1.0)
    if name not in FACTORS[quantity]:
        names = ", ".join([*FACTORS[quantity], "count", *INCREMENTS[quantity]])
        raise ImuloopError(f"'{name}' is not a unit of {quantity}; use one of {names}")
    return RawUnit(name, FACTORS[quantity][name])
