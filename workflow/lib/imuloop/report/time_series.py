"""A session over time: every channel, with what was found to be rest, motion or disturbance."""

from itertools import pairwise

import numpy as np

from imuloop.core.samples import TIME
from imuloop.core.segments import DISTURBED, GAP, KINDS, MOTION, STATIC
from imuloop.report.numbers import (
    DEGREE_PER_SECOND,
    MILLI_G,
    NO_NUMBER,
    Display,
    duration,
    number,
    plural,
)
from imuloop.report.results import FILE_UNITS, SENSORS, XYZ
from imuloop.report.smoothing import smoothed
from imuloop.report.svg import AXES, BLUE, GRID, INK, VERMILLION, Picture, draw, write_csv

# stretches of equal length that a line is cut into; each gives two points, far below 2,000
BUCKETS = 240
# means that a stretch is cut into before it is smoothed, and stretches of the smooth line
MEANS, SMOOTH_BUCKETS = 4096, 120
# what moves is shown as it is, what rests as milli-g or degrees per second about its median
MOVING = {"accelerometer": Display("m/s²", 1.0), "gyroscope": DEGREE_PER_SECOND}
RESTING = {"accelerometer": MILLI_G, "gyroscope": DEGREE_PER_SECOND}
QUANTITY = {"accelerometer": "specific force", "gyroscope": "angular rate"}
NOTE = (
    "Blue: at rest, used as poses or for noise. White: motion. Orange-red: disturbed, cut out. "
    "Grey: no samples. Good: every rest that you made is blue, a few seconds or longer, with "
    "clear turns between. Drawn through the least and greatest value of each stretch: no peak is "
    "hidden."
)
RESTING_NOTE = (
    "Blue: at rest, used for noise. Orange-red: disturbed, cut out. Grey: no samples. Good: the "
    "line without noise is flat. Where it steps, slopes or waves, the bias or the attitude "
    "changed by more than noise does: compare with temperature below. As logged it is drawn "
    "through the least and greatest value of each stretch; what is disturbed may leave the frame."
)
# a clock axis in hours where seconds would be long numbers
_CLOCKS = (("h", 3600.0, 7200.0), ("min", 60.0, 600.0), ("s", 1.0, 0.0))


def extremes(x, buckets=BUCKETS):
    """Return the indices of the least and the greatest value of each stretch of a series.

    A line through these points looks like a line through all of them: no peak is lost.

    Parameters
    ----------
    x : array_like, shape (n,)
        The series.
    buckets : int
        Number of stretches of equal length.

    Returns
    -------
    ndarray of int
        At most ``2 * buckets`` increasing indices, all n of them if these are fewer.
    """
    n = len(x)
    if n <= 2 * buckets:
        return np.arange(n)
    x, edges = np.asarray(x), np.linspace(0, n, buckets + 1).astype(int)
    parts = [(a, x[a:b]) for a, b in pairwise(edges.tolist())]
    return np.unique([a + end for a, part in parts for end in (part.argmin(), part.argmax())])


