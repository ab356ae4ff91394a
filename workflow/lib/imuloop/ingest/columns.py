"""Which columns of a log hold what: declared by name or number, else by the usual names."""

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

# name of the stamps in raw batches; absent where the log has no time column
STAMP = "stamp"
# name there of the own stamps of a sensor with a slower clock
HELD = "held"
# name there of the part of a second where that has its own column
FRACTION = "stamp.fraction"
_QUANTITIES = ("time", "acceleration", "angular_rate", "temperature")
# most names in a message
_SHOWN = 60


@dataclass(frozen=True)
class Columns:
    """Positions of the columns of each quantity, from 0; None where there is none.

    A `time` of two columns is whole seconds and a part of a second in units of `part_ns`. `others`
    holds further raw columns, of numbers or stamps: ``interval.SENSOR``, the interval of a sensor's
    increments, ``pps.counter``, ``pps.time``, and those declared as ``others``. `increments` holds
    the sensors whose columns' names say that they are logged as such, `units` the units that the
    names state, `turned` the axes whose sign is turned.
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
        """Return name of each raw column -> its position: those that are stamps come first."""
        time = zip((STAMP, FRACTION), _tuple(self.time), strict=False)
        axes = [zip(names, _tuple(getattr(self, q)), strict=False) for q, names in SENSORS.items()]
        warm = zip((TEMPERATURE,), _tuple(self.temperature), strict=False)
        return dict([*time, *self.others.items(), *axes[0], *axes[1], *warm])

    def stamps(self):
        """Return how many raw columns are stamps."""
        return len(_tuple(self.time)) + len(self.others)

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


def _tuple(where):
    return () if where is None else where if isinstance(where, tuple) else (where,)


def resolve(names, declared=None, headed=True):
    """Return which columns hold time, acceleration, angular rate and temperature.

    `declared` maps a quantity to a column's name or number from 0, three of them for a sensor, two
    for a time of whole seconds and nanoseconds. A quantity that is left out is found by its usual
    name; one that is None is taken as not logged. Of a log of one sensor, the other being None, x,
    y and z are enough. Where the names are not the log's own (`headed`), columns have to be
    declared by number.
    """
    declared = dict(declared or {})
    logged = [quantity for quantity in SENSORS if declared.get(quantity, "") is not None]
    alone = logged[0] if len(logged) == 1 else None
    found, part_ns = guess(names, alone, usual=False), 1
    if pair := two_parts(names):
        found["time"] = [(pair[:2], "")]
    elif alone and not headed and len(names) in (len(AXES), len(AXES) + 1):
        first = len(names) - len(AXES)
        found |= {alone: [(tuple(range(first, len(names))), "")], "time": [(0, "")] * first}
    chosen = {
        quantity: _declared(quantity, declared[quantity], names, headed)
        if quantity in declared
        else _only(quantity, found[quantity], names)
        for quantity in _QUANTITIES
    }
    sensors = [q for q in SENSORS if chosen[q] and headed]
    summed = {q: name for q in sensors if (name := increment_name(q, names[chosen[q][0]]))}
    units = {}
    for quantity, at in chosen.items() if headed else ():
        if at is not None:
            usual = next(iter(INCREMENTS[quantity])) if quantity in summed else None
            units[quantity] = unit_of(quantity, at, names, quantity in summed) or usual
    if isinstance(chosen["time"], tuple):
        units["time"] = "ns"
        part_ns = pair[2] if pair and pair[:2] == chosen["time"] else 1
    intervals = _intervals(declared, names, headed, found["interval"], summed)
    if intervals and headed:
        units["interval"] = unit_of("interval", next(iter(intervals.values())), names)
    others = {f"interval.{quantity}": at for quantity, at in intervals.items()}
    # those of pps are said without columns, others are KEY.NUMBER
    more = {f"pps.{name}": value for name, value in declared.get("pps", {}).items()}
    for name, value in (more | declared.get("others", {})).items():
        key = name if name in more else name.rpartition(".")[0]
        others[name] = position(key, value, names, headed)
    check_each_once({q: [f"{i}, '{names[i]}'," for i in _tuple(at)] for q, at in chosen.items()})
    turned = [
        axis
        for quantity, axes in SENSORS.items()
        for axis, value in zip(axes, declared.get(quantity) or (), strict=False)
        if without_sign(value, names)[1]
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
    """Return the error of a log, whose columns are listed, without those of a sensor."""
    how = "number from 0" if columns.startswith("no header") else "name"
    such = ", such as [1, 2, 3]" * how.startswith("number")
    return Lacking(
        f"no columns of {quantity} found ({columns}); name its x, y, z by {how} in "
        f"columns.{quantity}{such}, or give both files where another holds it, {PAIR}, or declare "
        f"columns.{quantity}: null where it was not logged"
    )


def _only(quantity, found, names):
    """Return the columns found by their names, None of none; raise where others are as good."""
    if not found:
        return None
    where = found[0][0]
    if quantity in SENSORS:
        alike = ["/".join(names[i] for i in each) for each, _ in found[:2]]
    else:
        alike = [name for name in names if name.lower() == str(names[_tuple(where)[0]]).lower()]
    if len(alike) > 1:
        number = f", by number from 0 to {len(names) - 1}" * (alike[0] == alike[1])
        raise ImuloopError(
            f"{alike[0]} and {alike[1]} both look like {quantity}; name one of them in "
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


def _intervals(declared, names, headed, found, summed):
    """Return sensor -> position of the interval of its increments."""
    given = declared.get("interval")
    if given is None and "interval" not in declared and summed:
        # as of a vehicle_imu of PX4: delta_angle_dt, delta_velocity_dt
        joined = [" ".join(words_of(name)) for name in names]
        own = {q: joined.index(f"{n} dt") for q, n in summed.items() if f"{n} dt" in joined}
        if own and len(own) == len(summed):
            given = dict.fromkeys(SENSORS, next(iter(own.values()))) | own
        else:
            given = _only("interval", found, names)
    if given is not None and not isinstance(given, dict):
        given = dict.fromkeys(SENSORS, given)
    return {q: position("interval", at, names, headed) for q, at in (given or {}).items()}


def _declared(quantity, value, names, headed):
    """Return the position(s) of a declared column or several of them."""
    if value is None:
        return None
    several, sensor = isinstance(value, (list, tuple)), quantity in SENSORS
    wanted = len(AXES) if sensor else 2 if quantity == "time" else 0
    if len(value) != wanted if several else sensor:
        what = "a list of three columns x, y, z" if sensor else "a column"
        what += ", nor two of whole seconds and nanoseconds" * (quantity == "time")
        raise ImuloopError(f"columns.{quantity}: {value!r} is not {what}")
    if not several:
        return position(quantity, value, names, headed)
    bare = [without_sign(each, names)[0] if sensor else each for each in value]
    return tuple(position(quantity, each, names, headed) for each in bare)


def without_sign(column, names=()):
    """Return a declared column of a sensor, and whether its sign is turned: ``-AccX``, ``-3``."""
    if isinstance(column, str) and column.startswith("-") and column not in names:
        bare = column[1:]
        return (int(bare) if bare.isdecimal() else bare), True
    return column, False


def position(quantity, value, names, headed):
    """Return the position of a declared column, a name or a number from 0."""
    key = quantity if quantity.startswith(("pps", "reference")) else f"columns.{quantity}"
    number, count = isinstance(value, int) and not isinstance(value, bool), names.count(str(value))
    if number and 0 <= value < len(names):
        return value
    if headed and count == 1 and not number:
        return names.index(str(value))
    fault = f"no header, so {value!r} cannot be found; name it by number, 0 to {len(names) - 1}"
    if number:
        fault = f"there is no column {value}; the log has {len(names)}, numbered from 0"
    elif headed and count:
        fault = f"{count} columns are named '{value}'; name it by number, 0 to {len(names) - 1}"
    elif headed:
        fault = f"no column '{value}'; there are {listed(names)}"
        fault += did_you_mean(str(value), names, 0.5)
    raise ImuloopError(f"{key}: {fault}")


def listed(names, headed=True):
    """Return names as a message shows them: a file can have very many, or none."""
    if not headed:
        return f"no header, {len(names)} columns"
    shown = ", ".join(name[:80] for name in names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"
