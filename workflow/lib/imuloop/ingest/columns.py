"""Which columns of a log hold what: declared by name or number, else by the usual names."""

import re
from dataclasses import dataclass, field

from imuloop.core.errors import ImuloopError, did_you_mean

AXES = ("x", "y", "z")
# usual names of a sensor's columns without their axis, words joined by "_"
ACCELERATION_NAMES = (
    "a acc accel accelero accelerometer acceleration accelerometer_acceleration"
    " specific_force linear_acceleration a_rs_s"
).split()
ANGULAR_RATE_NAMES = (
    "g gyr gyro gyros gyroscope w omega angular_rate angular_velocity angular_speed rotation_rate"
    " gyro_rotation gyro_rotation_rate gyroscope_rotation motion_rotation_rate w_rs_s"
).split()
# the first of these that a log has is its time
TIME_NAMES = (
    "t time timestamp time_stamp stamp timestamps times sensor_time header_stamp utc time_utc"
    " timestamp_utc utc_time datetime date_time epoch unix_time unix_timestamp seconds_elapsed"
    " elapsed elapsed_time"
).split()
TEMPERATURE_NAMES = "temperature temp tmp temperature_imu chip_temperature".split()
# most names in a message
_SHOWN = 60
# words that say where, not what
_PLACE = {"imu", "raw", "sensor", "field", "data"}

# spellings that files use for the units of the contract, lower case without blanks, dots, carets
_SPELLINGS = {
    "time": {
        "s": "s sec secs second seconds",
        "ms": "ms msec millisecond milliseconds",
        "us": "us usec microsecond microseconds",
        "ns": "ns nsec nanosecond nanoseconds",
    },
    "acceleration": {
        "m/s^2": "m/s^2 m/s2 m/s/s ms-2 ms2 mps2 m/sec2",
        "g": "g gs",
        "mg": "mg milli-g",
        "count": "count counts lsb adc",
    },
    "angular_rate": {
        "rad/s": "rad/s rad/sec rads-1 rads radps",
        "deg/s": "deg/s deg/sec degree/s degrees/s degs-1 degs dps",
        "mrad/s": "mrad/s mrads-1 mrads",
        "deg/h": "deg/h deg/hr degree/h degrees/h",
        "count": "count counts lsb adc",
    },
    "temperature": {"degC": "degc c celsius degreescelsius degreecelsius", "K": "k kelvin"},
}
_UNITS = {
    quantity: {word: unit for unit, words in spellings.items() for word in words.split()}
    for quantity, spellings in _SPELLINGS.items()
}


@dataclass(frozen=True)
class Columns:
    """Positions of the columns of each quantity, from 0; None where there is none.

    `units` holds the units that the columns' own names state.
    """

    acceleration: tuple[int, int, int]
    angular_rate: tuple[int, int, int]
    time: int | None = None
    temperature: int | None = None
    units: dict = field(default_factory=dict)

    def positions(self):
        """Return positions in the order of the raw columns: six axes, time, temperature."""
        rest = [i for i in (self.time, self.temperature) if i is not None]
        return [*self.acceleration, *self.angular_rate, *rest]

    def found(self, names):
        """Return quantity -> names of its columns."""
        given = {
            "time": self.time,
            "acceleration": self.acceleration,
            "angular_rate": self.angular_rate,
            "temperature": self.temperature,
        }
        return {
            quantity: [names[i] for i in where] if isinstance(where, tuple) else names[where]
            for quantity, where in given.items()
            if where is not None
        }


def stated_unit(quantity, text):
    """Return the contract's name of a unit as a file spells it, or None.

    Examples
    --------
    >>> stated_unit("acceleration", "m s^-2")
    'm/s^2'
    """
    plain = re.sub(r"[\s^*·._{}\\]", "", str(text).lower().replace("²", "2"))
    plain = re.sub("[µμ]", "u", plain).replace("°", "deg")
    return _UNITS[quantity].get(plain)


def resolve(names, declared=None, headed=True):
    """Return which columns hold time, acceleration, angular rate and temperature.

    Parameters
    ----------
    names : list of str
        Names of all columns, in order.
    declared : dict, optional
        Quantity to column name or number (from 0), three of them for a sensor. A quantity that
        is left out is found by its usual name; one that is None is taken as not logged.
    headed : bool
        Whether the names are the log's own; without, columns must be declared by number.

    Raises
    ------
    ImuloopError
        If a declared column is not there, or a sensor's three are not found or not unique.
    """
    declared = dict(declared or {})
    guessed = guess(names) if headed else {}
    units = {}
    chosen = {}
    for quantity in ("time", "acceleration", "angular_rate", "temperature"):
        if quantity in declared:
            chosen[quantity] = _declared(quantity, declared[quantity], names, headed)
        elif len(guessed.get(quantity, ())) > 1 and quantity in ("acceleration", "angular_rate"):
            both = " and ".join("/".join(names[i] for i in t) for t, _ in guessed[quantity][:2])
            raise ImuloopError(
                f"{both} both look like {quantity}; name one of them in columns.{quantity}"
            )
        elif guessed.get(quantity):
            chosen[quantity], _ = guessed[quantity][0]
        unit = _unit_of(quantity, chosen.get(quantity), names) if headed else None
        if unit:
            units[quantity] = unit
    for quantity in ("acceleration", "angular_rate"):
        if chosen.get(quantity) is None:
            listed = _listed(names) if headed else f"no header, {len(names)} columns"
            how = "by name" if headed else "by number from 0"
            raise ImuloopError(
                f"no columns of {quantity} found ({listed}); name its x, y, z {how} in "
                f"columns.{quantity}"
            )
    return Columns(**chosen, units=units)


