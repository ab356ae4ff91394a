"""A session over time: every channel, with what was found to be rest, motion or disturbance."""

import numpy as np
import pandas as pd

from imuloop.core.samples import TIME
from imuloop.core.segments import DISTURBED, GAP, MOTION, STATIC
from imuloop.report.numbers import DEGREE_PER_SECOND, MILLI_G, Display, duration, number, plural
from imuloop.report.results import FILE_UNITS, SENSORS, XYZ
from imuloop.report.svg import AXES, BLUE, GRID, VERMILLION, Picture, draw, write_csv

# stretches of equal length that a line is cut into; each gives two points, far below 2,000
BUCKETS = 350
# what moves is shown as it is, what rests as milli-g or degrees per second about its median
MOVING = {"accelerometer": Display("m/s²", 1.0), "gyroscope": DEGREE_PER_SECOND}
RESTING = {"accelerometer": MILLI_G, "gyroscope": DEGREE_PER_SECOND}
QUANTITY = {"accelerometer": "specific force", "gyroscope": "angular rate"}
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
    starts = np.linspace(0, n, buckets + 1).astype(int)
    width = int(np.diff(starts).max())
    rows = np.minimum(starts[:-1, None] + np.arange(width), starts[1:, None] - 1)
    values = np.asarray(x)[rows]
    first = np.arange(buckets)
    low, high = rows[first, values.argmin(axis=1)], rows[first, values.argmax(axis=1)]
    return np.unique(np.concatenate([low, high]))


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
    return [
        _picture(device, session, folder, sensor, channels) for sensor, channels in SENSORS.items()
    ]


def _picture(device, session, folder, sensor, channels):
    samples = session.samples((TIME, *channels))
    t = samples[TIME].to_numpy()
    segments = session.segments
    resting = session.kind == "static"
    display = (RESTING if resting else MOVING)[sensor]
    lines = {}
    for channel in channels:
        x = samples[channel].to_numpy()
        chosen = extremes(x)
        lines[channel] = t[chosen], x[chosen], np.median(x) if resting else 0.0
    csv = write_csv(
        folder,
        f"{session.name}_{sensor}",
        pd.concat(
            pd.DataFrame({"channel": c, "t_s": x, f"value_{FILE_UNITS[sensor]}": y})
            for c, (x, y, _) in lines.items()
        ),
    )
    gaps = segments.loc[segments["kind"] == GAP, "start_s"].to_numpy()
    unit, size = clock(t[-1])

    def plot(axes):
        axes = np.atleast_1d(axes)
        for ax in axes:
            _shade(ax, segments, size)
            ax.set_xlim(0, t[-1] / size)
        each = axes if resting else [axes[0]] * 3
        for ax, colour, axis, (x, y, middle) in zip(each, AXES, XYZ, lines.values(), strict=True):
            # a line is not drawn across a gap
            where = np.searchsorted(x, gaps, side="right")
            x, y = np.insert(x, where, np.nan), np.insert(y, where, np.nan)
            ax.plot(x / size, (y - middle) * display.factor, color=colour, lw=0.9, label=axis)
            if resting:
                ax.set_ylabel(f"{axis}, {display.unit}")
        axes[-1].set_xlabel(f"time, {unit}")
        if not resting:
            axes[0].set_ylabel(f"{QUANTITY[sensor]}, {display.unit}")
            axes[0].legend(loc="lower right", ncols=3, bbox_to_anchor=(1, 0.98), borderpad=0)

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
        margins=(62, 12, 8 if resting else 26, 42),
        rows=3 if resting else 1,
        sharex=True,
    )
    caption = _finding(session, sensor, segments, samples, channels)
    if resting:
        middle = ", ".join(number(m * display.factor, 4) for *_, m in lines.values())
        caption += f" Shown about the medians {middle} {display.unit} (x, y, z)."
    note = (
        "Blue: at rest, used as poses or for noise. White: motion. Orange: disturbed, cut out. "
        "Grey: no samples. Drawn through the least and greatest value of each stretch, so no "
        "peak is hidden."
    )
    return Picture(f"{device.name}.{session.name}.{sensor}", svg, caption, note, (csv,), wide=True)


def _shade(ax, segments, size):
    """Shade rests, disturbances and gaps; motion stays white."""
    # a disturbance has an outline, so that a short one still shows in a long record
    looks = {STATIC: (BLUE, 0.13, 0), DISTURBED: (VERMILLION, 0.35, 2), GAP: (GRID, 0.9, 0)}
    for start, end, kind in segments[["start_s", "end_s", "kind"]].itertuples(index=False):
        if kind in looks:
            colour, alpha, width = looks[kind]
            ax.axvspan(start / size, end / size, color=colour, alpha=alpha, lw=width)


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
