"""A log as it was written, the result of each reader."""

from dataclasses import dataclass, field

import pyarrow as pa

from imuloop.core.samples import TEMPERATURE
from imuloop.ingest.columns import lacking
from imuloop.ingest.spellings import AXES, SENSORS


@dataclass
class RawLog:
    """A log as it was read.

    `batch` has the rows. Its columns are `stamp` (int64, float64 or timestamp[ns]; absent without a
    time column), `ax ay az gx gy gz` (float64, raw units; a log of one sensor has only its axes),
    and `temperature` if it is logged (float64, raw unit). The other fields are

    - `names`, `units`: names of the columns of each quantity, and units that the file states;
    - `nominal`: scale of the counts of each sensor, as in the config, if the file states it;
    - `simulated`: whether the log is simulated;
    - `notes`: lines on how the file was read;
    - `bad_lines`, `lost_bytes`: number of lines that cannot be read, and of the bytes in them;
    - `text_bytes`: number of bytes in all lines, but for blanks and unwritten memory;
    - `slower`: if two sensors have different clocks, the sensor whose samples are put into the rows
      of the other one; the column `held` has their time stamps;
    - `columns`, `unread`: a text that lists all columns, and the number of columns not read;
    - `sensor_ids`: device id and slot of each sensor in an autopilot.
    """

    batch: pa.RecordBatch = field(default_factory=lambda: pa.RecordBatch.from_pydict({}))
    names: dict = field(default_factory=dict)
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
        return TEMPERATURE in self.names

    def lose(self, count):
        """Add to this log the bad lines and bytes that were counted in `count`, another RawLog."""
        self.bad_lines += count.bad_lines
        self.lost_bytes += count.lost_bytes
        self.text_bytes += count.text_bytes


def absent_sensor(log, columns):
    """Return the quantity of the sensor that a log lacks, or None if it has both sensors.

    `log` is the RawLog. A sensor was not logged if it is None in the declared `columns`, or if the
    table has fewer unread columns than a sensor has axes, so that they cannot hold one. An
    ImuloopError is raised if a sensor is lacking for neither reason: some unread columns may hold
    it.
    """
    lacks = [quantity for quantity in SENSORS if quantity not in log.names]
    for quantity in lacks:
        said = quantity in columns and columns[quantity] is None
        if len(lacks) > 1 or not (said or log.unread < len(AXES)):
            raise lacking(quantity, log.columns)
    return lacks[0] if lacks else None
