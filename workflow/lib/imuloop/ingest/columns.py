"""Which columns of a log hold what: declared by name or number, else by the usual names."""

import re
from dataclasses import dataclass, field
from itertools import islice, product

from imuloop.core.errors import ImuloopError, did_you_mean
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.core.units import ACCELERATION, ANGULAR_RATE, INCREMENTS, TIME
from imuloop.core.units import TEMPERATURE as DEGREES

AXES = ("x", "y", "z")
# name of the stamps in raw batches; absent where the log has no time column
STAMP = "stamp"
# name there of the own stamps of a sensor with a slower clock
HELD = "held"
# usual names of a sensor's columns without their axis, words joined by "_": of the quantity itself,
# and of its increments over the interval that ends at the stamp
_SENSORS = {
    "acceleration": (
        "a acc accel accelero accelerometer acceleration accelerometer_acceleration specific_force"
        " linear_acceleration a_rs_s".split(),
        "dv dvel delta_v delta_vel delta_velocity velocity_increment vel_inc velinc".split(),
    ),
    "angular_rate": (
        "g gyr gyro gyros gyroscope w omega angular_rate angular_velocity angular_speed"
        " rotation_rate gyro_rotation gyro_rotation_rate gyroscope_rotation motion_rotation_rate"
        " w_rs_s".split(),
        "da dang dth dtheta delta_a delta_ang delta_angle delta_th delta_theta angle_increment"
        " angular_increment".split(),
    ),
}
_KNOWN = {name for pair in _SENSORS.values() for usual in pair for name in usual}
# of several the first is taken, a message's own stamp before its receipt; the interval is that of
# increments, that of one sensor alone ends in its name and _dt
_SINGLE = {
    "time": "header_stamp t time timestamp time_stamp stamp timestamps times sensor_time utc"
    " time_utc timestamp_utc utc_time datetime date_time epoch unix_time unix_timestamp"
    " seconds_elapsed elapsed elapsed_time millis micros".split(),
    "temperature": "temperature temp tmp temperature_imu chip_temperature".split(),
    "interval": "dt delta_t delta_time interval sample_interval sampling_interval sample_period"
    " integration_time integration_interval".split(),
}
_QUANTITIES = ("time", "acceleration", "angular_rate", "temperature")
# most names in a message
_SHOWN = 60
# words that say where, not what
_PLACE = {"imu", "raw", "sensor", "field", "data"}

# spellings that files use for the units of the contract, lower case without blanks, dots, carets;
# units that are none of the contract's are named, never taken for one
_SPELLINGS = {
    "time": {
        "min": "min mins minute minutes",
        "h": "h hr hrs hour hours",
        "s": "s sec secs second seconds",
        "ms": "ms msec millis millisecond milliseconds",
        "us": "us usec micros microsecond microseconds",
        "ns": "ns nsec nanosecond nanoseconds",
    },
    "acceleration": {
        "m/s^2": "m/s^2 m/s2 m/s/s ms-2 ms2 mps2 m/sec2",
        "g": "g gs g0",
        "mg": "mg milli-g",
        "count": "count counts lsb adc raw",
        "cm/s^2": "cm/s^2 cm/s2 cms-2 cms2 gal",
        "ft/s^2": "ft/s^2 ft/s2 fts-2 fts2",
        "m/s": "m/s m/sec mps ms-1",
        "mm/s": "mm/s mm/sec mmps mms-1",
    },
    "angular_rate": {
        "rad/s": "rad/s rad/sec radians/s rads-1 rads radps",
        "deg/s": "deg/s deg/sec degree/s degrees/s degs-1 degs dps",
        "mrad/s": "mrad/s mrad/sec mrads-1 mrads",
        "deg/h": "deg/h deg/hr degree/h degrees/h dph",
        "count": "count counts lsb adc raw",
        "rpm": "rpm rev/min r/min",
        "rad": "rad radian radians",
        "mrad": "mrad milliradian milliradians",
        "deg": "deg degree degrees",
    },
    "temperature": {
        "degC": "degc c celsius degreescelsius degreecelsius",
        "K": "k kelvin",
        "degF": "degf f fahrenheit degreesfahrenheit degreefahrenheit",
    },
}
_UNITS = {
    quantity: {word: unit for unit, words in spellings.items() for word in words.split()}
    for quantity, spellings in _SPELLINGS.items()
}
_UNITS["interval"] = _UNITS["time"]
# units that are read, the first where neither the config nor the log says; count needs nominal
UNITS = {
    "time": (*TIME,),
    "acceleration": (*ACCELERATION, "count", *INCREMENTS["acceleration"]),
    "angular_rate": (*ANGULAR_RATE, "count", *INCREMENTS["angular_rate"]),
    "temperature": (*DEGREES,),
    "interval": (*TIME,),
}


