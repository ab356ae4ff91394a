"""Logs that are tables of both sensors, of one sensor, or of both sensors in turn."""

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

# number of first rows that show the unit of the stamps, and whether the sensors take turns; they do
# if more than this share of the rows begins or ends a turn
HEAD_ROWS, _TURNS = 1000, 0.1
# Xsens counts 100 us in sample_time_fine, but 1 us in a DOT; a DOT has at most 120 Hz, so that its
# steps are longer than `_LONG_STEP` ticks
_TICKS, _TICK_US, _LONG_STEP = "sample_time_fine", 100, 5000


def table_log(names, chosen, columns, headed=True, tick=1, **known):
    """Return the RawLog of a table.

    Parameters
    ----------
    names : list of str
        Names of all columns of the table.
    chosen : Columns
        The columns that are read.
    columns : list of pyarrow.Array
        The columns at the positions of ``chosen.raw()``, in their order.
    headed : bool
        Whether the names are from the table; otherwise they are numbers.
    tick : float
        Factor from the time stamps to the unit of time.
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
    """Return the units of the chosen columns by quantity; `texts` are the units of all columns."""
    # in brackets, as in the name of a column
    names, units = [f"[{text.strip('[]{} ')}]" for text in texts], {}
    for quantity in ("time", *SENSORS, "temperature"):
        if (where := getattr(chosen, quantity)) is not None:
            units[quantity] = unit_of(quantity, where, names, quantity in chosen.increments)
    return {quantity: unit for quantity, unit in units.items() if unit}


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _unit_of_stamps(log):
    """Return the number of units in a tick of the stamps, and the unit; None if it is not clear.

    The unit is clear if the stamps of the RawLog are Unix time in a finer unit than s, at a
    plausible rate, or ticks of Xsens.
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
    """Return the rows of a table as a RecordBatch with the raw columns.

    `names` are the names of all columns, `chosen` are the Columns that are read, and `columns` are
    their Arrow arrays in the order of ``chosen.raw()``. Raises an ImuloopError if a column has the
    wrong type.
    """
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
    """Return a RawLog whose rows hold both sensors.

    If the rows of `log` hold the two sensors in turn, the rows of each sensor are a log, and these
    two logs are joined. Otherwise the result is `log`.
    """
    if not {STAMP, *CHANNELS} <= {*log.batch.schema.names}:
        return log

    def rows_without(lacks, batch):
        """Return which of n rows lack all axes of each sensor, (2, n) of bool."""
        values = np.array([batch[name] for name in CHANNELS]).reshape(2, len(AXES), -1)
        return lacks(values).all(axis=1)

    head = log.batch.slice(0, HEAD_ROWS)
    many = _TURNS * head.num_rows
    empty, zero = rows_without(np.isnan, head), rows_without(np.logical_not, head)
    turns = [np.count_nonzero(np.diff(rows), axis=1) > many for rows in (empty, zero)]
    # zeros show turns if each sensor is zero in turn and few rows hold both or none: a gyroscope
    # alone may be zero at rest
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
    """Return the RawLog of a table for each sensor, each on its own clock.

    `sources` has the path of each table by quantity, and `columns` are the declared columns. Each
    table is read by ``read(paths, columns)``. Raises an ImuloopError if a table lacks its sensor.
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
