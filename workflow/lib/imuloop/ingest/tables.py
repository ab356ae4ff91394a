"""Logs that are tables: columns of numbers, of both sensors, of one, or of both in turn."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import CHANNELS, TEMPERATURE, own_metadata, refuse_calibrated
from imuloop.ingest.columns import FRACTION, STAMP, lacking, listed, resolve
from imuloop.ingest.damage import reject_damage
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import AXES, SENSORS, words_of
from imuloop.ingest.stamps import (
    NANOSECONDS,
    absolute_nanoseconds,
    joined_stamps,
    stamp_array,
    stamp_values,
)
from imuloop.ingest.streams import SENSOR_OF, Stream, raw_log

PARQUET_ENDINGS = (".parquet", ".pq")
FEATHER_ENDINGS = (".feather", ".arrow")
# rows by which sensors in turn are told, and the least share of rows of one sensor alone
HEAD_ROWS, _ALONE = 1000, 0.1
# rates by which the unit of stamps is told, Hz
_RATES = (0.1, 1e5)
# time of Xsens: ticks of 100 us, or of a DOT, which has at most 120 Hz, of 1 us: longer steps
_TICKS, _TICKS_US, _LONG_STEP = "sample_time_fine", 100, 5000


def read_parquet(paths, columns=None):
    """Read a Parquet table; ``simulated`` and ``units`` of the project's metadata are passed on."""
    try:
        file = pq.ParquetFile(paths["log"])
        names = file.schema_arrow.names
        entries = file.schema_arrow.metadata or {}
    except Exception as error:
        # a column's name may not be text
        raise RejectedLog("the file is not a whole Parquet file") from error
    try:
        said = own_metadata(entries)
        units = {quantity: str(unit) for quantity, unit in said.get("units", {}).items()}
        known = {"units": units, "simulated": bool(said.get("simulated", False))}
    except (ValueError, AttributeError) as error:
        raise RejectedLog("the project's metadata in the Parquet file are damaged") from error
    refuse_calibrated(names, said)
    chosen = resolve(names, columns)
    used = list(dict.fromkeys(names[i] for i in chosen.raw().values()))
    # columns are read by name: of one that repeats all come, in the order of the file
    given = [i for name in used for i, other in enumerate(names) if other == name]

    try:
        with file:
            table = file.read(columns=used)
    except Exception as error:
        raise RejectedLog(f"the file cannot be read to its end: {error}") from error
    held = [table.column(given.index(i)) for i in chosen.raw().values()]
    return table_log(names, chosen, held, **known)


@reject_damage
def read_feather(paths, columns=None):
    """Read a Feather file of version 2, which is an Arrow file."""
    with open(paths["log"], "rb") as file:
        if file.read(4) == b"FEA1":
            raise RejectedLog("the file is Feather of version 1: save it as version 2, or Parquet")
    file = pa.ipc.open_file(paths["log"])
    names = file.schema.names
    refuse_calibrated(names, {})
    chosen = resolve(names, columns)

    table = file.read_all()
    # offsets of a damaged file may lead out of it
    table.validate(full=True)
    return table_log(names, chosen, [table.column(at) for at in chosen.raw().values()])


