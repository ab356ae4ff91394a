"""The columns of each quantity in a log: declared by name or number, else with usual names."""

from dataclasses import dataclass
from textwrap import shorten

from imuloop.core.errors import ImuloopError, Lacking, did_you_mean
from imuloop.core.samples import TEMPERATURE
from imuloop.core.units import INCREMENTS
from imuloop.ingest.places import PAIR
from imuloop.ingest.spellings import (
    AXES,
    SENSORS,
    UNITS,
    guess,
    increment_name,
    two_parts,
    unit_of,
    words_of,
)

# name of the column of time stamps in a raw batch; absent if the log has no time column
STAMP = "stamp"
# name, in a raw batch, of the column with the time stamps of a sensor with a slower clock
HELD = "held"
# name, in a raw batch, of the parts of a second if they have their own column
FRACTION = "stamp.fraction"
# raw columns of each quantity
_RAW = {"time": (STAMP, FRACTION), **SENSORS, "temperature": (TEMPERATURE,)}
# number of characters of a list of columns in a message
_SHOWN = 600


@dataclass(frozen=True)
class Columns:
    """Which columns of a log are read, and for what.

    `raw` maps the name of a column of the RawLog, the log as it is read, to its position in the
    file, from 0. The first `stamps` of these columns, a number, hold time stamps or counters:
    ``stamp``, ``interval.SENSOR``, the interval of a sensor's increments, ``pps.counter``,
    ``pps.time``, and the columns declared as ``others``. `places` is a dict by quantity of the
    positions of its columns, a tuple, and `units` a dict by quantity of the unit that the log
    states for it. If the time has two columns, they hold whole seconds and parts of a second in
    units of `part_ns` ns. `turned` are the axes whose sign is changed.
    """

    raw: dict
    stamps: int
    places: dict
    units: dict
    part_ns: int
    turned: set

    def names_by_quantity(self, names):
        """Return the names of the columns of each quantity, a dict.

        `names` are the names of all columns of the log. A value is a list of names. For a time or a
        temperature in a single column it is the name itself.
        """
        columns = {quantity: [names[at] for at in where] for quantity, where in self.places.items()}
        for quantity in {"time", "temperature"} & {*columns}:
            if len(columns[quantity]) == 1:
                [columns[quantity]] = columns[quantity]
        return columns


def resolve(names, declared=None, headed=True, units=()):
    """Return the `Columns` of a log that hold time, acceleration, angular rate and temperature.

    Parameters
    ----------
    names : list of str
        Names of all columns of the log.
    declared : dict, optional
        The column of each quantity: its name, or its number from 0. A sensor has three of them,
        and a time of whole seconds and nanoseconds two. A quantity that is left out is found by its
        usual name. None means that a quantity was not logged. If one sensor was not logged, columns
        that are only called x, y and z hold the other sensor.
    headed : bool, optional
        Whether the names are from the log. Otherwise columns have to be declared by number.
    units : sequence of str, optional
        Unit of each column, empty if the log states none outside of the names.

    Raises
    ------
    ImuloopError
        If a declared column does not exist, or several columns may be meant.
    """
    declared, places, users = dict(declared or {}), {}, {}
    logged = [quantity for quantity in SENSORS if declared.get(quantity, "") is not None]
    alone = logged[0] if len(logged) == 1 else None
    usual = guess(names, alone, usual=False)
    pair, part_ns = two_parts(names)
    if pair:
        usual["time"] = [pair]
    elif alone and not headed and len(names) in (len(AXES), len(AXES) + 1):
        first = len(names) - len(AXES)
        usual |= {alone: [tuple(range(first, len(names)))], "time": [(0,)] * first}
    for quantity in _RAW:
        if quantity in declared:
            where = _declared(quantity, declared[quantity], names, headed)
        else:
            where = _usual(quantity, usual[quantity], names)
        for at in where:
            if at in users:
                why = f"column {at}, '{names[at]}', is already in columns.{users[at]}; name another"
                raise ImuloopError(f"columns.{quantity}: {why}")
            users[at] = quantity
        places[quantity] = where
    increments = {q: increment_name(q, names[places[q][0]]) for q in SENSORS if places[q]}
    increments = {quantity: name for quantity, name in increments.items() if name}
    others = _intervals(declared, names, headed, usual["interval"], increments)
    for name, column in declared.get("pps", {}).items():
        others[f"pps.{name}"] = position(f"pps.{name}", column, names, headed)
    # their names are KEY.NUMBER
    for name, column in declared.get("others", {}).items():
        others[name] = position(name.rpartition(".")[0], column, names, headed)
    for name, at in others.items():
        key = name.partition(".")[0]
        places[key] = tuple(dict.fromkeys((*places.get(key, ()), at)))
    stated = _stated_units(places, names, units, increments) if headed else {}
    stamps = dict(zip(_RAW["time"], places["time"], strict=False)) | others
    stated |= {"time": "ns"} if FRACTION in stamps else {}
    raw = dict(stamps)
    for quantity in (*SENSORS, "temperature"):
        raw |= zip(_RAW[quantity], places[quantity], strict=False)
    turned = {
        axis
        for quantity, axes in SENSORS.items()
        for axis, column in zip(axes, declared.get(quantity) or (), strict=False)
        if without_sign(column, names) != column
    }
    part_ns = part_ns if places["time"] == pair else 1
    places = {quantity: where for quantity, where in places.items() if where}
    return Columns(raw, len(stamps), places, stated, part_ns, turned)


