"""A log as it was written: what each reader gives, before units and time zero."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import pyarrow as pa

# name of the stamps in raw batches; absent where the log has no time column
STAMP = "stamp"


@dataclass
class RawLog:
    """A log being read; the counts grow while `batches` is consumed.

    Attributes
    ----------
    batches : iterator of pyarrow.RecordBatch
        Columns `stamp` (int64, float64 or timestamp[ns]; absent without a time column),
        `ax ay az gx gy gz` and, where logged, `temperature` (float64, raw units).
    temperature : bool
        Whether the log holds a temperature.
    found : dict
        Quantity to the names of its columns, for messages and provenance.
    units : dict
        Quantity to the unit that the file itself states, where it does.
    simulated : bool
        Whether the file says that it is simulated.
    notes : list of str
        What a user should know of how the file was read.
    bad_lines : int
        Lines that are no row of the table.
    lost_bytes, text_bytes : int
        Bytes in these lines, and in all of a text; blanks and unwritten memory are in neither.
    position : int
        Bytes of the file read so far, 0 where the reader does not tell.
    interpolated : set of str
        Sensors that are interpolated onto the clock of the other.
    columns : str
        What columns the log has, for messages.
    threads : int
        How many the reader may use, set before the first batch is taken; changes no result.
    """

    batches: Iterator[pa.RecordBatch]
    temperature: bool
    found: dict
    units: dict = field(default_factory=dict)
    simulated: bool = False
    notes: list[str] = field(default_factory=list)
    bad_lines: int = 0
    lost_bytes: int = 0
    text_bytes: int = 0
    position: int = 0
    interpolated: set = field(default_factory=set)
    columns: str = ""
    threads: int = 1

    def lose(self, count):
        """Add the bad lines and the bytes of a part of the log that was counted by itself."""
        self.bad_lines += count.bad_lines
        self.lost_bytes += count.lost_bytes
        self.text_bytes += count.text_bytes


def rechunked(batches, rows):
    """Give the rows of `batches` in tables of `rows` rows, the last one shorter.

    Makes everything that follows independent of the sizes in which a reader happens to read.
    """
    held, count = [], 0
    for batch in batches:
        while count + batch.num_rows >= rows:
            head = batch.slice(0, rows - count)
            batch = batch.slice(rows - count)
            yield pa.Table.from_batches([*held, head]).combine_chunks()
            held, count = [], 0
        if batch.num_rows:
            held.append(batch)
            count += batch.num_rows
    if held:
        yield pa.Table.from_batches(held).combine_chunks()
