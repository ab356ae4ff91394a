"""A log as it was written: what each reader gives."""

from dataclasses import dataclass, field

import pyarrow as pa

from imuloop.core.samples import TEMPERATURE
from imuloop.ingest.columns import lacking
from imuloop.ingest.spellings import AXES, SENSORS


@dataclass
class RawLog:
    """A log as it was read.

    `batch` are its rows, with the columns `stamp` (int64, float64 or timestamp[ns];
    absent without a time column), `ax ay az gx gy gz` (of one sensor those alone; `absent_sensor`)
    and, where `temperature`, it too (float64, raw units). `found` and `units` map a quantity to its
    columns, and to the unit that the file states, `nominal` a sensor to the scale of its counts, as
    in the config, where the file states that; `columns` lists all columns, `unread` is how many of
    a table's are not read, `notes` say how the file was read. `lost_bytes` are those in
    `bad_lines`, `text_bytes` those in all lines, without blanks and unwritten memory; `slower` is
    the sensor, of two with different clocks, whose samples are put into the rows of the other: its
    stamps are the column `held` then; `sensor_ids`, by sensor, are number and slot in an autopilot.
    """

    batch: pa.RecordBatch = field(default_factory=lambda: pa.RecordBatch.from_pydict({}))
    found: dict = field(default_factory=dict)
    units: dict = field(default_factory=dict)
    nominal: dict = field(default_factory=dict)
    simulated: bool = False
    notes: list[str] = field(default_factory=list)
    bad_lines: int = 0
    lost_bytes: int = 0
    text_bytes: int = 0
    slower: str | None = None
    columns: str = ""
    unread: int = 0
    sensor_ids: dict = field(default_factory=dict)

    @property
    def temperature(self):
        """Whether the log holds a temperature."""
        return TEMPERATURE in self.found

    def lose(self, count):
        """Add the bad lines and the bytes of a part of the log that was counted by itself."""
        self.bad_lines += count.bad_lines
        self.lost_bytes += count.lost_bytes
        self.text_bytes += count.text_bytes


def absent_sensor(log, columns):
    """Return the quantity that a log of one sensor lacks, None of both sensors.

    It was not logged where `columns`, as declared, say so by None, or where the table has fewer
    further columns than axes; else the ImuloopError says that its columns are not known.
    """
    lacks = [quantity for quantity in SENSORS if quantity not in log.found]
    for quantity in lacks:
        said = quantity in columns and columns[quantity] is None
        if len(lacks) > 1 or not (said or log.unread < len(AXES)):
            raise lacking(quantity, log.columns)
    return lacks[0] if lacks else None