def lacking(quantity, columns):
    """Return the ImuloopError of a log in which no columns of a sensor were found.

    `quantity` is the quantity of the sensor. `columns` is a text that lists the columns of the log.
    """
    name = f"name its x, y, z by name in columns.{quantity}"
    if columns.startswith("no header"):
        name = (
            "name its x, y, z by number from 0, such as [1, 2, 3], in columns.acceleration, those "
            "of the other sensor in columns.angular_rate, and the time in columns.time"
        )
    return Lacking(
        f"no columns of {quantity} found ({columns}); {name}, or give both files where another "
        f"holds it, {PAIR}, or declare columns.{quantity}: null where it was not logged"
    )


def ambiguous(quantity, candidates, how=""):
    """Return the ImuloopError of a log in which several columns may be meant by a quantity.

    `candidates` is a list of their names, and `quantity` the name of the quantity. `how` is added
    to the advice to name one of them.
    """
    return ImuloopError(
        f"{candidates[0]} and {candidates[1]} both look like {quantity}; name one of them in "
        f"columns.{quantity}{how}"
    )


def _usual(quantity, places, names):
    """Return the positions of the columns with a usual name of a quantity, a tuple, or ().

    `quantity` is the name of the quantity. `places` is a list of tuples of positions that may be
    meant, the best first, and `names` are the names of all columns. An ImuloopError is raised if
    several tuples are equally good.
    """
    if quantity in SENSORS:
        candidates = ["/".join(names[at] for at in where) for where in places]
    else:
        candidates = [n for n in names if places and n.lower() == names[places[0][0]].lower()]
    if len(candidates) > 1:
        number = f", by number from 0 to {len(names) - 1}" * (candidates[0] == candidates[1])
        raise ambiguous(quantity, candidates, number)
    return places[0] if places else ()