@dataclass(frozen=True)
class Columns:
    """Positions of the columns of each quantity, from 0; None where there is none.

    `others` holds further raw columns, of numbers or stamps: ``interval.SENSOR``, the interval of
    a sensor's increments, and ``pps.counter``, ``pps.time``. `increments` holds the sensors whose
    columns' names say that they are logged as such, `units` the units that the names state.
    """

    acceleration: tuple[int, int, int]
    angular_rate: tuple[int, int, int]
    time: int | None = None
    temperature: int | None = None
    others: dict = field(default_factory=dict)
    increments: frozenset = frozenset()
    units: dict = field(default_factory=dict)

    def keys(self):
        """Return the names of the raw columns: those that are stamps, six axes, temperature."""
        stamps = [] if self.time is None else [STAMP]
        warm = [] if self.temperature is None else [TEMPERATURE]
        return [*stamps, *self.others, *CHANNELS, *warm]

    def positions(self):
        """Return the positions of the raw columns, in the order of `keys`."""
        axes = *self.others.values(), *self.acceleration, *self.angular_rate
        return [i for i in (self.time, *axes, self.temperature) if i is not None]

    def stated(self, quantity, text):
        """Return the contract's name of a unit as the log spells it, or None."""
        return stated_unit(quantity, text, quantity in self.increments)

    def found(self, names):
        """Return quantity -> names of its columns."""
        given = {quantity: getattr(self, quantity) for quantity in _QUANTITIES}
        for name, at in self.others.items():
            quantity = name.partition(".")[0]
            given[quantity] = tuple(dict.fromkeys((*given.get(quantity, ()), at)))
        return {
            quantity: [names[i] for i in where] if isinstance(where, tuple) else names[where]
            for quantity, where in given.items()
            if where is not None
        }


def stated_unit(quantity, text, increments=False):
    """Return the contract's name of a unit as a file spells it, m/s^2 of "m s^-2", or None.

    Who writes `deg` beside a rate means deg/s: an angle counts as an increment only where
    `increments`.
    """
    plain = re.sub(r"[\s^*·._{}()\\]", "", str(text).lower().replace("²", "2"))
    plain = re.sub("[µμ]", "u", plain).replace("°", "deg")
    unit = _UNITS[quantity].get(plain)
    summed = unit in INCREMENTS.get(quantity, ())
    if summed and not increments:
        return f"{unit}/s" if f"{unit}/s" in _UNITS[quantity] else None
    return unit if increments == summed else None


def unknown_unit(quantity, text):
    """Return the error of a log that states a unit that is not known."""
    return ImuloopError(
        f"units.{quantity}: the log says '{text[:80]}', which is no unit that is read; declare "
        f"the right one of {', '.join(UNITS[quantity])}"
    )


def resolve(names, declared=None, headed=True):
    """Return which columns hold time, acceleration, angular rate and temperature.

    `declared` maps a quantity to a column's name or number from 0, three of them for a sensor. A
    quantity that is left out is found by its usual name; one that is None is taken as not logged.
    Where the names are not the log's own (`headed`), columns have to be declared by number.
    """
    declared = dict(declared or {})
    guessed = guess(names) if headed else dict.fromkeys((*_QUANTITIES, "interval"), ())
    increments = guess(names, increments=True) if headed else guessed
    units, chosen, summed = {}, {}, {}
    for quantity in _QUANTITIES:
        # who logs the rate too has it from the increments
        usual = guessed[quantity] or (quantity in _SENSORS and increments[quantity])
        if quantity in declared:
            chosen[quantity] = _declared(quantity, declared[quantity], names, headed)
        elif usual:
            chosen[quantity] = _only(quantity, usual, names)
        where = chosen.get(quantity)
        if where is None and quantity in _SENSORS:
            how = "by name" if headed else "by number from 0"
            raise ImuloopError(
                f"no columns of {quantity} found ({listed(names, headed)}); name its x, y, z "
                f"{how} in columns.{quantity}; a log holds both sensors, as a phone app's zip does"
            )
        if not headed or where is None:
            continue
        if quantity in _SENSORS:
            for at, stem in increments[quantity]:
                if at == where:
                    summed[quantity] = stem
        unit = unit_of(quantity, where, names, quantity in summed)
        if unit or quantity in summed:
            units[quantity] = unit or next(iter(INCREMENTS[quantity]))
    intervals = _intervals(declared, names, headed, guessed, summed)
    unit = intervals and headed and unit_of("interval", next(iter(intervals.values())), names)
    if unit:
        units["interval"] = unit
    others = {f"interval.{quantity}": at for quantity, at in intervals.items()}
    for name, value in declared.get("pps", {}).items():
        others[f"pps.{name}"] = position(f"pps.{name}", value, names, headed)
    places = {q: where if isinstance(where, tuple) else (where,) for q, where in chosen.items()}
    check_each_once(
        {q: [f"{i}, '{names[i]}'," for i in x if i is not None] for q, x in places.items()}
    )
    return Columns(**chosen, others=others, increments=frozenset(summed), units=units)


