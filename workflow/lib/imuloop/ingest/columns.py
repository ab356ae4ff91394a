"""The columns of each quantity in a log: declared by name or number, else with usual names."""

from dataclasses import dataclass, field

from imuloop.core.errors import ImuloopError, Lacking, did_you_mean
from imuloop.core.samples import TEMPERATURE
from imuloop.core.units import INCREMENTS
from imuloop.ingest.places import PAIR
from imuloop.ingest.spellings import (
    AXES,
    SENSORS,
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
_QUANTITIES = ("time", "acceleration", "angular_rate", "temperature")
# number of columns of each quantity that may be declared by several columns
_WIDTH = {"time": 2} | dict.fromkeys(SENSORS, len(AXES))
_WANTED = {"time": "a column, nor two of whole seconds and nanoseconds"}
_WANTED |= dict.fromkeys(SENSORS, "a list of three columns x, y, z")
# most names in a message, so that it fits a screen
_SHOWN = 60


@dataclass(frozen=True)
class Columns:
    """Positions of the columns of each quantity, from 0; None if the log lacks it.

    If `time` is two columns, they hold whole seconds and parts of a second in units of `part_ns`
    ns. `others` maps names to the positions of further raw columns: ``interval.SENSOR``, the
    interval of a sensor's increments, ``pps.counter``, ``pps.time``, and the columns declared as
    ``others``. `increments` are the sensors that log increments, as the names of their columns
    show. `units` are the units that the names state, by quantity. `turned` are the axes whose sign
    is turned.
    """

    acceleration: tuple[int, int, int] | None = None
    angular_rate: tuple[int, int, int] | None = None
    time: int | tuple[int, int] | None = None
    temperature: int | None = None
    others: dict = field(default_factory=dict)
    increments: frozenset = frozenset()
    units: dict = field(default_factory=dict)
    part_ns: int = 1
    turned: frozenset = frozenset()

    def raw(self):
        """Return the position of each raw column by its name, a dict in which stamps come first."""
        names = {"time": (STAMP, FRACTION), **SENSORS, "temperature": (TEMPERATURE,)}
        raw = {}
        for quantity in _QUANTITIES:
            raw |= zip(names[quantity], _tuple(getattr(self, quantity)), strict=False)
            raw |= self.others if quantity == "time" else {}
        return raw

    def stamps(self):
        """Return the number of raw columns that are stamps."""
        return len(_tuple(self.time)) + len(self.others)

    def found(self, names):
        """Return the names of the columns of each quantity, a dict.

        A value is a list, or the name of a single column. `names` are the names of all columns.
        """
        places = {quantity: getattr(self, quantity) for quantity in _QUANTITIES}
        for name, at in self.others.items():
            quantity = name.partition(".")[0]
            places[quantity] = tuple(dict.fromkeys((*places.get(quantity, ()), at)))
        return {
            quantity: [names[i] for i in where] if isinstance(where, tuple) else names[where]
            for quantity, where in places.items()
            if where is not None
        }


def _tuple(where):
    """Return the positions of a quantity as a tuple, which is empty for None."""
    return () if where is None else where if isinstance(where, tuple) else (where,)


def resolve(names, declared=None, headed=True):
    """Return the `Columns` that hold time, acceleration, angular rate and temperature.

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

    Raises
    ------
    ImuloopError
        If a declared column does not exist, or several columns may be meant.
    """
    declared, part_ns, units = dict(declared or {}), 1, {}
    logged = [quantity for quantity in SENSORS if declared.get(quantity, "") is not None]
    alone = logged[0] if len(logged) == 1 else None
    usual = guess(names, alone, usual=False)
    if pair := two_parts(names):
        usual["time"] = [pair[:2]]
    elif alone and not headed and len(names) in (len(AXES), len(AXES) + 1):
        first = len(names) - len(AXES)
        usual |= {alone: [tuple(range(first, len(names)))], "time": [0] * first}
    chosen = {
        quantity: _declared(quantity, declared[quantity], names, headed)
        if quantity in declared
        else _only(quantity, usual[quantity], names)
        for quantity in _QUANTITIES
    }
    taken = [(at, quantity) for quantity, where in chosen.items() for at in _tuple(where)]
    for k, (at, quantity) in enumerate(taken):
        if other := dict(taken[:k]).get(at):
            why = f"column {at}, '{names[at]}', is already in columns.{other}; name another"
            raise ImuloopError(f"columns.{quantity}: {why}")
    first = {q: names[chosen[q][0]] for q in SENSORS if chosen[q] and headed}
    summed = {q: name for q in first if (name := increment_name(q, first[q]))}
    intervals = _intervals(declared, names, headed, usual["interval"], summed)
    named = chosen | {"interval": next(iter(intervals.values()), None)}
    for quantity, at in named.items():
        if headed and at is not None:
            units[quantity] = unit_of(quantity, at, names, quantity in summed)
            if quantity in summed and not units[quantity]:
                units[quantity] = next(iter(INCREMENTS[quantity]))
    if isinstance(chosen["time"], tuple):
        units["time"] = "ns"
        part_ns = pair[2] if pair and pair[:2] == chosen["time"] else 1
    others = {f"interval.{quantity}": at for quantity, at in intervals.items()}
    for name, column in declared.get("pps", {}).items():
        others[f"pps.{name}"] = position(f"pps.{name}", column, names, headed)
    # their names are KEY.NUMBER
    for name, column in declared.get("others", {}).items():
        others[name] = position(name.rpartition(".")[0], column, names, headed)
    turned = [
        axis
        for quantity, axes in SENSORS.items()
        for axis, column in zip(axes, declared.get(quantity) or (), strict=False)
        if without_sign(column, names) != column
    ]
    return Columns(
        **chosen,
        others=others,
        increments=frozenset(summed),
        units={quantity: unit for quantity, unit in units.items() if unit},
        part_ns=part_ns,
        turned=frozenset(turned),
    )


def lacking(quantity, columns):
    """Return the error of a log that lacks a sensor; `columns` lists the log's columns, text."""
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


def _only(quantity, found, names):
    """Return the only column in `found`, or None if `found` is empty.

    `found` are the positions of columns that may hold the quantity, the best first, and `names` are
    the names of all columns. An ImuloopError is raised if several columns are equally good.
    """
    if not found:
        return None
    candidates = [name for name in names if name.lower() == names[_tuple(found[0])[0]].lower()]
    if quantity in SENSORS:
        candidates = ["/".join(names[i] for i in axes) for axes in found]
    if len(candidates) > 1:
        number = f", by number from 0 to {len(names) - 1}" * (candidates[0] == candidates[1])
        raise ImuloopError(
            f"{candidates[0]} and {candidates[1]} both look like {quantity}; name one of them in "
            f"columns.{quantity}{number}"
        )
    return found[0]


def _intervals(declared, names, headed, usual, summed):
    """Return the position of the column with the interval of each sensor's increments, by sensor.

    `declared` are the declared columns by quantity, and `names` are the names of all columns,
    and `headed` tells whether the log has them. `usual` are the positions of columns with usual
    names of an interval. `summed` is the name of the increments of each sensor that logs them. The
    result is empty if no interval is logged.
    """
    interval = declared.get("interval")
    if "interval" not in declared and summed:
        interval = _only("interval", usual, names)
        # a vehicle_imu of PX4 has two: delta_angle_dt, delta_velocity_dt
        joined = {" ".join(words_of(name)): at for at, name in enumerate(names)}
        if {f"{name} dt" for name in summed.values()} <= {*joined}:
            interval = {quantity: joined[f"{name} dt"] for quantity, name in summed.items()}
    if interval is None:
        return {}
    by_sensor = interval if isinstance(interval, dict) else dict.fromkeys(SENSORS, interval)
    return {q: position("interval", column, names, headed) for q, column in by_sensor.items()}


def _declared(quantity, column, names, headed):
    """Return the position of a declared `column`, a tuple for several columns, or None for None.

    `names` are the names of all columns, and `headed` tells whether the log has them. Raises an
    ImuloopError if the number of columns does not fit the quantity, or a column does not exist.
    """
    if column is None:
        return None
    several = isinstance(column, (list, tuple))
    if len(column) != _WIDTH.get(quantity, 0) if several else quantity in SENSORS:
        raise ImuloopError(
            f"columns.{quantity}: {column!r} is not {_WANTED.get(quantity, 'a column')}"
        )
    if not several:
        return position(quantity, column, names, headed)
    return tuple(position(quantity, each, names, headed) for each in column)


def without_sign(column, names=()):
    """Return a declared column of a sensor without the minus that turns it: ``-AccX``, ``-3``.

    A column whose name, in `names`, begins with a minus stays as it is.
    """
    if isinstance(column, str) and column.startswith("-") and column not in names:
        return int(column[1:]) if column[1:].isdecimal() else column[1:]
    return column


def position(quantity, value, names, headed):
    """Return the position, from 0, of the column that is declared for a quantity.

    `value` is the name of the column or its position. Only a log that is `headed`, which has a
    header, has names. Raises an ImuloopError, which names the key, if there is no such column.
    """
    key = quantity if quantity.startswith(("pps", "reference")) else f"columns.{quantity}"
    value = without_sign(value, names) if quantity in SENSORS else value
    number, count = isinstance(value, int) and not isinstance(value, bool), names.count(str(value))
    if number and 0 <= value < len(names):
        return value
    if headed and count == 1 and not number:
        return names.index(str(value))
    by_number = f"name it by number, 0 to {len(names) - 1}"
    if number:
        fault = f"there is no column {value}; the log has {len(names)}, numbered from 0"
    elif not headed:
        fault = f"no header, so {value!r} cannot be found; {by_number}"
    elif count:
        fault = f"{count} columns are named '{value}'; {by_number}"
    else:
        hint = did_you_mean(str(value), names, 0.5)
        fault = f"no column '{value}'; there are {listed(names)}{hint}"
    raise ImuloopError(f"{key}: {fault}")


def listed(names, headed=True):
    """Return column names as text for a message; only their number if the file has no header."""
    if not headed:
        return f"no header, {len(names)} columns"
    shown = ", ".join(name[:80] for name in names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"
