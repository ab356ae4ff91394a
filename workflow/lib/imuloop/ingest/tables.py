"""Logs that are tables: one of both sensors, one for each sensor, or one of both in turn."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.columns import FRACTION, STAMP, lacking, listed
from imuloop.ingest.join import SENSOR_OF, join
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import AXES, SENSORS, words_of
from imuloop.ingest.stamps import (
    NANOSECONDS,
    PLAUSIBLE_RATE,
    absolute_nanoseconds,
    joined_stamps,
    stamp_array,
    stamp_values,
)

# number of first rows that show the unit of the stamps, and whether the sensors take turns; they do
# if more than this share of the rows begins or ends a turn
HEAD_ROWS, _TURNS = 1000, 0.1
# Xsens counts 100 us in sample_time_fine, but 1 us in a DOT; a DOT has at most 120 Hz, so that its
# steps are longer than `_LONG_STEP` ticks
_TICKS, _TICK_US, _LONG_STEP = "sample_time_fine", 100, 5000


def table_log(names, chosen, columns, headed=True, tick=1, units=(), **facts):
    """Return the RawLog of a table.

    Parameters
    ----------
    names : list of str
        Names of all columns of the table.
    chosen : Columns
        The columns that are read.
    columns : list of pyarrow.Array
        The columns at the positions of ``chosen.raw``, in their order.
    headed : bool
        Whether the names are from the table; otherwise they are numbers.
    tick : float
        Factor by which the time stamps are multiplied to have the unit of time.
    units : dict
        Units by quantity that come before the units of ``chosen``.
    **facts
        Further attributes of the RawLog.

    Raises
    ------
    ImuloopError
        If a column has the wrong type.
    """
    raw = {}
    for (key, at), column in zip(chosen.raw.items(), columns, strict=True):
        if isinstance(column, pa.ChunkedArray):
            column = column.combine_chunks()
        number = key in CHANNELS or key == TEMPERATURE
        try:
            raw[key] = doubles(column) if number else stamp_array(column)
        except pa.ArrowException as error:
            what = "numbers" if number else "stamps"
            raise ImuloopError(f"column '{names[at]}' holds {column.type}, not {what}") from error
        if key in chosen.turned:
            raw[key] = pc.negate(raw[key])
    if FRACTION in raw:
        raw[STAMP] = joined_stamps(raw[STAMP], raw.pop(FRACTION), chosen.part_ns)
    log = RawLog(
        batch=pa.RecordBatch.from_pydict(raw),
        names=chosen.names_by_quantity(names),
        units=chosen.units | dict(units),
        columns=listed(names, headed),
        unread=len(names) - len({*chosen.raw.values()}),
        **facts,
    )
    if unit := _unit_of_stamps(log):
        tick, log.units["time"] = unit
    # dates have no tick
    if tick != 1 and STAMP in raw and not pa.types.is_timestamp(raw[STAMP].type):
        at = log.batch.schema.get_field_index(STAMP)
        log.batch = log.batch.set_column(at, STAMP, pc.multiply(raw[STAMP], tick))
    return _without_turns(log)


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _unit_of_stamps(log):
    """Return the tick of the time stamps of a log and their unit; None if the unit is not clear.

    The tick is a factor: stamps multiplied by it are in the unit. `log` is the RawLog. The unit is
    clear in two cases: the stamps are Unix time in ms, us or ns and have a plausible rate, or their
    column has Xsens' name for its ticks, sample time fine. If the file states the unit, the result
    is None, too.
    """
    name = log.names.get("time")
    if "time" in log.units or not isinstance(name, str):
        return None
    stamps, readable, dates = stamp_values(log.batch[STAMP].slice(0, HEAD_ROWS))
    stamps = stamps[readable]
    steps = np.diff(stamps)
    if dates or not (steps > 0).any():
        return None
    step = np.median(steps[steps > 0])
    if "_".join(words_of(name)).endswith(_TICKS):
        return (1 if step > _LONG_STEP else _TICK_US), "us"
    for unit in ("ms", "us", "ns"):
        date = absolute_nanoseconds(stamps[0].item(), unit, False)
        slowest, fastest = PLAUSIBLE_RATE
        if date is not None and slowest <= 1e9 / (step * NANOSECONDS[unit]) <= fastest:
            return 1, unit
    return None


def doubles(column):
    """Return a column, an Arrow array, as float64; missing values become NaN."""
    # whole numbers of more than 53 bits are rounded
    column = column.cast(pa.float64(), safe=False)
    return column.fill_null(float("nan")) if column.null_count else column


def _without_turns(log):
    """Return a RawLog whose rows hold both sensors, from one whose rows may hold them in turn.

    Rows hold the accelerometer and the gyroscope in turn if in each of them the other sensor is
    not-a-number or zero. Then the rows of each sensor become a separate log, and the two logs are
    joined. Otherwise the result is `log` itself.
    """
    if not {STAMP, *CHANNELS} <= {*log.batch.schema.names}:
        return log
    head = log.batch.slice(0, HEAD_ROWS)
    many = _TURNS * head.num_rows
    for lacks in (np.isnan, np.logical_not):
        absent = _absent(head, lacks)
        turns = np.count_nonzero(np.diff(absent), axis=1) > many
        # zeros show turns if each sensor is zero in turn and few rows hold both or none: a
        # gyroscope alone may be zero at rest
        zeros = turns.all() and np.count_nonzero(absent[0] == absent[1]) < many
        if turns.any() if lacks is np.isnan else zeros:
            break
    else:
        return log
    notes, logs = [*log.notes, "the rows hold the accelerometer and the gyroscope in turn"], {}
    for (quantity, axes), rows in zip(SENSORS.items(), ~_absent(log.batch, lacks), strict=True):
        more = [TEMPERATURE] * (log.temperature and quantity == "acceleration")
        batch = log.batch.filter(pa.array(rows)).select([STAMP, *axes, *more])
        names = {key: log.names[key] for key in ("time", quantity, *more)}
        logs[SENSOR_OF[quantity]] = replace(log, batch=batch, names=names, notes=notes)
    return join(logs)


def _absent(batch, lacks):
    """Return whether each of n rows lacks all axes of each of the two sensors, (2, n) of bool.

    The first axis is accelerometer, gyroscope. `batch` has the rows. The function ``lacks(values)``
    returns a mask of the values that count as absent: not-a-number, or zeros.
    """
    values = np.array([batch[name] for name in CHANNELS]).reshape(2, len(AXES), -1)
    return lacks(values).all(axis=1)


def read_tables(tables, read, columns):
    """Return the RawLog of several tables, each with its own clock.

    Parameters
    ----------
    tables : dict
        Name of the table that holds each quantity, by quantity.
    read : callable
        ``read(name, columns)`` returns the RawLog of a table.
    columns : dict
        Declared columns by quantity; the columns of time may be a dict by quantity.

    Raises
    ------
    ImuloopError
        If a table lacks its sensor.
    """
    logs = {}
    for name in dict.fromkeys(tables.values()):
        quantities = [quantity for quantity, table in tables.items() if table == name]
        declared = {q: x for q, x in columns.items() if q in ("time", *quantities) or x is None}
        if isinstance(times := declared.get("time"), dict):
            del declared["time"]
            for quantity in times.keys() & {*quantities}:
                declared["time"] = times[quantity]
        # a quantity that is read from another table is not logged in this one
        declared |= dict.fromkeys({*tables}.difference(quantities))
        logs[name] = read(name, declared)
        for quantity in quantities:
            if quantity in SENSORS and quantity not in logs[name].names:
                raise lacking(quantity, logs[name].columns)
    return join(logs) if len(logs) > 1 else logs[name]


def read_pair(read, paths, columns=None):
    """Return the RawLog of a log in two tables, one for each sensor.

    `paths` has the path of each table by quantity, and `columns` are the declared columns by
    quantity, or None. Each table is read by the function ``read(paths, columns)``.
    """
    files = {SENSOR_OF[quantity]: path for quantity, path in paths.items()}
    return read_tables(SENSOR_OF, lambda name, x: read({"log": files[name]}, x), columns or {})