def _only(quantity, found, names):
    """Return the columns found by their names; raise where others have names as good."""
    where = found[0][0]
    if quantity not in _SENSORS:
        count = [name.lower() for name in names].count(names[where].lower())
        if count > 1:
            raise ImuloopError(
                f"{count} columns are named '{names[where]}'; name one by number, from 0 to "
                f"{len(names) - 1}, in columns.{quantity}"
            )
    elif len(found) > 1:
        both = ["/".join(names[i] for i in each) for each, _ in found[:2]]
        number = f", by number from 0 to {len(names) - 1}" if both[0] == both[1] else ""
        raise ImuloopError(
            f"{' and '.join(both)} both look like {quantity}; name one of them in "
            f"columns.{quantity}{number}"
        )
    return where


def check_each_once(chosen):
    """Raise where a column (quantity -> columns) is taken twice, or for two quantities."""
    taken = {}
    for quantity, columns in chosen.items():
        for column in columns:
            if column in taken:
                raise ImuloopError(
                    f"columns.{quantity}: column {column} is already in columns.{taken[column]}; "
                    "name another"
                )
            taken[column] = quantity


def _intervals(declared, names, headed, guessed, summed):
    """Return sensor -> position of the interval of its increments."""
    value = declared.get("interval")
    if isinstance(value, dict):
        return {q: position("interval", each, names, headed) for q, each in value.items()}
    if value is not None:
        return dict.fromkeys(_SENSORS, position("interval", value, names, headed))
    if "interval" in declared or not summed:
        return {}
    # as of a vehicle_imu of PX4: delta_angle_dt, delta_velocity_dt
    joined = ["_".join(_words(name)) for name in names]
    own = {q: joined.index(f"{stem}_dt") for q, stem in summed.items() if f"{stem}_dt" in joined}
    if own and len(own) == len(summed):
        return dict.fromkeys(_SENSORS, next(iter(own.values()))) | own
    shared = guessed["interval"]
    return dict.fromkeys(_SENSORS, _only("interval", shared, names)) if shared else {}


def _declared(quantity, value, names, headed):
    """Return the position(s) of a declared column or three of them."""
    if quantity not in _SENSORS:
        return None if value is None else position(quantity, value, names, headed)
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise ImuloopError(f"columns.{quantity}: {value!r} is not a list of three columns x, y, z")
    return tuple(position(quantity, item, names, headed) for item in value)


def position(quantity, value, names, headed):
    """Return the position of a declared column, a name or a number from 0."""
    key = quantity if quantity.startswith(("pps", "reference")) else f"columns.{quantity}"
    number = f"from 0 to {len(names) - 1}"
    if isinstance(value, int) and not isinstance(value, bool):
        if 0 <= value < len(names):
            return value
        fault = f"there is no column {value}; the log has {len(names)}, numbered {number}"
    elif not headed:
        fault = f"the log has no header, so {value!r} cannot be found; name columns by number, "
        fault += number
    elif names.count(str(value)) == 1:
        return names.index(str(value))
    elif count := names.count(str(value)):
        fault = f"{count} columns are named '{value}'; name it by number, from 0"
    else:
        hint = did_you_mean(str(value), names, 0.5)
        fault = f"no column '{value}'; there are {listed(names)}{hint}"
    raise ImuloopError(f"{key}: {fault}")