def trend(t, x, stretches):
    """Return a series without what noise explains, as a few points.

    Parameters
    ----------
    t, x : ndarray, shape (n,)
        Times, s, and values.
    stretches : sequence of (int, int)
        First sample and end of the stretches to smooth, each by itself.

    Returns
    -------
    t, x : ndarray, shape (m,)
        Some 2 `SMOOTH_BUCKETS` points; not-a-number between two stretches.
    """
    times, values = [np.nan], [np.nan]
    for start, end in stretches:
        # among many a short one has no width in the picture
        if (end - start) * BUCKETS < len(t):
            continue
        # means of so many samples that a line is no finer than its picture shows
        count = min(end - start, MEANS)
        first = np.linspace(0, end - start, count + 1).astype(int)
        middle = (t[start + first[:-1]] + t[start + first[1:] - 1]) / 2
        y = smoothed(np.add.reduceat(x[start:end], first[:-1]) / np.diff(first))
        chosen = extremes(y, max(SMOOTH_BUCKETS * (end - start) // len(t), 2))
        times += [*middle[chosen], np.nan]
        values += [*y[chosen], np.nan]
    return np.array(times), np.array(values)


def clock(end):
    """Return the unit to show times up to `end` (s) in, and its size in s."""
    return next((unit, size) for unit, size, least in _CLOCKS if end >= least)


def session_pictures(device, session, folder):
    """Return the pictures of a session's accelerometer and gyroscope over time.

    Parameters
    ----------
    device : Device
        The device.
    session : Session
        One of its sessions that was not rejected.
    folder : Path
        Where the CSV files go.
    """
    t = session.samples[TIME]
    return [_picture(device, session, folder, sensor, t) for sensor in SENSORS]


def _picture(device, session, folder, sensor, t):
    channels, segments = SENSORS[sensor], session.segments
    resting = session.kind == "static"
    display = (RESTING if resting else MOVING)[sensor]
    gaps = segments["start_s"][segments["kind"] == GAP]
    raw, smooth, middle, quiet, square = {}, {}, {}, {}, 0.0
    still, moved = (segments["kind"] == kind for kind in (STATIC, MOTION))
    ends = np.column_stack([segments[name][still] for name in ("start_s", "end_s")])
    rests = np.searchsorted(t, ends).tolist()
    for axis, channel in zip(XYZ, channels, strict=True):
        x = session.samples[channel]
        chosen = extremes(x)
        # a line is not drawn across a gap
        where = np.searchsorted(t[chosen], gaps, side="right")
        raw[axis] = tuple(np.insert(v[chosen].astype(float), where, np.nan) for v in (t, x))
        if moved.any():
            square = square + x**2
        if resting:
            smooth[axis] = trend(t, x, rests)
            # a knock must not flatten the rest: it is cut off at the frame
            ends = [f(x[i:j]) for i, j in rests if i < j for f in (np.min, np.max)]
            low, high = min(ends, default=x.min()), max(ends, default=x.max())
            quiet[axis] = low - 0.3 * (high - low), high + 0.3 * (high - low)
        # last, as it puts x in another order instead of a copy
        middle[axis] = np.median(x, overwrite_input=True) if resting else 0.0
        # before the next is read
        del x
    csv = write_csv(
        folder,
        f"{session.name}_{sensor}",
        _numbers(sensor, {"raw": raw, "smoothed": smooth}),
    )
    unit, size = clock(t[-1])

    def plot(axes):
        axes = axes if isinstance(axes, list) else [axes]
        for ax in axes:
            _shade(ax, segments, size)
            ax.set_xlim(0, t[-1] / size)
        each = axes if resting else [axes[0]] * 3
        for ax, colour, (axis, (x, y)) in zip(each, AXES, raw.items(), strict=True):

            def shown(values, level=middle[axis]):
                return (values - level) * display.factor

            handles = ax.plot(x / size, shown(y), color=colour, lw=0.9, label=axis)
            if resting:
                ax.set_ylim(*(shown(v) for v in quiet[axis]))
                x, y = smooth[axis]
                handles += ax.plot(x / size, shown(y), color=INK, lw=1.6)
                ax.set_ylabel(f"{axis}, {display.unit}")
        axes[-1].set_xlabel(f"time, {unit}")
        if resting:
            axes[0].legend(handles, ["as logged", "without noise (wavelets)"])
        else:
            axes[0].set_ylabel(f"{QUANTITY[sensor]}, {display.unit}")
            axes[0].legend()

    alt = f"{sensor} of session {session.name} over {duration(t[-1])}: " + "; ".join(
        f"{axis} from {number(np.nanmin(x) * display.factor)} to "
        f"{number(np.nanmax(x) * display.factor)} {display.unit}"
        for axis, (_, x) in raw.items()
    )
    svg = draw(
        f"{device.name}.{session.name}.{sensor}",
        alt,
        900,
        290 if resting else 230,
        plot,
        margins=(62, 12, 26, 42),
        rows=(1, 1, 1) if resting else (1,),
        sharex=True,
    )
    caption = _finding(session, sensor, np.sqrt(np.max(square)))
    if resting:
        moved = [np.ptp(y[np.isfinite(y)]) for _, y in smooth.values() if np.isfinite(y).any()]
        told = ", ".join(number(m * display.factor, 2) for m in moved) or NO_NUMBER
        levels = ", ".join(number(m * display.factor, 4) for m in middle.values())
        caption += (
            f" Without noise it moves by {told} {display.unit} (x, y, z); shown about the medians "
            f"{levels} {display.unit}."
        )
    note = RESTING_NOTE if resting else NOTE
    return Picture(f"{device.name}.{session.name}.{sensor}", svg, caption, note, (csv,), wide=True)


def _shade(ax, segments, size):
    """Shade rests, disturbances and gaps; motion stays white."""
    # a disturbance has an outline, so that a short one still shows in a long record
    looks = {STATIC: (BLUE, 0.13, 0), DISTURBED: (VERMILLION, 0.35, 2), GAP: (GRID, 0.9, 0)}
    for kind, (colour, alpha, width) in looks.items():
        at = segments["kind"] == kind
        ends = (segments[name][at] / size for name in ("start_s", "end_s"))
        ax.axvspan(*ends, colour, alpha, width)


def _numbers(sensor, lines):
    """Return the numbers behind a picture's lines, a row a point."""
    parts = []
    for line, curves in lines.items():
        for channel, (t, x) in zip(SENSORS[sensor], curves.values(), strict=False):
            known = np.isfinite(t) & np.isfinite(x)
            parts.append(([channel] * known.sum(), [line] * known.sum(), t[known], x[known]))
    names = ("channel", "line", "t_s", f"value_{FILE_UNITS[sensor]}")
    return {n: np.concatenate(c) for n, c in zip(names, zip(*parts, strict=True), strict=True)}


def _finding(session, sensor, peak):
    """Return what the picture says: how much of it is rest, and what was cut."""
    start, kinds = (session.segments[name] for name in ("start_s", "kind"))
    length = {kind: duration(session.seconds(kind)) for kind in KINDS}
    parts = [f"{session.name}, {sensor}: {length[STATIC]} at rest"]
    if session.kind != "static":
        parts.append(f" in {plural(len(session.rests), 'pose')}")
    if MOTION in kinds:
        display = MOVING[sensor]
        size = f"{number(peak * display.factor)} {display.unit}"
        parts.append(f", {length[MOTION]} of motion up to {size}")
    cut = start[kinds == DISTURBED]
    if len(cut):
        parts.append(
            f"; {plural(len(cut), 'disturbed stretch', 'es')} cut out, {length[DISTURBED]} in all, "
            f"the first at {duration(cut[0])}"
        )
    elif session.kind == "static":
        parts.append("; no disturbance found")
    if GAP in kinds:
        count = int((kinds == GAP).sum())
        parts.append(f"; {plural(count, 'gap')} without samples, {length[GAP]}")
    return "".join(parts) + "."