def _declared(quantity, value, names, headed):
    """Return the position(s) of a declared column or three of them."""
    if value is None and quantity in ("time", "temperature"):
        return None
    if quantity in ("time", "temperature"):
        return _position(quantity, value, names, headed)
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise ImuloopError(f"columns.{quantity}: {value!r} is not a list of three columns x, y, z")
    return tuple(_position(quantity, item, names, headed) for item in value)


def _position(quantity, value, names, headed):
    if isinstance(value, int) and not isinstance(value, bool):
        if not 0 <= value < len(names):
            raise ImuloopError(
                f"columns.{quantity}: there is no column {value}; the log has {len(names)}, "
                f"numbered from 0 to {len(names) - 1}"
            )
        return value
    if not headed:
        raise ImuloopError(
            f"columns.{quantity}: the log has no header, so {value!r} cannot be found; "
            f"name columns by number, from 0 to {len(names) - 1}"
        )
    value = str(value)
    if names.count(value) > 1:
        raise ImuloopError(
            f"columns.{quantity}: {names.count(value)} columns are named '{value}'; "
            "name it by number, from 0"
        )
    if value not in names:
        raise ImuloopError(
            f"columns.{quantity}: no column '{value}'; there are {_listed(names)}"
            f"{did_you_mean(value, names, 0.5)}"
        )
    return names.index(value)


def _listed(names):
    """Return names as a message shows them: a file can have very many."""
    shown = ", ".join(name[:80] for name in names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"


def guess(names):
    """Return quantity -> [(position or three positions, name without axis)], best first."""
    sensors = {"acceleration": {}, "angular_rate": {}}
    single = {"time": [], "temperature": []}
    for position, name in enumerate(names):
        words = _words(name)
        stem, axis = _stem_and_axis(words)
        for quantity, usual in (
            ("acceleration", ACCELERATION_NAMES),
            ("angular_rate", ANGULAR_RATE_NAMES),
        ):
            if axis and stem in usual:
                sensors[quantity].setdefault(stem, {}).setdefault(axis, position)
        for quantity, usual in (("time", TIME_NAMES), ("temperature", TEMPERATURE_NAMES)):
            joined, shorter = "_".join(words), "_".join(words[:-1])
            if joined in usual:
                single[quantity].append((usual.index(joined), position, joined))
            elif shorter in usual and words[-1] in _UNITS[quantity]:
                single[quantity].append((usual.index(shorter), position, shorter))
    guess = {
        quantity: [
            (tuple(axes[axis] for axis in AXES), stem)
            for stem, axes in stems.items()
            if len(axes) == 3
        ]
        for quantity, stems in sensors.items()
    }
    for quantity, found in single.items():
        guess[quantity] = [(position, stem) for _, position, stem in sorted(found)]
    return guess


def _words(name):
    """Return the lower-case words of a column's name, its unit in brackets left out."""
    bare = re.sub(r"[(\[{].*?[)\]}]", " ", name)
    # accX, gyroRotationX
    bare = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", bare)
    words = re.findall(r"[^\W_]+", bare.lower())
    return [word for word in words if word not in _PLACE]


def _stem_and_axis(words):
    """Return ('acc', 'x') of ['acc', 'x'], ['accx'], ['x', 'acc'] or ['acc', 'x', 'mps2']."""
    known = {*ACCELERATION_NAMES, *ANGULAR_RATE_NAMES}
    if len(words) > 1 and words[-1] not in AXES and words[-2] in AXES:
        words = words[:-1]
    if len(words) > 1 and words[-1] in AXES:
        return "_".join(words[:-1]), words[-1]
    if len(words) > 1 and words[0] in AXES:
        return "_".join(words[1:]), words[0]
    word = words[0] if words else ""
    if word[-1:] in AXES and word[:-1] in known:
        return word[:-1], word[-1]
    if word[:1] in AXES and word[1:] in known:
        return word[1:], word[0]
    return "", None


def _unit_of(quantity, where, names):
    """Return the unit that a column's name states: 'ax [g]', 'time_us'."""
    if where is None:
        return None
    name = names[where[0] if isinstance(where, tuple) else where]
    bracket = re.search(r"[(\[{](.*?)[)\]}]\s*$", name)
    if bracket:
        return stated_unit(quantity, bracket.group(1))
    words = _words(name)
    # one letter after the name is too little to go by, except for a time
    if len(words) > 1 and (len(words[-1]) > 1 or quantity == "time"):
        return stated_unit(quantity, words[-1])
    return None
