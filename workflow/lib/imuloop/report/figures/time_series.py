"""A session over time: every channel, with its rests, motion and disturbances."""

from itertools import pairwise

import numpy as np
import pandas as pd

from imuloop.core.errors import plural
from imuloop.core.samples import TIME
from imuloop.core.segments import DISTURBED, GAP, STATIC
from imuloop.report.figures.drawing import AXES, BLUE, GRID, INK, PURPLE, VERMILLION, Picture
from imuloop.report.page import phrase
from imuloop.report.results import FILE_UNITS, SENSORS, XYZ
from imuloop.report.units import DEGREE_PER_SECOND, MILLI_G, Display

# number of equal parts that a line is cut into; each part gives two points
BUCKETS = 600
# number of means that show a record at rest
MEANS = 120
# units of moving records, and of records at rest, which are drawn with their medians subtracted
MOVING = {"accelerometer": Display("m/s²", 1.0), "gyroscope": DEGREE_PER_SECOND}
RESTING = {"accelerometer": MILLI_G, "gyroscope": DEGREE_PER_SECOND}
QUANTITY = {"accelerometer": "specific force", "gyroscope": "angular rate"}
# effect of a constant slope at rest, and the looks of its line
RAMP, DRIFT = "ramp", {"color": PURPLE, "ls": "--", "label": "drift that was found"}
# units of a time axis: unit, its size, s, and the least length of a record, s, to use it
_CLOCKS = (("h", 3600.0, 7200.0), ("min", 60.0, 600.0), ("s", 1.0, 0.0))


def extremes(x, buckets=BUCKETS):
    """Return the indices of the least and the greatest value in each of equal parts of a series.

    `x` is the series, (n,), and `buckets` the number of parts. A line through these points looks
    like a line through all points: no peak is lost. A short series, up to two points per part,
    gives all its indices.
    """
    n = len(x)
    if n <= 2 * buckets:
        return np.arange(n)
    edges = np.linspace(0, n, buckets + 1).astype(int)
    parts = [(a, x[a:b]) for a, b in pairwise(edges)]
    return np.unique([a + end for a, part in parts for end in (part.argmin(), part.argmax())])


def means_at_rest(t, x, stretches):
    """Return times and means of a series over short parts of its rests, (m,) each, for drawing.

    A nan separates two rests. `t` are the times, s, (n,), and `x` is the series, (n,). `stretches`
    has for each rest its first row and the row after its last. A part is so long that `MEANS` parts
    would cover all n rows; a rest shorter than a part has no mean.
    """
    times, values = [np.nan], [np.nan]
    for start, end in stretches:
        count = MEANS * (end - start) // len(t)
        # a rest that is too short for a mean has no width in the picture
        if not count:
            continue
        edges = np.linspace(start, end, count + 1).astype(int)
        times += [*(t[edges[:-1]] + t[edges[1:] - 1]) / 2, np.nan]
        values += [*np.add.reduceat(x[start:end], edges[:-1] - start) / np.diff(edges), np.nan]
    return np.array(times), np.array(values)


def clock(end):
    """Return the unit in which to show times up to `end`, s, and its size, s.

    The unit is h, min or s.
    """
    return next((unit, size) for unit, size, least in _CLOCKS if end >= least)


def shade(area, segments, size=1.0):
    """Shade rests, disturbances and gaps on the matplotlib Axes `area`; motion stays white.

    `segments` is the table of segments of a session: parts of one kind, such as a rest, with start
    and end. `size` is the unit of the time axis, s.
    """
    # a disturbance has an outline, so that a short disturbance is visible in a long record
    looks = {STATIC: (BLUE, 0.13, 0), DISTURBED: (VERMILLION, 0.35, 2), GAP: (GRID, 0.9, 0)}
    for kind, (colour, alpha, width) in looks.items():
        rows = segments[segments["kind"] == kind]
        spans = np.column_stack([rows["start_s"], rows["end_s"] - rows["start_s"]]) / size
        style = {"color": colour, "alpha": alpha, "lw": width}
        area.broken_barh(spans, (0, 1), transform=area.get_xaxis_transform(), **style)


def steps_at(device, session, sensor):
    """Return the times at which the bias of a sensor steps in a session, s, a list.

    The times are from the diagnosis. `device` is a DeviceResults; `session` and `sensor` are names.
    """
    times = []
    for record in device.diagnosis.get("sensors", {}).get(sensor, {}).values():
        for effect in record["effects"]:
            constants = effect["constants"]
            places = zip(constants.get("sessions", ()), constants.get("times", ()), strict=False)
            times += [time for name, time in places if name == session]
    return times


def drifts(device, sensor):
    """Return the slope of the bias of a sensor at rest by axis, a dict, SI units per s.

    `device` is a DeviceResults, and `sensor` the name of the sensor. The result is empty if the
    diagnosis has no effect `ramp`.
    """
    record = device.diagnosis.get("sensors", {}).get(sensor, {}).get("static_record", {})
    slopes = [e["parameters"] for e in record.get("effects", ()) if e["name"] == RAMP]
    return {axis: slopes[0][f"d{axis}"] for axis in XYZ} if slopes else {}


