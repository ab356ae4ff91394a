"""How the bias wandered over a static record, before and after correction, with temperature."""

import numpy as np

from imuloop.core.samples import TEMPERATURE, TIME, sums_over
from imuloop.report.columns import from_records
from imuloop.report.numbers import RESIDUAL, number
from imuloop.report.results import XYZ
from imuloop.report.svg import AXES, BLUE, INK, ORANGE, PURPLE, Picture, draw, write_csv
from imuloop.report.time_series import clock, extremes

NOTE = (
    "Means of consecutive stretches at rest, about one level. A bias that stays within the dashed "
    "floor (1 σ) is as steady as the noise allows; steps, slopes and bends are what a noise model "
    "lacks."
)
WARM_NOTE = f"{NOTE} Where they follow the temperature below, that is the first thing to look at."
# stretches that a line is cut into, two points each
BUCKETS = 64


def bias_pictures(device, sensor, block, folder):
    """Return how a sensor's bias wandered over each static record, against the floor.

    Parameters
    ----------
    device : Device
        The device.
    sensor : str
        Its sensor.
    block : dict
        The diagnosis of its static record.
    folder : Path
        Where the CSV files go.
    """
    sessions = {}
    for point in block.get("points") or []:
        sessions.setdefault(point["session"], []).append(point)
    return [
        _picture(device, sensor, session, from_records(points), block, folder)
        for session, points in sessions.items()
    ]


def temperatures(session, start):
    """Return the mean temperature over each window, °C; None where it was not logged.

    Parameters
    ----------
    session : Session
        The session.
    start : ndarray, shape (n,)
        Start of each window, s; a window ends where the next may start.
    """
    if TEMPERATURE not in session.samples or len(start) < 2:
        return None
    edges = np.column_stack([start, start + np.median(np.diff(start))])
    # of a day-long log in little memory
    total, count = np.zeros((2, len(start)))
    for _, (t, value) in session.samples.pieces((TIME, TEMPERATURE)):
        at, known = np.searchsorted(t, edges), np.isfinite(value)
        total += sums_over(np.where(known, value, 0.0), at)
        count += sums_over(known, at)
    mean = np.full(len(start), np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    return mean if np.isfinite(mean).any() else None


def _picture(device, sensor, session, points, block, folder):
    display = RESIDUAL[block["residuals"]["bias"]["unit"]]
    t, before, floor = (np.array(points[k], float) for k in ("start_s", "values", "floor"))
    floor = floor / np.sqrt(3)
    after = None
    if block.get("effects") and None not in points.get("corrected", [None]):
        after = np.array(points["corrected"], float)
    logged = temperatures(next(s for s in device.sessions if s.name == session), t)
    columns = {"start_s": t, "floor": floor, **dict(zip(XYZ, before.T, strict=True))}
    if after is not None:
        columns |= {f"{axis}_corrected": y for axis, y in zip(XYZ, after.T, strict=True)}
    if logged is not None:
        columns["temperature_degC"] = logged
    csv = write_csv(folder, f"{session}_bias_{sensor}", columns)
    unit, size = clock(t[-1])
    drawn = 1 if after is None else 3

    def line(ax, y, colour, width=1.0):
        chosen = extremes(y, BUCKETS)
        return ax.plot(t[chosen] / size, y[chosen], color=colour, lw=width)

    def limits(ax):
        # the floor is smooth: a few points draw it
        few = slice(None, None, len(t) // 40 + 1)
        for sign in (1, -1):
            handle = ax.plot(
                t[few] / size, sign * floor[few] * display.factor, color=INK, ls="--", lw=1
            )
        return handle

    def plot(axes):
        axes = axes if isinstance(axes, list) else [axes]
        if after is None:
            handles = [
                h
                for colour, y in zip(AXES, before.T * display.factor, strict=True)
                for h in line(axes[0], y, colour)
            ] + limits(axes[0])
            words = [*XYZ, "floor, 1 σ"]
            axes[0].set_ylabel(f"mean minus bias, {display.unit}")
        else:
            for ax, axis, old, new in zip(axes, XYZ, before.T, after.T, strict=False):
                handles = [
                    *line(ax, old * display.factor, ORANGE, 1.4),
                    *line(ax, new * display.factor, BLUE),
                    *limits(ax),
                ]
                ax.set_ylabel(f"{axis}, {display.unit}")
            words = ["before", "after", "floor, 1 σ"]
        if logged is not None:
            line(axes[-1], logged, PURPLE, 1.4)
            axes[-1].set_ylabel("°C")
        axes[-1].set_xlabel(f"time, {unit}")
        axes[0].legend(handles, words)

    caption = _finding(session, sensor, before, after, floor, logged, display)
    name = f"{device.name}.{session}.bias_{sensor}"
    rows = (3 if drawn == 1 else 2,) * drawn + (1.4,) * (logged is not None)
    height = 270 + 70 * (logged is not None) + (130 if drawn == 3 else 0)
    svg = draw(
        name,
        caption,
        440,
        height,
        plot,
        margins=(62, 12, 28, 42),
        rows=rows,
        sharex=True,
    )
    return Picture(name, svg, caption, NOTE if logged is None else WARM_NOTE, (csv,))


def _finding(session, sensor, before, after, floor, logged, display):
    """Return how far the bias moved, before and after, and over which temperatures."""
    spans = [
        [number(v, 2) for v in np.ptp(x, axis=0) * display.factor]
        for x in (before, after)
        if x is not None
    ]
    moved = ", ".join(" → ".join(pair) for pair in zip(*spans, strict=True))
    text = (
        f"{session}, {sensor}: the bias moves by {moved} {display.unit} from peak to peak "
        f"(x, y, z{'; before → after' if after is not None else ''}); noise alone, 1 σ, "
        f"{number(np.nanmean(floor) * display.factor, 2)} {display.unit}"
    )
    if logged is not None:
        low, high = (number(f(logged)) for f in (np.nanmin, np.nanmax))
        text += f"; temperature {low} to {high} °C"
    return f"{text}."
