"""Parquet tables, whatever the names of their columns."""

import pyarrow.parquet as pq

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import own_metadata, refuse_calibrated
from imuloop.ingest.columns import resolve
from imuloop.ingest.tables import table_log

ENDINGS = (".parquet", ".pq")


def read(paths, columns=None, batch_rows=1 << 16):
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

    def batches():
        with file:
            try:
                for batch in file.iter_batches(batch_rows, columns=used):
                    yield [batch.column(given.index(i)) for i in chosen.raw().values()]
            except Exception as error:
                raise RejectedLog(f"the file cannot be read to its end: {error}") from error

    return table_log(names, chosen, batches(), **known)
