"""A log as it was written: what each reader gives, before units and time zero."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import pyarrow as pa

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.columns import AXES, listed
from imuloop.ingest.stamps import stamp_array

# more columns than a matrix of samples has
WIDEST = 64


@dataclass
class RawLog:
    """A log being read; the counts grow while `batches` is consumed.

    `batches` have the columns `stamp` (int64, float64 or timestamp[ns]; absent without a time
    column), `ax ay az gx gy gz` and, where `temperature`, it too (float64, raw units). `found` and
    `units` map a quantity to its columns, and to the unit that the file states; `columns` lists all
    columns, `notes` say how the file was read. `lost_bytes` are those in `bad_lines`, `text_bytes`
    those in all lines, without blanks and unwritten memory; `slower` is the sensor, of two with
    clocks of their own, whose samples are put beside those of the other: its own stamps are the
    column `held` then; `sensor_ids`, by sensor, number and slot of its own where the log's
    autopilot has them. `threads`, set before the first batch is taken, changes no result.
    """

    batches: Iterable[pa.RecordBatch] = ()
    found: dict = field(default_factory=dict)
    units: dict = field(default_factory=dict)
    simulated: bool = False
    notes: list[str] = field(default_factory=list)
    bad_lines: int = 0
    lost_bytes: int = 0
    text_bytes: int = 0
    slower: str | None = None
    columns: str = ""
    sensor_ids: dict = field(default_factory=dict)
    threads: int = 1

    @property
    def temperature(self):
        """Whether the log holds a temperature."""
        return TEMPERATURE in self.found

    def lose(self, count):
        """Add the bad lines and the bytes of a part of the log that was counted by itself."""
        self.bad_lines += count.bad_lines
        self.lost_bytes += count.lost_bytes
        self.text_bytes += count.text_bytes


def table_log(names, chosen, batches, **known):
    """Return the RawLog of a table with columns of these names, of which `chosen` are read.

    `batches` give the columns at ``chosen.positions()``, in their order, a part of the rows at
    once; `known` are attributes that the log states itself.
    """
    known["units"] = {**chosen.units, **known.get("units", {})}

    def converted(key, position, column):
        number = key in CHANNELS or key == TEMPERATURE
        try:
            return doubles(column) if number else stamp_array(column)
        except pa.ArrowException as error:
            what = "numbers" if number else "stamps"
            raise ImuloopError(
                f"column '{names[position]}' holds {column.type}, not {what}"
            ) from error

    def raw_batches():
        for columns in batches:
            parts = zip(chosen.keys(), chosen.positions(), columns, strict=True)
            yield pa.RecordBatch.from_pydict({part[0]: converted(*part) for part in parts})

    return RawLog(
        batches=raw_batches(),
        found=chosen.found(names),
        **{"columns": listed(names), **known},
    )


def doubles(column):
    """Return a column as float64; what is missing becomes NaN."""
    if column.type != pa.float64():
        # whole numbers of more than 53 bits are rounded
        column = column.cast(pa.float64(), safe=False)
    return column.fill_null(float("nan")) if column.null_count else column


def column_names(name, width):
    """Return the names of the columns of a matrix: none of one wider than `WIDEST`."""
    if width == 1:
        return [name]
    labels = AXES if width == len(AXES) else range(width if width <= WIDEST else 0)
    return [f"{name}.{label}" for label in labels]


def by_axis(columns):
    """Return declared columns with each matrix of a sensor as its three columns."""
    return {
        quantity: [f"{value}.{axis}" for axis in AXES]
        if isinstance(value, str) and quantity in ("acceleration", "angular_rate")
        else value
        for quantity, value in (columns or {}).items()
    }


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
