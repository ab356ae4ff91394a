"""Parquet tables, whatever the names of their columns."""

import json

import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import CHANNELS, METADATA_KEY, TEMPERATURE
from imuloop.ingest.columns import listed, resolve
from imuloop.ingest.delimited import doubles
from imuloop.ingest.raw_log import STAMP, RawLog
from imuloop.ingest.stamps import stamp_array

ENDINGS = (".parquet", ".pq")


def read(paths, columns=None, batch_rows=1 << 16):
    """Read a Parquet table; ``simulated`` and ``units`` of the project's metadata are passed on.

    Parameters
    ----------
    paths : dict
        ``{"log": path}``.
    columns : dict, optional
        Quantity to columns; see `imuloop.ingest.columns.resolve`.
    batch_rows : int
        Rows held at once.

    Raises
    ------
    ImuloopError
        If a declared column is not there or holds no numbers.
    RejectedLog
        If the file is no Parquet file.
    """
    try:
        file = pq.ParquetFile(paths["log"])
        names = file.schema_arrow.names
        entries = file.schema_arrow.metadata or {}
    except Exception as error:
        # a column's name may not be text
        raise RejectedLog("the file is not a whole Parquet file") from error
    chosen = resolve(names, columns)
    metadata = _metadata(entries.get(METADATA_KEY, b"{}"))
    wanted = chosen.positions()
    used = list(dict.fromkeys(names[i] for i in wanted))
    # columns are read by name: of one that repeats all come, in the order of the file
    given = [i for name in used for i, other in enumerate(names) if other == name]

    def whole_batches():
        try:
            yield from file.iter_batches(batch_size=batch_rows, columns=used)
        except Exception as error:
            raise RejectedLog(f"the file cannot be read to its end: {error}") from error

    def batches():
        with file:
            for batch in whole_batches():
                table = dict(zip(given, batch.columns, strict=True))
                rest = iter(wanted[len(CHANNELS) :])
                arrays = {
                    channel: _numbers(table[i], names[i])
                    for channel, i in zip(CHANNELS, wanted, strict=False)
                }
                if chosen.time is not None:
                    i = next(rest)
                    arrays[STAMP] = _stamps(table[i], names[i])
                if chosen.temperature is not None:
                    i = next(rest)
                    arrays[TEMPERATURE] = _numbers(table[i], names[i])
                for name in chosen.others:
                    i = next(rest)
                    arrays[name] = _stamps(table[i], names[i])
                yield pa.RecordBatch.from_pydict(arrays)

    return RawLog(
        batches=batches(),
        temperature=chosen.temperature is not None,
        found=chosen.found(names),
        units={**chosen.units, **metadata["units"]},
        simulated=metadata["simulated"],
        columns=listed(names),
    )


def _metadata(text):
    """Return the units by quantity, and whether the log is simulated, as the project's text says.

    The text may be damaged.
    """
    try:
        said = json.loads(text)
        units = {quantity: str(unit) for quantity, unit in said.get("units", {}).items()}
        return {"units": units, "simulated": bool(said.get("simulated", False))}
    except (ValueError, AttributeError) as error:
        raise RejectedLog("the project's metadata in the Parquet file are damaged") from error


def _numbers(column, name):
    try:
        return doubles(column)
    except pa.ArrowException as error:
        raise ImuloopError(f"column '{name}' holds {column.type}, not numbers") from error


def _stamps(column, name):
    try:
        return stamp_array(column)
    except pa.ArrowException as error:
        raise ImuloopError(f"column '{name}' holds {column.type}, not stamps") from error