def session_pictures(device, session):
    """Return the Pictures of the samples of a session over time, a list: one for each sensor.

    `device` is a DeviceResults, and `session` one of its SessionResults.
    """
    t = session.samples[TIME]
    return [_picture(device, session, sensor, t) for sensor in SENSORS]


def _picture(device, session, sensor, t):
    """Return the Picture of the samples of one sensor in a session over time.

    `device` is a DeviceResults, `session` one of its SessionResults, `sensor` the name of the
    sensor, and `t` are the n time stamps of the session, s, (n,).
    """
    segments, resting = session.segments, session.kind == "static"
    display = (RESTING if resting else MOVING)[sensor]
    gaps = segments["start_s"][segments["kind"] == GAP]
    still = segments[segments["kind"] == STATIC]
    rests = np.searchsorted(t, still[["start_s", "end_s"]].to_numpy()).tolist()
    lines, middle, quiet = {"raw": {}}, {}, {}
    for axis, channel in zip(XYZ, SENSORS[sensor], strict=True):
        x = session.samples[channel]
        chosen = extremes(x)
        # a line is not drawn across a gap
        where = np.searchsorted(t[chosen], gaps, side="right")
        curve = tuple(np.insert(v[chosen].astype(float), where, np.nan) for v in (t, x))
        lines["raw"][axis] = curve
        if resting:
            lines.setdefault("means", {})[axis] = means_at_rest(t, x, rests)
            # the limits follow from the rests, so that a knock does not flatten the curve but is
            # cut off
            ends = [f(x[i:j]) for i, j in rests if i < j for f in (np.min, np.max)]
            low, high = min(ends, default=x.min()), max(ends, default=x.max())
            quiet[axis] = low - 0.3 * (high - low), high + 0.3 * (high - low)
        # this comes last, as it sorts x in place to save a copy
        middle[axis] = np.median(x, overwrite_input=True) if resting else 0.0
    unit, size = clock(t[-1])
    steps = steps_at(device, session.name, sensor)
    slopes = drifts(device, sensor) if resting else {}

    def line(area, axis, name, **looks):
        """Draw a line of an axis about its median, on the Axes `area`.

        `axis` is x, y or z, `name` is ``raw`` or ``means``, and `looks` are arguments of
        matplotlib.
        """
        x, y = lines[name][axis]
        area.plot(x / size, (np.asarray(y) - middle[axis]) * display.factor, **looks)

    def plot(areas):
        """Draw each axis on its Axes, or all axes of a moving record on one.

        `areas` is a list of three Axes, x, y and z, for a record at rest, else one Axes.
        """
        areas = areas if resting else [areas] * 3
        for area in dict.fromkeys(areas):
            shade(area, segments, size)
        areas[-1].set_xlim(0, t[-1] / size)
        areas[-1].set_xlabel(f"time, {unit}")
        areas[0].set_ylabel(f"{QUANTITY[sensor]}, {display.unit}")
        for area, colour, axis in zip(areas, AXES, XYZ, strict=True):
            words = "as logged" if resting else axis
            line(area, axis, "raw", color=colour, lw=0.9, label=words)
            if resting:
                low, high = ((end - middle[axis]) * display.factor for end in quiet[axis])
                area.set_ylim(*((low, high) if low < high else (low - 1, high + 1)))
                line(area, axis, "means", color=INK, lw=1.6, label="means")
                area.set_ylabel(f"{axis}, {display.unit}")
            for at in steps:
                area.axvline(at / size, color=PURPLE, ls=":", label="step")
            if slopes:
                rise = slopes[axis] * (t[-1] - t[0]) / 2 * display.factor
                area.plot([t[0] / size, t[-1] / size], [-rise, rise], **DRIFT)

    looks = {"size": (900, 310), "rows": (1, 1, 1)} if resting else {"size": (900, 250)}
    name = f"{device.name}.{session.name}.{sensor}"
    caption = _caption(session, sensor)
    return Picture(name, "Samples over time", caption, plot, _numbers(sensor, lines), **looks)


def _numbers(sensor, lines):
    """Return the numbers of the lines of a picture, a DataFrame with a row per point.

    `sensor` is the name of the sensor. `lines` has the points of each line, (times in s, values in
    SI), in a dict by the name of the line, ``raw`` or ``means``, and then by axis.
    """
    parts = [
        pd.DataFrame({"channel": channel, "line": line, "t_s": t, f"value_{FILE_UNITS[sensor]}": x})
        for line, curves in lines.items()
        for channel, (t, x) in zip(SENSORS[sensor], curves.values(), strict=False)
    ]
    return pd.concat(parts).dropna()


def _caption(session, sensor):
    """Return the caption of a picture of samples: the length of all rests, and what was excluded.

    Excluded are disturbed stretches and gaps; their number and length are given. `session` is the
    SessionResults, and `sensor` the name of the sensor.
    """
    kinds, cut = session.segments["kind"], []
    for kind, words, ending in ((DISTURBED, "disturbed stretch", "es"), (GAP, "gap", "s")):
        if count := int((kinds == kind).sum()):
            cut.append((plural(count, words, ending), session.seconds(kind)))
    poses = None if session.kind == "static" else session.poses
    numbers = {"rest": session.seconds(STATIC), "poses": poses, "cut": cut}
    return phrase("series", session=session.name, sensor=sensor, **numbers)
