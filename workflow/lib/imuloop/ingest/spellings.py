"""How files spell columns and units: usual names, words and axes in them, units beside them."""

import re
from itertools import islice, product

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION as FORCES
from imuloop.core.samples import ANGULAR_RATE as RATES
from imuloop.core.units import ACCELERATION, ANGULAR_RATE, INCREMENTS, TIME
from imuloop.core.units import TEMPERATURE as DEGREES

AXES = ("x", "y", "z")
# names there of the axes of each sensor
SENSORS = {"acceleration": FORCES, "angular_rate": RATES}
# usual names of a sensor's columns without their axis, words joined by "_": of the quantity itself,
# and of its increments over the interval that ends at the stamp
_NAMES = {
    "acceleration": (
        "a acc accel accelero accelerometer acceleration accelerometer_acceleration specific_force"
        " linear_acceleration a_rs_s gf".split(),
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
_KNOWN = {name for pair in _NAMES.values() for usual in pair for name in usual}
# words that name a sensor among others, and words of what is not its output
_HINTS = {"acceleration": r"(uncal)?acc(s|e|el\w*)?\d*", "angular_rate": r"(uncal)?gyr\w*"}
_NO_OUTPUT = set(
    "linear lin free user gravity without bias offset scale std var cov covariance variance mean"
    " earth world global ned enu ref reference true setpoint delta inc linacc freeacc".split()
)
# and more of a prefix that is no device's
_NO_DEVICE = _NO_OUTPUT | set("odom gt vicon mocap cmd target desired est".split())
# longest name in which a prefix is looked for
_LONG = 99
# a name for the specific force that other columns have too, as a force in N
_WEAK = {"acceleration": "f"}
_KNOWN |= {*_WEAK.values()}
# of several the first is taken, a message's own stamp before its receipt; the interval is that of
# increments, that of one sensor alone ends in its name and _dt
_SINGLE = {
    "time": "elapsed_realtime header_stamp t time timestamp time_stamp stamp timestamps times"
    " sensor_time sensor_timestamp utc time_utc timestamp_utc utc_time datetime date_time epoch"
    " epoc unix_time unix_timestamp seconds_elapsed elapsed elapsed_time time_since_start millis"
    " micros date seconds milliseconds microseconds nanoseconds sample_time_fine".split(),
    "temperature": "temperature temp tmp temperature_imu chip_temperature degc celsius".split(),
    "interval": "dt delta_t delta_time interval sample_interval sampling_interval sample_period"
    " integration_time integration_interval".split(),
}
# last words of two columns of one time: whole seconds, and ns in a unit of the part of a second
_SECONDS = ("sec", "secs")
# and of a clock that is spread over columns
_OF_CLOCK = ("hour", "minute", "second")
PARTS = {"nsec": 1, "nsecs": 1, "nanosec": 1, "nanosecs": 1, "usec": 1000, "usecs": 1000}
# names that are a unit of time and no more: two of them are the parts of one time
_WHOLE = ("seconds",)
_PARTS = {"nanoseconds": 1, "microseconds": 10**3, "milliseconds": 10**6}
PARTS |= _PARTS
_CLOCK_PARTS = {*_OF_CLOCK, *_WHOLE, *_PARTS}
_CLOCK_PARTS |= {*"s sec min minutes h hours day days ms us ns".split()}
# between words that have no sign between them; degC is one word
_CAMEL = r"(?<=[a-z])(?!(?<=deg)[CFK](?![a-z]))(?=[A-Z])|(?<=[XYZ])(?=[A-Z][a-z]|dps)"
# words that say where, not what
_PLACE = {"imu", "raw", "sensor", "field", "data"}
# spellings that files use for the units, lower case without blanks, dots, carets
_SPELLINGS = {
    "time": {
        "min": "min mins minute minutes",
        "h": "h hr hrs hour hours",
        "s": "s sec secs second seconds",
        "ms": "ms msec msecs millis millisec millisecs millisecond milliseconds",
        "us": "us usec usecs micros microsec microsecs microsecond microseconds",
        "ns": "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds",
    },
    "acceleration": {
        "m/s^2": "m/s^2 m/s2 m/s/s ms-2 ms2 mps2 m/sec2",
        "g": "g gs g0",
        "mg": "mg milli-g millig",
        "count": "count counts lsb adc raw",
        "cm/s^2": "cm/s^2 cm/s2 cms-2 cms2 gal",
        "ft/s^2": "ft/s^2 ft/s2 ft/s/s ft/sec2 fts-2 fts2",
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


def is_iso(unit):
    """Tell whether a time unit is declared as ISO 8601, however it is spelt."""
    return str(unit).lower().replace(" ", "").replace("-", "") in ("iso", "iso8601")


def unknown_unit(quantity, text):
    """Return the error of a log that states a unit that is not known."""
    return ImuloopError(
        f"units.{quantity}: the log says '{text[:80]}', which is no unit that is read; declare "
        f"the right one of {', '.join(UNITS[quantity])}"
    )


def hinted(quantity, names, alone):
    """Return columns that look like a quantity's, though their names are none of the usual ones.

    They have a usual name after a prefix (`imu0_t`). Those of a sensor have its name in theirs, or
    a weaker name, or a unit that no other quantity has (`x_dps`); where one sensor is logged
    `alone`, they may be any three.
    """
    if quantity not in SENSORS:
        return _prefixed(quantity, names, alone)
    hint = _HINTS[quantity]
    triples = [(at, *key) for key, axes in _triples(names).items() for at in axes]
    own = [(at, stem, words) for at, stem, words in triples if not _NO_OUTPUT & {*words}]
    named = [(at, stem) for at, stem, words in own if any(re.fullmatch(hint, w) for w in words)]
    weak = [(at, stem) for at, stem, _ in own if stem == _WEAK.get(quantity)]
    # G may be gauss: of an acceleration the unit is too little
    rates = [
        (at, stem)
        for at, stem, words in own
        if quantity == "angular_rate" and not _NO_DEVICE & {*words} and _states_rate(at, names)
    ]
    every = [(at, stem) for at, stem, _ in triples] if alone and len(triples) == 1 else []
    return named or _prefixed(quantity, names, alone) or weak or rates or every


def _states_rate(at, names):
    """Tell whether columns state a unit of an angular rate, which is not that of an angle."""
    rate, angle = (unit_of("angular_rate", at, names, summed) for summed in (False, True))
    return rate in ANGULAR_RATE and angle not in INCREMENTS["angular_rate"]


def _prefixed(quantity, names, alone):
    """Return what `guess` finds in names without the prefix of a device: `imu0_ax`.

    All sensors that are logged have the prefix. Several devices have several: the columns of two
    are returned for a sensor, none for another quantity.
    """
    heads = {sensor: {} for sensor in ([alone] if alone else SENSORS)}
    for name in names:
        for separator in re.finditer(r"[\W_]+", name[:_LONG]):
            head, rest = name[: separator.end()], name[separator.end() :]
            stem, axis = _stem_and_axis(words_of(rest))
            for sensor, found in heads.items():
                if axis and stem in _NAMES[sensor][0] and not _NO_DEVICE & {*_split(head)}:
                    found[head] = None
    first, *others = heads.values()
    shared = [head for head in first if all(head in other for other in others)]
    if len(shared) > 1 and quantity not in SENSORS:
        return []
    bare = [[n.removeprefix(head) if n.startswith(head) else "" for n in names] for head in shared]
    return [each for part in bare[:2] for each in guess(part)[quantity]]


def two_parts(names):
    """Return the columns of whole seconds and their part, None without."""
    words = [_split(_without_unit(name)) or [""] for name in names]
    whole = {(*w[:-1],): at for at, w in enumerate(words) if w[-1] in _SECONDS or w == [*_WHOLE]}
    parts = [
        (whole.get((*w[:-1],)), at)
        for at, w in enumerate(words)
        if w[-1] in PARTS and (w[-1] not in _PARTS or not w[:-1])
    ]
    return next((pair for pair in parts if pair[0] is not None), None)


def guess(names, increments=False):
    """Return quantity -> [(position or three positions, name without axis)], best first.

    With `increments` those of velocity and angle are looked for in place of rates.
    """
    found, triples = {}, _triples(names)
    for quantity, usual in _NAMES.items():
        known = [(stem, axes) for (stem, _), axes in triples.items() if stem in usual[increments]]
        found[quantity] = [(at, stem) for stem, axes in known for at in axes]
    clock = [words for words in map(words_of, names) if words and {*words} <= _CLOCK_PARTS]
    for quantity, usual in _SINGLE.items():
        single = []
        for at, name in enumerate(names):
            words = words_of(name)
            if len(clock) > 1 and words in clock:
                # a part of a time
                continue
            unit = _unit_in(quantity, name, False)
            strange = unit is not None and unit not in _SPELLINGS.get(quantity, _UNITS[quantity])
            if strange and any(stated_unit(q, unit) for q in _SPELLINGS):
                # T (°) is no time
                continue
            # Time (UTC) may be one, and whole seconds may have their part elsewhere
            last = words[-1] if words else ""
            strange = strange or last in _SECONDS
            bare = words[:-1] if last in _UNITS[quantity] and last not in _OF_CLOCK else words
            stem = next((s for s in ("_".join(words), "_".join(bare)) if s in usual), None)
            if stem:
                single.append((strange, usual.index(stem), at, stem))
        found[quantity] = [(at, stem) for *_, at, stem in sorted(single)]
    return found


def _triples(names):
    """Return (name without axis, all its words) -> positions of x, y and z.

    Where names repeat there are several; two are enough.
    """
    found = {}
    for at, name in enumerate(names):
        words, every = words_of(name), _split(name)
        stem, axis = _stem_and_axis(words)
        if axis in every:
            every.remove(axis)
        elif axis:
            every = [stem, *(word for word in every if word not in words)]
        if axis:
            axes = found.setdefault((stem, (*every,)), {a: [] for a in AXES})
            axes[axis].append(at)
    return {key: [*islice(product(*axes.values()), 2)] for key, axes in found.items()}


def named_sensor(text):
    """Return the sensor that a word or a file's name stands for, or None."""
    words = _split(str(text))
    if _NO_OUTPUT & {*words}:
        return None
    found = {q for q, hint in _HINTS.items() for word in words if re.fullmatch(hint, word)}
    return found.pop() if len(found) == 1 else None


def _split(text):
    """Return the lower-case words of a text; accX is two, and NAME[0] is NAME x."""
    text = re.sub(r"\[([012])\](?=\s*([\[(]|\Z))", lambda index: f"_{AXES[int(index[1])]}", text)
    text = re.sub(_CAMEL, "_", text)
    return re.findall(r"[^\W_]+", text.lower())


def _without_unit(name):
    """Return a column's name without what is in brackets, but for its axis."""
    return re.sub(r"[(\[{](?!([012]\]|[xyzXYZ][)\]}])).*?[)\]}]", " ", name)


def words_of(name):
    """Return the lower-case words of a column's name, its unit in brackets left out."""
    return [word for word in _split(_without_unit(name)) if word not in _PLACE]


def _stem_and_axis(words):
    """Return ('acc', 'x') of ['acc', 'x'], ['accx'], ['x', 'acc'] or ['acc', 'x', 'mps2']."""
    if len(words) > 1 and words[-1] not in AXES and words[-2] in AXES:
        words = words[:-1]
    axes = [word for word in words if word in AXES]
    if words and (words[-1] in AXES or words[0] in AXES or len(axes) == 1):
        axis = words[-1] if words[-1] in AXES else words[0] if words[0] in AXES else axes[0]
        at = len(words) - 1 - words[::-1].index(axis)
        return "_".join(words[:at] + words[at + 1 :]), axis
    # gFx is two
    for word in (*words[:1], "".join(words)):
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
    if unit := _unit_at_end(quantity, name, increments):
        return unit
    # before the axis: gyro_dps_x; raw is a place there
    bare = re.sub(r"([\s_.:-]+[xyz]|\[[012]\])\Z", "", name, flags=re.IGNORECASE)
    if bare == name or quantity not in SENSORS:
        return None
    unit = _unit_at_end(quantity, bare, increments)
    return None if unit == "count" else unit


def _unit_at_end(quantity, name, increments):
    # the longest end of the name that is a unit; of one column all of it: millis
    start = r"\A|" if quantity in _SINGLE else ""
    for separator in re.finditer(start + r"[\s_.,:-]+|\s/\s|" + _CAMEL, name):
        end = name[separator.end() :]
        # one letter is too little to go by for a sensor: acc_x_g
        if len(end) > 1 or quantity in _SINGLE:
            unit = stated_unit(quantity, end, increments)
            if unit:
                return unit
    return None
