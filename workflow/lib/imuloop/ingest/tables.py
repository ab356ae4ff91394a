"""Logs that are tables: columns of numbers, of both sensors, of one, or of both in turn."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.columns import FRACTION, STAMP, lacking, listed
from imuloop.ingest.join import SENSOR_OF, join
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import AXES, SENSORS, unit_of, words_of
from imuloop.ingest.stamps import (
    NANOSECONDS,
    PLAUSIBLE_RATE,
    absolute_nanoseconds,
    joined_stamps,
    stamp_array,
    stamp_values,
)

# rows that show the unit of the stamps, and whether the sensors take turns; they do if more than
# this share of the rows begins or ends a turn
HEAD_ROWS, _TURNS = 1000, 0.1
# Xsens counts 100 us in sample_time_fine, but 1 us in a DOT; a DOT has at most 120 Hz, so that its
# steps are longer than `_LONG_STEP` ticks
_TICKS, _TICK_US, _LONG_STEP = "sample_time_fine", 100, 5000


def table_log(names, chosen, columns, headed=True, tick=1, **known):
    """Return the RawLog of a table.

    Parameters
    ----------
    names : list of str
        All columns of the table.
    chosen : Columns
        Which of these are read.
    columns : list of pyarrow.Array
        Those at the positions of ``chosen.raw()``, in their order.
    headed : bool
        Whether the names are the table's, not numbers.
    tick : float
        Units of time in one step of the time stamps.
    **known
        Attributes of the RawLog that the file states itself.
    """
    log = RawLog(
        batch=_raw_batch(names, chosen, columns),
        found=chosen.found(names),
        units={**chosen.units, **known.pop("units", {})},
        columns=listed(names, headed),
        unread=len(names) - len(set(chosen.raw().values())),
        **known,
    )
    if unit := _unit_of_stamps(log):
        tick, log.units["time"] = unit
    at = log.batch.schema.get_field_index(STAMP)
    # dates have no tick
    if tick != 1 and at >= 0 and not pa.types.is_timestamp(log.batch[STAMP].type):
        log.batch = log.batch.set_column(at, STAMP, pc.multiply(log.batch[STAMP], tick))
    return _without_turns(log)


def stated_units(chosen, texts):
    """Return quantity -> unit of the chosen columns; `texts` are the units of all columns."""
    # as in a column's name
    names, units = [f"[{text.strip('[]{} ')}]" for text in texts], {}
    for quantity in ("time", *SENSORS, "temperature"):
        if (where := getattr(chosen, quantity)) is not None:
            units[quantity] = unit_of(quantity, where, names, quantity in chosen.increments)
    return {quantity: unit for quantity, unit in units.items() if unit}


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _unit_of_stamps(log):
    """Return the units in one tick of the stamps, and the unit; None if it is not clear.

    It is clear if they are Unix time in a finer unit than s, at a rate that a log has, or ticks of
    Xsens.
    """
    name = log.found.get("time")
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


def _raw_batch(names, chosen, columns):
    """Return the raw batch of a table; parameters are as in `table_log`."""
    raw, arrays = chosen.raw(), {}
    for key, column in zip(raw, columns, strict=True):
        if isinstance(column, pa.ChunkedArray):
            column = column.combine_chunks()
        number = key in CHANNELS or key == TEMPERATURE
        try:
            arrays[key] = doubles(column) if number else stamp_array(column)
        except pa.ArrowException as error:
            what = "numbers" if number else "stamps"
            raise ImuloopError(
                f"column '{names[raw[key]]}' holds {column.type}, not {what}"
            ) from error
    arrays |= {axis: pc.negate(arrays[axis]) for axis in chosen.turned}
    if FRACTION in arrays:
        arrays[STAMP] = joined_stamps(arrays[STAMP], arrays.pop(FRACTION), chosen.part_ns)
    return pa.RecordBatch.from_pydict(arrays)


def doubles(column):
    """Return a column as float64; missing values become NaN."""
    # whole numbers of more than 53 bits are rounded
    column = column.cast(pa.float64(), safe=False)
    return column.fill_null(float("nan")) if column.null_count else column


def _without_turns(log):
    """Return the log; if its rows hold one sensor each, the log of its two streams, joined."""
    if not {STAMP, *CHANNELS} <= {*log.batch.schema.names}:
        return log

    def rows_without(lacks, batch):
        """Return which rows lack all axes of a sensor, shape (2, n)."""
        values = np.array([batch[name] for name in CHANNELS]).reshape(2, len(AXES), -1)
        return lacks(values).all(axis=1)

    head = log.batch.slice(0, HEAD_ROWS)
    many = _TURNS * head.num_rows
    empty, zero = rows_without(np.isnan, head), rows_without(np.logical_not, head)
    turns = [np.count_nonzero(np.diff(rows), axis=1) > many for rows in (empty, zero)]
    # a gyroscope in whole deg/s can be zero at rest: each has to be, and no row may hold both
    zeros = turns[1].all() and np.count_nonzero(zero[0] == zero[1]) < many
    if not (turns[0].any() or zeros):
        return log
    lost, logs = rows_without(np.isnan if turns[0].any() else np.logical_not, log.batch), {}
    notes = [*log.notes, "the rows hold the accelerometer and the gyroscope in turn"]
    for (quantity, names), absent in zip(SENSORS.items(), lost, strict=True):
        more = [TEMPERATURE] * (log.temperature and quantity == "acceleration")
        batch = log.batch.filter(pa.array(~absent)).select([STAMP, *names, *more])
        found = {key: log.found[key] for key in ("time", quantity, *more)}
        logs[SENSOR_OF[quantity]] = replace(log, batch=batch, found=found, notes=notes)
    return join(logs)


def read_pair(read, sources, columns=None):
    """Return the RawLog of an accelerometer's table and a gyroscope's, each on its own clock.

    ``read(paths, columns)`` reads each of `sources`, quantity -> path.
    """
    logs = {}
    for quantity, other in zip(SENSORS, [*SENSORS][::-1], strict=True):
        own = {key: x for key, x in (columns or {}).items() if key in ("time", quantity)}
        if isinstance(time := own.get("time"), dict):
            del own["time"]
            own |= {"time": time[quantity]} if quantity in time else {}
        log = read({"log": sources[quantity]}, own | {other: None})
        if quantity not in log.found:
            raise lacking(quantity, log.columns)
        logs[SENSOR_OF[quantity]] = log
    return join(logs)
