"""Many devices in one picture: how they spread, and by name those that stand out."""

import numpy as np

from imuloop.report.comparison_plot import INTERVALS
from imuloop.report.numbers import number
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.svg import BLUE, GREEN, INK, ORANGE, PURPLE, VERMILLION, Picture, draw

# robust standard deviations from the median from which on a device stands out
FAR = 5.0
# the most that are named in a picture
NAMED = 5
COLOURS = (VERMILLION, GREEN, PURPLE, ORANGE, INK)
# averaging times of the band, and the share of the longest up to which a curve is known well
TIMES, KNOWN = 60, 0.1
NOTE = (
    "Each mark a device, in their order from top to bottom: a slope is a drift of the production. "
    "Cross: median, and the span of nine of ten. Orange-red: farther from the median than "
    f"{FAR:g} standard deviations (1.4826 times the median distance); the farthest are named."
)


def far_out(values):
    """Return how far each value is from the median, in robust standard deviations.

    Parameters
    ----------
    values : array_like, shape (n, …)
        A row a device; not-a-number where a device has none.

    Returns
    -------
    ndarray, shape (n, …)
        ``|x − median| / (1.4826 median |x − median|)``, 0 where there is none.

    References
    ----------
    Rousseeuw, Croux, "Alternatives to the median absolute deviation", J. Am. Stat. Assoc. 88
    (1993), section 1.
    """
    distance = np.abs(values - np.nanmedian(values, axis=0))
    scale = 1.4826 * np.nanmedian(distance, axis=0)
    return np.nan_to_num(distance / np.where(scale > 0, scale, np.inf))


def standing_out(distances):
    """Return the places of the devices that stand out, the farthest first, at most `NAMED`."""
    order = np.argsort(-distances, kind="stable")
    return [int(i) for i in order[:NAMED] if distances[i] > FAR]


def allan_spread(summaries):
    """Return six pictures: the Allan deviation of one axis, the band of all devices."""
    pictures = []
    for sensor, channels in SENSORS.items():
        for axis, channel in zip(XYZ, channels, strict=True):
            curves = [
                (s["label"], np.array(c["tau_s"], float), np.array(c["adev"], float))
                for s in summaries
                if (c := s["allan"].get(channel)) and len(c["tau_s"])
            ]
            if curves:
                pictures.append(_allan_picture(sensor, axis, channel, curves))
    return pictures


def _allan_picture(sensor, axis, channel, curves):
    first, last = (np.array([tau[k] for _, tau, _ in curves]) for k in (0, -1))
    # times that at least half of the devices have
    ends = np.median(first), np.median(last)
    common = float(np.clip(1.0, *ends))
    grid = np.unique(np.append(np.geomspace(*ends, TIMES), common))
    levels = np.array(
        [
            np.interp(np.log(grid), np.log(tau), np.log(adev), left=np.nan, right=np.nan)
            for _, tau, adev in curves
        ]
    )
    seen = np.isfinite(levels).any(axis=0)
    grid, levels = grid[seen], levels[:, seen]
    low, middle, high = np.exp(np.nanpercentile(levels, (5, 50, 95), axis=0))
    distances = far_out(levels)[:, grid <= max(KNOWN * grid[-1], common)].max(axis=1)
    out = standing_out(distances)
    at = int(np.abs(grid - common).argmin())

    def plot(ax):
        ax.fill_between(grid, low, high, color=BLUE)
        handles = ax.loglog(grid, middle, color=BLUE, lw=2)
        labels = ["median, 5–95 %"]
        for colour, i in zip(COLOURS, out, strict=False):
            label, tau, adev = curves[i]
            handles += ax.loglog(tau, adev, color=colour)
            labels.append(label if len(label) <= 14 else f"{label[:13]}…")
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(f"Allan deviation, {UNITS[sensor]}")
        ax.legend(handles, labels, beside=True)

    unit, over = UNITS[sensor], number(grid[at], 2)
    caption = (
        f"{sensor.capitalize()} {axis}, {len(curves)} devices: over {over} s the median is "
        f"{number(middle[at])} {unit}, nine of ten lie between {number(low[at])} and "
        f"{number(high[at])}; "
    )
    named = [f"{curves[i][0]}, {number(np.exp(levels[i, at]) / middle[at], 2)} ×" for i in out]
    count = int((distances > FAR).sum())
    caption += f"{count or 'none'} far from the others"
    caption += f": {'; '.join(named)}" if named else ""
    caption += "; …" if count > len(out) else ""
    name = f"comparison.allan_{channel}"
    svg = draw(name, f"Allan deviation, {caption}", 470, 270, plot, margins=(58, 130, 12, 40))
    return Picture(name, svg, f"{caption}.", "", ())


def parameter_spread(summaries, csv):
    """Return pictures of bias, scale factor error and misalignment of all devices."""
    return [
        _parameter_picture(key, words, display, names, rows, csv)
        for key, (words, display, names) in INTERVALS.items()
        if (rows := [(s["label"], s["axes"][key]) for s in summaries if key in s["axes"]])
    ]


def _parameter_picture(key, words, display, names, rows, csv):
    labels = [label for label, _ in rows]
    value = np.array([r["value"] for _, r in rows], float) * display.factor
    shown = np.flatnonzero(np.isfinite(value).any(axis=0))
    value = value[:, shown]
    distances = far_out(value)
    ends = np.nanpercentile(value, (5, 50, 95), axis=0)
    # each axis a strip, the first device on top
    place = np.linspace(-0.4, 0.4, len(rows))
    far = [(int(i), int(distances[i].argmax())) for i in standing_out(distances.max(axis=1))]

    def plot(ax):
        ax.axvline(0, color=INK, lw=0.8)
        for k in range(len(shown)):
            said = [f"{n} {number(v)}" for n, v in zip(labels, value[:, k], strict=True)]
            ax.plot(value[:, k], k + place, "o", color=BLUE, ms=3.4, alpha=0.55, titles=said)
            low, middle, high = ends[:, k]
            ax.plot([low, high], [k, k], color=INK, lw=2)
            ax.plot([middle, middle], [k - 0.4, k + 0.4], color=INK, lw=2)
            at = distances[:, k] > FAR
            ax.plot(value[at, k], k + place[at], "o", color=VERMILLION, ms=5)
        for i, k in far:
            side = "right" if value[i, k] > ends[1, k] else "left"
            ax.text(value[i, k], k + place[i] - 0.09, labels[i], side, "bottom", fontsize=10)
        ax.set_yticks(range(len(shown)), [names[j] for j in shown])
        ax.set_ylim(len(shown) - 0.5, -0.5)
        ax.set_xlabel(f"{words}, {display.unit}")

    spans = ", ".join(
        f"{names[j]} {number(m, 2)} ({number(a, 2)} to {number(b, 2)})"
        for j, (a, m, b) in zip(shown, ends.T, strict=True)
    )
    named = [f"{labels[i]}, {names[shown[k]]} {number(value[i, k])}" for i, k in far]
    count = int((distances.max(axis=1) > FAR).sum())
    caption = (
        f"{words.capitalize()}, {len(rows)} devices, {display.unit}, median and the span of nine "
        f"of ten: {spans}; {count or 'none'} far from the others"
    )
    caption += (f": {'; '.join(named)}" if named else "") + ("; …" if count > len(far) else "")
    name = f"comparison.{key}"
    height = 60 + 100 * len(shown)
    svg = draw(name, f"{caption}.", 440, height, plot, margins=(40, 12, 12, 42))
    return Picture(name, svg, f"{caption}.", NOTE, (csv,))