def table_log(names, chosen, columns, headed=True, **known):
    """Return the RawLog of a table with columns of these names, of which `chosen` are read.

    `columns` are those at the positions of ``chosen.raw()``, in their order; `known` are attributes
    that the log states itself.
    """
    log = RawLog(
        batch=_raw_batch(names, chosen, columns),
        found=chosen.found(names),
        units={**chosen.units, **known.pop("units", {})},
        columns=listed(names, headed),
        unread=len(names) - len(set(chosen.raw().values())),
        **known,
    )
    # the first rows show the unit of the stamps, and sensors in turn
    head = log.batch.slice(0, HEAD_ROWS)
    if tick := _unit_of_stamps(log, head):
        ticks, log.units["time"] = tick
        log.batch = multiplied(log.batch, ticks)
    lacks = in_turn(head)
    return two_streams(log, lacks) if lacks else log


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _unit_of_stamps(log, head):
    """Return the unit of stamps, and how many of it one tick is; None if the stamps do not show it.

    Stamps show it if they are Unix time in a finer unit than s, at a rate that a log has, or are
    ticks of Xsens.
    """
    name = log.found.get("time")
    if "time" in log.units or not isinstance(name, str):
        return None
    stamps, readable, dates = stamp_values(head[STAMP])
    stamps = stamps[readable]
    steps = np.diff(stamps)
    if dates or not (steps > 0).any():
        return None
    step = np.median(steps[steps > 0])
    if "_".join(words_of(name)).endswith(_TICKS):
        return (1 if step > _LONG_STEP else _TICKS_US), "us"
    for unit in ("ms", "us", "ns"):
        date = absolute_nanoseconds(stamps[0].item(), unit, False)
        if date is not None and _RATES[0] <= 1e9 / (step * NANOSECONDS[unit]) <= _RATES[1]:
            return 1, unit
    return None


def multiplied(batch, ticks):
    """Return a raw batch with stamps that are multiplied by a number; dates stay."""
    at = batch.schema.get_field_index(STAMP)
    if ticks == 1 or at < 0 or pa.types.is_timestamp(batch.schema.field(at).type):
        return batch
    return batch.set_column(at, STAMP, pc.multiply(batch[STAMP], ticks))


def _raw_batch(names, chosen, columns):
    """Return the raw batch of a table, of its columns in the order of ``chosen.raw()``."""
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
    """Return a column as float64; what is missing becomes NaN."""
    if column.type != pa.float64():
        # whole numbers of more than 53 bits are rounded
        column = column.cast(pa.float64(), safe=False)
    return column.fill_null(float("nan")) if column.null_count else column


def in_turn(head):
    """Return what tells the sensor that a row lacks, "zero" or "empty", "" if rows hold both.

    Rows of the accelerometer and of the gyroscope take turns in the head of such a table; where the
    other's columns are empty, some rows may hold both.
    """
    if not {STAMP, *CHANNELS} <= {*head.schema.names}:
        return ""
    values = np.array([head[name] for name in CHANNELS])
    most = _ALONE * values.shape[1]

    def turns(lacks):
        return np.count_nonzero(np.diff(lacks)) > most

    empty = [np.isnan(x).all(axis=0) for x in (values[:3], values[3:])]
    if any(map(turns, empty)):
        return "empty"
    # a gyroscope in whole deg/s can be zero at rest: each has to be, and no row may hold both
    zero = [~x.any(axis=0) for x in (values[:3], values[3:])]
    both = np.count_nonzero(zero[0] == zero[1])
    return "zero" if both < most and all(map(turns, zero)) else ""


def two_streams(log, lacking):
    """Return the RawLog of a table whose rows hold one sensor; `lacking` is of `in_turn`."""
    logs = {}
    for quantity, names in SENSORS.items():
        more = [TEMPERATURE] * (log.temperature and quantity == "acceleration")
        x = np.array([log.batch[name] for name in names])
        there = ~np.isnan(x) if lacking == "empty" else x != 0
        held = log.batch.filter(pa.array(there.any(axis=0))).select([STAMP, *names, *more])
        found = {key: log.found[key] for key in ("time", quantity, *more)}
        logs[quantity] = RawLog(batch=held, found=found, units=log.units)
    merged = _paired(logs)
    merged.columns, merged.simulated = log.columns, log.simulated
    merged.notes[:0] = ["the rows hold the accelerometer and the gyroscope in turn"]
    merged.lose(log)
    return merged


