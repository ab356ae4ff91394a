"""imu_tk's two text files without header, `t x y z` each, on one clock."""

from itertools import zip_longest

import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.ingest.columns import STAMP, unit_of
from imuloop.ingest.delimited import numbers, text_batches
from imuloop.ingest.raw_log import RawLog, rechunked
from imuloop.ingest.stamps import parse_stamps, stamp_values
from imuloop.ingest.text_layout import find_layout

FILES = ("acceleration", "angular_rate")


def read(paths, columns=None, batch_rows=1 << 16):
    """Read an accelerometer's and a gyroscope's file of the same rows and stamps.

    The format has fixed `columns`, time and three axes; a header can only state their units.
    """
    if columns:
        raise ImuloopError("imu_tk files have fixed columns t x y z; leave columns out")
    found = {"time": "0", **{name: ["1", "2", "3"] for name in FILES}}
    log = RawLog(found=found)
    layouts = {}
    for name in FILES:
        layouts[name] = find_layout(paths[name])
        if len(layouts[name].names) != 4:
            raise ImuloopError(
                f"{paths[name]}: an imu_tk file has four columns t x y z, "
                f"this one has {len(layouts[name].names)}"
            )
        for quantity, where in (("time", 0), (name, (1, 2, 3))):
            unit = unit_of(quantity, where, layouts[name].names)
            if log.units.setdefault(quantity, unit) != unit:
                raise RejectedLog(f"the two files state different units of {quantity}")
    log.units = {quantity: unit for quantity, unit in log.units.items() if unit}
    streams = [
        rechunked(text_batches(paths[name], layouts[name], range(4), batch_rows, log), batch_rows)
        for name in FILES
    ]
    log.batches = _merged(streams)
    return log


def _merged(streams):
    row = 0
    for force, rate in zip_longest(*streams):
        rows = [0 if part is None else part.num_rows for part in (force, rate)]
        if rows[0] != rows[1]:
            counts = [row + n for n in rows]
            for i, stream in enumerate(streams):
                counts[i] += sum(part.num_rows for part in stream)
            raise RejectedLog(
                f"the acceleration file has {counts[0]} rows, the angular rate file {counts[1]}: "
                "they are not one clock's rows"
            )
        stamps = [parse_stamps(part["0"].combine_chunks()) for part in (force, rate)]
        (first, ok_first, _), (second, ok_second, _) = map(stamp_values, stamps)
        differ = (first != second) & ok_first & ok_second
        if differ.any():
            i = int(differ.argmax())
            raise RejectedLog(
                f"row {row + i}: the acceleration is stamped {first[i]}, the angular rate "
                f"{second[i]}: the two files are not on one clock"
            )
        arrays = {STAMP: stamps[0]}
        for part, names in ((force, ACCELERATION), (rate, ANGULAR_RATE)):
            for i, name in enumerate(names):
                arrays[name] = numbers(part[str(i + 1)].combine_chunks())
        yield pa.RecordBatch.from_pydict(arrays)
        row += rows[0]
