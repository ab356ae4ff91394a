"""The table of the app SensorLog, whose rows hold several sensors, each on its own clock.

iOS gives the opposite of specific force, in g: a phone that lies face up reads z = -1.
"""

import re

import numpy as np

from imuloop.core.errors import RejectedLog, plural
from imuloop.ingest.columns import AXES, unit_of
from imuloop.ingest.delimited import read_series
from imuloop.ingest.streams import Stream, raw_log
from imuloop.ingest.text_layout import find_layout

# told by its names
ENDINGS = ()

# time and sensor columns, without unit and axis, lower case; the best first
_SENSORS = {
    "accelerometer": ("accelerometertimestamp_sincereboot", "accelerometeracceleration"),
    "gyro": ("gyrotimestamp_sincereboot", "gyrorotation"),
    "motion": ("motiontimestamp_sincereboot", "motionrotationrate"),
}


def read(paths, columns=None, batch_rows=1 << 16, most=-1):
    """Read a CSV of SensorLog, whose rows repeat a sensor's last sample until it has a new one.

    `columns` names ``STREAM.COLUMN``, streams being ``accelerometer`` and ``gyro`` or, where that
    is not logged, ``motion``.
    """
    path = paths["log"]
    layout, columns = find_layout(path), dict(columns or {})
    bare = [re.sub(r"\s*\(.*\)\Z", "", name).lower() for name in layout.names]
    streams, notes, lost = {}, [], None
    for name, (time, sensor) in _SENSORS.items():
        wanted = [time, *(sensor + axis for axis in AXES)]
        if not set(wanted) <= set(bare) or (name == "motion" and "gyro" in streams):
            continue
        positions = [bare.index(each) for each in wanted]
        stamps, values, count, unstamped = read_series(path, layout, positions, batch_rows, most)
        fresh = np.append(True, np.diff(stamps) != 0)[: len(stamps)]
        if not fresh.any():
            continue
        if left_out := unstamped + int((~fresh).sum()):
            notes.append(f"no new sample of {name} in {plural(left_out, 'row')}")
        sign = -1 if name == "accelerometer" else 1
        fields = {
            layout.names[i]: sign * x[fresh] for i, x in zip(positions[1:], values, strict=True)
        }
        units = {"time": "s", "acceleration": "g", "angular_rate": "rad/s"}
        quantity = "acceleration" if name == "accelerometer" else "angular_rate"
        units[quantity] = unit_of(quantity, (*positions[1:],), layout.names) or units[quantity]
        streams[name] = Stream(name, stamps[fresh], fields, units)
        if name == "accelerometer":
            lost = count
    if "accelerometer" not in streams or len(streams) < 2:
        raise RejectedLog(
            "the file holds no accelerometer and gyroscope as SensorLog names them: "
            f"{', '.join(layout.names)[:200]}"
        )
    notes.insert(0, "an export of SensorLog: acceleration in g, sign turned into specific force")
    if "motion" in streams:
        notes.append("the angular rate is that of the motion, less the bias that iOS estimates")
    for quantity, stream in zip(("acceleration", "angular_rate"), streams.values(), strict=True):
        if columns.get(quantity) is None:
            columns[quantity] = [f"{stream.name}.{name}" for name in stream.fields]
    log = raw_log(list(streams.values()), columns, batch_rows, notes)
    log.lose(lost)
    return log