def _alone(quantity, columns):
    """Return what is declared of a table of one sensor among what is of two."""
    [other] = {*SENSORS} - {quantity}
    own = {key: value for key, value in (columns or {}).items() if key in ("time", quantity)}
    if isinstance(time := own.get("time"), dict):
        del own["time"]
        own |= {"time": time[quantity]} if quantity in time else {}
    return own | {other: None}


def read_pair(read, sources, columns=None):
    """Return the RawLog of an accelerometer's table and a gyroscope's, each on its own clock."""
    return _paired({q: read({"log": sources[q]}, _alone(q, columns)) for q in SENSORS})


def _paired(logs):
    """Return the RawLog of two logs, sensor -> that of it alone, each on its own clock."""
    streams, columns, total = [], {}, RawLog()
    for quantity, log in logs.items():
        if quantity not in log.found:
            raise lacking(quantity, log.columns)
    timed = {"time" in log.found for log in logs.values()}
    if len(timed) > 1:
        raise ImuloopError("columns.time: one of the two tables has no time column; name it")
    for quantity, log in logs.items():
        stream, more = _stream(quantity, log)
        streams.append(stream)
        columns[quantity] = [f"{stream.name}.{axis}" for axis in AXES]
        if log.temperature and TEMPERATURE not in columns:
            columns[TEMPERATURE] = f"{stream.name}.{TEMPERATURE}"
        total.notes += [note for note in log.notes if note not in total.notes]
        total.bad_lines += more
        total.lose(log)
    listed_columns = "; ".join(dict.fromkeys(log.columns for log in logs.values()))
    if timed == {False}:
        columns["time"] = None
        if len({len(stream.stamps) for stream in streams}) > 1:
            raise ImuloopError(
                f"the log has no time column of a usual name ({listed_columns}), and not as many "
                "rows of one sensor as of the other; name it in columns.time"
            )
    merged = raw_log(_of_one_unit(streams), columns, total.notes)
    merged.lose(total)
    for log in logs.values():
        # a unit of time that is not known is for the user to declare
        merged.units = log.units | merged.units
        merged.found |= {key: names for key, names in log.found.items() if key in merged.found}
    stamps = {quantity: log.found.get("time") for quantity, log in logs.items()}
    if stamps["acceleration"] != stamps["angular_rate"]:
        merged.found["time"] = stamps
    merged.columns = listed_columns
    return merged


def _stream(quantity, log):
    """Return a log of one sensor as a Stream, and how many of its rows lack a stamp."""
    count = log.batch.num_rows
    if not count:
        raise RejectedLog(f"the log of {quantity} has no rows")
    fields = {
        name: log.batch[name].to_numpy(zero_copy_only=False) for name in log.batch.schema.names
    }
    stamps, readable = np.arange(count), np.ones(count, dtype=bool)
    if STAMP in fields:
        stamps, readable, dates = stamp_values(log.batch[STAMP])
        if dates:
            log.units["time"] = "ns"
    stamps, fields = stamps[readable], {name: x[readable] for name, x in fields.items()}
    axes = dict(zip(AXES, SENSORS[quantity], strict=True))
    values = {axis: fields[name] for axis, name in axes.items()}
    if log.temperature:
        values[TEMPERATURE] = fields[TEMPERATURE]
    units = {key: log.units[key] for key in (quantity, TEMPERATURE) if key in log.units}
    if log.units.get("time") in NANOSECONDS:
        units["time"] = log.units["time"]
    return Stream(SENSOR_OF[quantity], stamps, values, units), count - len(stamps)


def _of_one_unit(streams):
    """Return streams whose stamps are of one unit: of several, ns."""
    units = {stream.units.get("time", "s") for stream in streams}
    if len(units) == 1:
        return streams
    found = []
    for stream in streams:
        stamps = np.round(stream.stamps * NANOSECONDS[stream.units.get("time", "s")])
        units = stream.units | {"time": "ns"}
        found.append(replace(stream, stamps=stamps.astype(np.int64), units=units))
    return found
