"""A log as it was written: what each reader gives, and its rows as arrays."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest.columns import STAMP, lacking
from imuloop.ingest.spellings import AXES, SENSORS, is_iso, unknown_unit
from imuloop.ingest.stamps import no_stamps, stamp_values


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
    the sensor, of two with their own clocks, whose samples are put beside those of the other:
    its own stamps are the column `held` then; `sensor_ids`, by sensor, number and slot of its own
    where the log's autopilot has them.
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


@dataclass(frozen=True)
class Rows:
    """All rows of a log as arrays (n,).

    `values` are the six axes and the temperature as logged, by name; those of a sensor that the log
    lacks are 0. `stamps` are its columns of time stamps by name, as `stamp_values` gives them. `x`
    are the time stamps, or the numbers of the rows, of `scale` s each; `readable` tells which of
    them can be read, `dates` whether they are ns since 1970.
    """

    values: dict
    stamps: dict
    x: np.ndarray
    readable: np.ndarray
    dates: bool
    scale: float

    @property
    def stamped(self):
        """Whether the log holds time stamps."""
        return STAMP in self.stamps

    @cached_property
    def same(self):
        """Rows that repeat the one before in time stamp and all values."""
        same = np.zeros(len(self.x), dtype=bool)
        at = np.flatnonzero((self.x[1:] == self.x[:-1]) & self.readable[1:]) + 1
        for values in self.values.values():
            one, other = values[at], values[at - 1]
            at = at[(one == other) | (np.isnan(one) & np.isnan(other))]
        same[at] = True
        return same


def all_rows(log, units, rate):
    """Return the `Rows` of a log; `rate` is the declared one, Hz, of a log without time stamps."""
    batch, count = log.batch, log.batch.num_rows
    values, stamps = dict.fromkeys(CHANNELS, np.zeros(count)), {}
    for name in batch.schema.names:
        if name in (*CHANNELS, TEMPERATURE):
            values[name] = batch[name].to_numpy(zero_copy_only=False)
        else:
            stamps[name] = stamp_values(batch[name])
    if count and STAMP in stamps:
        x, readable, dates = stamps[STAMP]
        name, unit = log.found.get("time"), units["time"]
        if not readable.any():
            raise no_stamps(batch[STAMP], name)
        if not dates and is_iso(unit):
            raise ImuloopError(
                f"units.time is ISO 8601, but column '{name}' holds numbers; use one of "
                f"{', '.join(TIME_SCALES)}"
            )
        if not dates and unit not in TIME_SCALES:
            raise unknown_unit("time", unit)
        return Rows(values, stamps, x, readable, dates, 1e-9 if dates else TIME_SCALES[unit])
    if count and not rate:
        raise ImuloopError(
            f"the log has no time column of a usual name ({log.columns}); "
            "name it in columns.time, or give rate in Hz"
        )
    step = 1 / rate if rate else 1.0
    return Rows(values, stamps, np.arange(count), np.ones(count, dtype=bool), False, step)