def _stated_units(places, names, units, increments):
    """Return the units that the log states, a dict by quantity.

    `places` are the positions of the columns of each quantity. `names` and `units` are the names
    and units of all columns; a name may hold a unit, too. `increments` has the name of the
    increments of each sensor that logs them; without a stated unit these have the first unit of
    `INCREMENTS`.
    """
    units = [unit.strip("[]{} ") for unit in units] or [""] * len(names)
    texts = [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
    stated = {}
    for quantity in UNITS:
        where, summed = places.get(quantity, ()), quantity in increments
        unit = unit_of(quantity, where, texts, summed)
        if unit or summed:
            stated[quantity] = unit or next(iter(INCREMENTS[quantity]))
    return stated


def _intervals(declared, names, headed, usual, increments):
    """Return the position of the column with the interval of each sensor's increments, a dict.

    An increment is the integral of a sensor's output over a short interval. The keys are
    ``interval.SENSOR``; the dict is empty if no interval is logged. `declared` are the declared
    columns by quantity, `names` the names of all columns, and `headed` tells whether the log has
    names. `usual` are the positions of columns with usual names of an interval. `increments` has
    the name of the increments of each sensor that logs them.
    """
    interval = declared.get("interval")
    if "interval" not in declared and increments:
        interval = next(iter(_usual("interval", usual, names)), None)
        # a vehicle_imu of PX4 has two: delta_angle_dt, delta_velocity_dt
        joined = {" ".join(words_of(name)): at for at, name in enumerate(names)}
        if {f"{name} dt" for name in increments.values()} <= {*joined}:
            interval = {quantity: joined[f"{name} dt"] for quantity, name in increments.items()}
    if interval is None:
        return {}
    by_sensor = interval if isinstance(interval, dict) else dict.fromkeys(SENSORS, interval)
    return {f"interval.{q}": position("interval", x, names, headed) for q, x in by_sensor.items()}


def _declared(quantity, column, names, headed):
    """Return the positions of the columns that are declared for a quantity, a tuple.

    `quantity` is the name of the quantity, and `column` its declaration: a column, a list of
    columns, or None, for which the result is empty. `names` are the names of all columns, and
    `headed` tells whether the log has names. Raises an ImuloopError for a sensor without a list, or
    if a column does not exist.
    """
    if column is None:
        return ()
    several = isinstance(column, (list, tuple))
    if quantity in SENSORS and not several:
        raise ImuloopError(f"columns.{quantity}: {column!r} is not a list of three columns x, y, z")
    columns = column if several else [column]
    return tuple(position(quantity, name, names, headed) for name in columns)


def without_sign(column, names=()):
    """Return a declared column of a sensor without its minus: ``AccX`` for ``-AccX``.

    `column` is a name or a position. A minus before a name or a position is a request to change the
    sign of the values. Exception: if `names`, the names of all columns, have the name with the
    minus, it belongs to the name and stays.
    """
    if isinstance(column, str) and column.startswith("-") and column not in names:
        return int(column[1:]) if column[1:].isdecimal() else column[1:]
    return column


def position(quantity, value, names, headed):
    """Return the position, from 0, of the column that is declared for a quantity.

    `quantity` is the name of the quantity, `value` the name of the column or its position, and
    `names` the names of all columns. A log that is not `headed`, which has no header, has numbers
    as names. Raises an ImuloopError, which names the key of the config, if there is no such column.
    """
    value = without_sign(value, names) if quantity in SENSORS else value
    number, count = isinstance(value, int), names.count(str(value))
    if number and 0 <= value < len(names):
        return value
    if count == 1 and not number:
        return names.index(value)
    by_number = f"name it by number, 0 to {len(names) - 1}"
    fault = f"no column '{value}'; there are {listed(names)}{did_you_mean(str(value), names)}"
    if number:
        fault = f"there is no column {value}; the log has {len(names)}, numbered from 0"
    elif not headed:
        fault = f"no header, so {value!r} cannot be found; {by_number}"
    elif count:
        fault = f"{count} columns are named '{value}'; {by_number}"
    key = quantity if quantity.startswith(("pps", "reference")) else f"columns.{quantity}"
    raise ImuloopError(f"{key}: {fault}")


def listed(names, headed=True):
    """Return the column `names` as text for a message.

    The text is only their number if the log is not `headed`, that is, has no names of columns.
    """
    if not headed:
        return f"no header, {len(names)} columns"
    return shorten(", ".join(names), _SHOWN, placeholder=" …")
