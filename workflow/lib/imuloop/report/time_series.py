"""A session over time: every channel, with what was found to be rest, motion or disturbance."""

from itertools import pairwise

import numpy as np
import pandas as pd

from imuloop.core.samples import CHANNELS, TIME
from imuloop.core.segments import DISTURBED, GAP, MOTION, STATIC
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
    ends = [a + f(x[a:b]) for a, b in pairwise(edges) for f in (np.argmin, np.argmax)]
    return np.unique(ends)


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
    samples = session.samples((TIME, *CHANNELS))
    return [
        _picture(device, session, folder, sensor, samples[[TIME, *channels]])
        for sensor, channels in SENSORS.items()
    ]


def _picture(device, session, folder, sensor, samples):
    t, channels = samples[TIME].to_numpy(), SENSORS[sensor]
    segments = session.segments
    resting = session.kind == "static"
    display = (RESTING if resting else MOVING)[sensor]
    gaps = segments.loc[segments["kind"] == GAP, "start_s"].to_numpy()
    raw, smooth, middle, quiet = {}, {}, {}, {}
    still = segments.loc[segments["kind"] == STATIC, ["start_s", "end_s"]]
    rests = np.searchsorted(t, still.to_numpy()).tolist()
    for axis, channel in zip(XYZ, channels, strict=True):
        x = samples[channel].to_numpy()
        chosen = extremes(x)
        # a line is not drawn across a gap
        where = np.searchsorted(t[chosen], gaps, side="right")
        raw[axis] = tuple(np.insert(v[chosen].astype(float), where, np.nan) for v in (t, x))
        middle[axis] = np.median(x) if resting else 0.0
        if resting:
            smooth[axis] = trend(t, x, rests)
            # a knock must not flatten the rest: it is cut off at the frame
            ends = [f(x[i:j]) for i, j in rests if i < j for f in (np.min, np.max)]
            low, high = min(ends, default=x.min()), max(ends, default=x.max())
            quiet[axis] = low - 0.3 * (high - low), high + 0.3 * (high - low)
    csv = write_csv(
        folder,
        f"{session.name}_{sensor}",
        pd.concat(
            pd.DataFrame(
                {"channel": c, "line": line, "t_s": x, f"value_{FILE_UNITS[sensor]}": y}
            ).dropna()
            for line, curves in (("raw", raw), ("smoothed", smooth))
            for c, (x, y) in zip(channels, curves.values(), strict=False)
        ),
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
        f"{axis} from {number(samples[c].min() * display.factor)} to "
        f"{number(samples[c].max() * display.factor)} {display.unit}"
        for axis, c in zip(XYZ, channels, strict=True)
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
    caption = _finding(session, sensor, segments, samples, channels)
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
        rows = segments[segments["kind"] == kind]
        ax.axvspan(rows["start_s"] / size, rows["end_s"] / size, colour, alpha, width)


def _finding(session, sensor, segments, samples, channels):
    """Return what the picture says: how much of it is rest, and what was cut."""
    length = (segments["end_s"] - segments["start_s"]).groupby(segments["kind"]).sum()
    parts = [f"{session.name}, {sensor}: {duration(length.get(STATIC, 0.0))} at rest"]
    poses = segments.loc[segments["pose"] >= 0, "pose"].nunique()
    if session.kind != "static":
        parts.append(f" in {plural(poses, 'pose')}")
    if MOTION in length:
        display = MOVING[sensor]
        peak = np.linalg.norm(samples[list(channels)], axis=1).max() * display.factor
        parts.append(f", {duration(length[MOTION])} of motion up to {number(peak)} {display.unit}")
    cut = segments.loc[segments["kind"] == DISTURBED, "start_s"]
    if len(cut):
        parts.append(
            f"; {plural(len(cut), 'disturbed stretch', 'es')} cut out, "
            f"{duration(length[DISTURBED])} in all, the first at {duration(cut.iloc[0])}"
        )
    elif session.kind == "static":
        parts.append("; no disturbance found")
    if GAP in length:
        count = int((segments["kind"] == GAP).sum())
        parts.append(f"; {plural(count, 'gap')} without samples, {duration(length[GAP])}")
    return "".join(parts) + "."