def listed(names, headed=True):
    """Return names as a message shows them: a file can have very many, or none."""
    if not headed:
        return f"no header, {len(names)} columns"
    shown = ", ".join(name[:80] for name in names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"


def guess(names, increments=False):
    """Return quantity -> [(position or three positions, name without axis)], best first.

    With `increments` those of velocity and angle are looked for in place of rates.
    """
    sensors = {quantity: {} for quantity in _SENSORS}
    single = {quantity: [] for quantity in _SINGLE}
    for at, name in enumerate(names):
        words = _words(name)
        stem, axis = _stem_and_axis(words)
        for quantity, usual in _SENSORS.items():
            if axis and stem in usual[increments]:
                key = stem, _without_axis(name, words, stem, axis)
                axes = sensors[quantity].setdefault(key, {a: [] for a in AXES})
                axes[axis].append(at)
        for quantity, usual in _SINGLE.items():
            joined, shorter = "_".join(words), "_".join(words[:-1])
            # T (°) is no time beside Time (s)
            unit = _unit_in(quantity, name, False)
            strange = unit is not None and unit not in _SPELLINGS.get(quantity, _UNITS[quantity])
            if joined in usual:
                single[quantity].append((strange, usual.index(joined), at, joined))
            elif shorter in usual and words[-1] in _UNITS[quantity]:
                single[quantity].append((strange, usual.index(shorter), at, shorter))
    # of names that repeat two are enough
    found = {
        quantity: [
            (each, stem)
            for (stem, _), axes in stems.items()
            for each in islice(product(*(axes[axis] for axis in AXES)), 2)
        ]
        for quantity, stems in sensors.items()
    }
    return found | {q: [(at, stem) for *_, at, stem in sorted(each)] for q, each in single.items()}


def _split(text):
    """Return the lower-case words of a text; accX is two, and NAME[0] is NAME x."""
    text = re.sub(r"\[([012])\]\s*\Z", lambda index: f"_{AXES[int(index[1])]}", text)
    return re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text).lower())


def _words(name):
    """Return the lower-case words of a column's name, its unit in brackets left out."""
    bare = re.sub(r"[(\[{](?![012]\]\s*$).*?[)\]}]", " ", name)
    return [word for word in _split(bare) if word not in _PLACE]


def _without_axis(name, words, stem, axis):
    """Return all words of a name but its axis: the same for the three of one sensor."""
    every = _split(name)
    if axis in every:
        every.remove(axis)
    else:
        every[every.index(words[0])] = stem
    return tuple(every)


def _stem_and_axis(words):
    """Return ('acc', 'x') of ['acc', 'x'], ['accx'], ['x', 'acc'] or ['acc', 'x', 'mps2']."""
    if len(words) > 1 and words[-1] not in AXES and words[-2] in AXES:
        words = words[:-1]
    if len(words) > 1 and words[-1] in AXES:
        return "_".join(words[:-1]), words[-1]
    if len(words) > 1 and words[0] in AXES:
        return "_".join(words[1:]), words[0]
    word = words[0] if words else ""
    if word[-1:] in AXES and word[:-1] in _KNOWN:
        return word[:-1], word[-1]
    if word[:1] in AXES and word[1:] in _KNOWN:
        return word[1:], word[0]
    return "", None


def unit_of(quantity, where, names, increments=False):
    """Return the unit that the names of columns state: 'ax [g]', 'time_us', 'gx deg/s'.

    One that is not known is given as it is written, and several where they differ.
    """
    where = where if isinstance(where, tuple) else (where,)
    units = dict.fromkeys(_unit_in(quantity, names[i], increments) for i in where)
    return " and ".join(unit for unit in units if unit) or None


def _unit_in(quantity, name, increments):
    bracket = re.search(r"[(\[{]([^()\[\]{}]*)[)\]}]\s*\Z", name)
    text = bracket[1].strip() if bracket else ""
    if text and not text.isdigit() and text.lower() not in AXES:
        return stated_unit(quantity, text, increments) or text
    # the longest end of the name that is a unit; of one column all of it: millis
    start = r"\A|" if quantity in _SINGLE else ""
    for separator in re.finditer(start + r"[\s_.,:-]+|\s/\s", name):
        end = name[separator.end() :]
        # one letter is too little to go by for a sensor: acc_x_g
        if len(end) > 1 or quantity in _SINGLE:
            unit = stated_unit(quantity, end, increments)
            if unit:
                return unit
    return None
