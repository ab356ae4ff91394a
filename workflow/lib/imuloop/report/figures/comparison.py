"""All devices in one picture: each by itself, or how many spread and who stands out."""

import numpy as np
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from imuloop.report.figures.drawing import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PALETTE,
    PURPLE,
    VERMILLION,
    Picture,
    entitle,
    fill,
    write_csv,
)
from imuloop.report.numbers import number
from imuloop.report.results import FILE_UNITS, SENSORS, UNITS, XYZ
from imuloop.report.summary import PAIRS
from imuloop.report.units import DEGREE_PER_SECOND, MILLI_G, MILLIRADIAN, PERCENT

DASHES = ("-", "--", ":")
# colour and mark of each axis or pair of axes
MARKS = tuple(zip(PALETTE, "os^Dvp", strict=False))
INTERVALS = {
    f"{sensor}_{key}": (f"{sensor} {words}", display, names)
    for key, words, displays, names in (
        ("bias", "bias", (MILLI_G, DEGREE_PER_SECOND), XYZ),
        ("scale", "scale factor error", (PERCENT, PERCENT), XYZ),
        ("misalignment", "misalignment", (MILLIRADIAN, MILLIRADIAN), PAIRS),
    )
    for sensor, display in zip(SENSORS, displays, strict=True)
}
# robust standard deviations from the median from which on a device stands out
FAR = 5.0
# the most that are named in a picture
NAMED = 5
COLOURS = (VERMILLION, GREEN, PURPLE, ORANGE, INK)
# the most devices whose marks say whose they are; of more they are many and small
POINTED_AT = 300
# averaging times of the band, and the share of the longest up to which a curve is known well
TIMES, KNOWN = 60, 0.1


def line_style(index):
    """Return colour number and dash number of the device at that place; distinct up to 21."""
    return index % len(PALETTE), index % len(DASHES)


def shortened(label, most):
    """Return a label of at most so many letters."""
    return label if len(label) <= most else f"{label[: most - 1]}…"


def _drawn(folder, stem, kind, caption, plot, numbers, size):
    """Return a `Picture` of all devices; the numbers behind it are written into the folder."""
    write_csv(folder, stem, numbers)
    csv = f"{folder.name}/{stem}.csv"
    return Picture(f"all.{stem}", kind, caption, plot, size, csv)


def allan_comparison(summaries, folder, together):
    """Return six pictures: the Allan deviation of one axis of all devices, given summary.json.

    Where the devices are shown together there is a line per device; else the band of all, and who
    stands out. Their numbers are written into the folder.
    """
    pictures = []
    for sensor, channels in SENSORS.items():
        for axis, channel in zip(XYZ, channels, strict=True):
            curves = [
                (i, s["label"], np.array(c["tau_s"], float), np.array(c["adev"], float))
                for i, s in enumerate(summaries)
                if (c := s["allan"].get(channel)) and len(c["tau_s"])
            ]
            if curves:
                one = _allan_lines if together else _allan_band
                pictures.append(one(folder, f"comparison_allan_{channel}", sensor, axis, curves))
    return pictures


def _at(grid, tau, adev):
    """Return an Allan curve at other averaging times, its logarithm, NaN outside of it."""
    return np.interp(np.log(grid), np.log(tau), np.log(adev), left=np.nan, right=np.nan)


def _allan_lines(folder, stem, sensor, axis, curves):
    def plot(area):
        for i, _, tau, adev in curves:
            colour, dash = line_style(i)
            looks = {"color": PALETTE[colour], "ls": DASHES[dash]}
            area.loglog(tau, adev, **looks)
        area.set(**_labels(sensor))

    unit, caption = UNITS[sensor], f"{sensor.capitalize()} {axis}: "
    # the ends of the curves differ and are scarcely known: compared at a time that all have
    low, high = max(c[2][0] for c in curves), min(c[2][-1] for c in curves)
    common = float(np.clip(1.0, low, high))
    if low > high:
        caption += "; ".join(f"{w} down to {number(a.min())} {unit}" for _, w, _, a in curves)
    else:
        levels = sorted((np.exp(_at(common, tau, adev)), label) for _, label, tau, adev in curves)
        (least, best), (most, worst) = levels[0], levels[-1]
        caption += f"over {number(common, 2)} s "
        if len(levels) > 1:
            caption += f"{best} is steadiest, {number(least)} {unit}; {worst} least, "
        caption += f"{number(most)} {unit}"
    numbers = {
        "device": np.repeat([c[1] for c in curves], [len(c[2]) for c in curves]),
        "tau_s": np.concatenate([c[2] for c in curves]),
        f"adev_{FILE_UNITS[sensor]}": np.concatenate([c[3] for c in curves]),
    }
    return _drawn(folder, stem, "Allan deviation", f"{caption}.", plot, numbers, (380, 270))


def _allan_band(folder, stem, sensor, axis, curves):
    # times that at least half of the devices have
    ends = [np.median([c[2][k] for c in curves]) for k in (0, -1)]
    common = float(np.clip(1.0, *ends))
    grid = np.unique(np.append(np.geomspace(*ends, TIMES), common))
    levels = np.array([_at(grid, tau, adev) for _, _, tau, adev in curves])
    seen = np.isfinite(levels).any(axis=0)
    grid, levels = grid[seen], levels[:, seen]
    low, middle, high = np.exp(np.nanpercentile(levels, (5, 50, 95), axis=0))
    distances = far_out(levels)[:, grid <= max(KNOWN * grid[-1], common)].max(axis=1)
    out, at = standing_out(distances), int(np.abs(grid - common).argmin())

    def plot(area):
        # labels of artists may not begin with "_", those of devices may
        labels = ["median, 5–95 %", *(shortened(curves[i][1], 14) for i in out)]
        fill(area, grid, low, high, BLUE)
        handles = area.loglog(grid, middle, color=BLUE, lw=2)
        for colour, i in zip(COLOURS, out, strict=False):
            handles += area.loglog(*curves[i][2:], color=colour)
        area.set(**_labels(sensor))
        area.figure.legend(handles, labels, loc="outside right upper")

    named = [f"{curves[i][1]}, {number(np.exp(levels[i, at]) / middle[at], 2)} ×" for i in out]
    caption = (
        f"{sensor.capitalize()} {axis}, {len(curves)} devices: over {number(grid[at], 2)} s the "
        f"median is {number(middle[at])} {UNITS[sensor]}, nine of ten lie between "
        f"{number(low[at])} and {number(high[at])}; {_named(distances, named)}"
    )
    columns = zip(("p5", "median", "p95"), (low, middle, high), strict=True)
    numbers = {"tau_s": grid, **{f"adev_{k}_{FILE_UNITS[sensor]}": v for k, v in columns}}
    return _drawn(folder, stem, "Allan deviation", f"{caption}.", plot, numbers, (470, 270))


def _labels(sensor):
    return {"xlabel": "averaging time τ, s", "ylabel": f"Allan deviation, {UNITS[sensor]}"}


def far_out(values):
    """Return how far each value is from the median, in robust standard deviations.

    ``|x − median| / (1.4826 median |x − median|)`` along the first axis, 0 for not-a-number.

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


def _named(distances, named):
    """Return how many devices stand out and the farthest of them in words."""
    count = int((distances > FAR).sum())
    text = f"{count or 'none'} far from the others" + (f": {'; '.join(named)}" if named else "")
    return text + ("; …" if count > len(named) else "")


def parameter_comparison(summaries, folder):
    """Return how bias, scale factor error and misalignment of many devices spread, in pictures."""
    pictures = []
    for key, (words, display, names) in INTERVALS.items():
        found = [(s["label"], s["axes"][key]) for s in summaries if key in s["axes"]]
        if found:
            labels = [label for label, _ in found]
            # what was not estimated is not a number
            value, std = (
                np.array([r[k] for _, r in found], float) * display.factor for k in ("value", "std")
            )
            looks = _spread(words, display.unit, names, labels, value)
            numbers = {"device": np.repeat(labels, len(names)), "axis": names * len(labels)}
            numbers |= {f"value_{display.unit}": value.ravel(), f"std_{display.unit}": std.ravel()}
            pictures.append(_drawn(folder, f"comparison_{key}", numbers=numbers, **looks))
    return pictures


def _dots(x, y):
    """Return marks as one path of lines without a length."""
    path = Path(np.repeat(np.column_stack((x, y)), 2, axis=0), [Path.MOVETO, Path.LINETO] * len(x))
    path.should_simplify = False
    return PathPatch(path, fill=False, ec=BLUE, alpha=0.55, lw=3.4, capstyle="round")


def _spread(words, unit, names, labels, value):
    shown = np.flatnonzero(np.isfinite(value).any(axis=0))
    names, value = [names[j] for j in shown], value[:, shown]
    distances = far_out(value)
    ends = np.nanpercentile(value, (5, 50, 95), axis=0).T
    # each axis a strip, the first device on top
    place = np.linspace(-0.4, 0.4, len(labels))
    far = [(int(i), int(distances[i].argmax())) for i in standing_out(distances.max(axis=1))]

    def plot(area):
        area.axvline(0, color=INK, lw=0.8)
        for k, (low, middle, high) in enumerate(ends):
            known = np.isfinite(value[:, k])
            v, y, out = value[known, k], k + place[known], distances[known, k] > FAR
            if len(labels) > POINTED_AT:
                area.add_patch(_dots(v, y))
            else:
                (marks,) = area.plot(v, y, "o", color=BLUE, ms=3.4, alpha=0.55)
                said = zip(np.array(labels)[known], v, strict=True)
                entitle(area, marks, [f"{label} {number(each)}" for label, each in said])
            area.plot([low, high], [k, k], color=INK, lw=2)
            area.plot([middle, middle], [k - 0.4, k + 0.4], color=INK, lw=2)
            area.plot(v[out], y[out], "o", color=VERMILLION, ms=5)
        for i, k in far:
            side = "right" if value[i, k] > ends[k][1] else "left"
            where = value[i, k], k + place[i] - 0.09
            area.text(*where, labels[i], ha=side, va="bottom", fontsize=10)
        area.set_yticks(range(len(names)), names)
        area.set_ylim(len(names) - 0.5, -0.5)
        area.autoscale_view(scaley=False)
        area.set_xlabel(f"{words}, {unit}")

    spans = ", ".join(
        f"{n} {number(m, 2)} ({number(a, 2)} to {number(b, 2)})"
        for n, (a, m, b) in zip(names, ends, strict=True)
    )
    named = [f"{labels[i]}, {names[k]} {number(value[i, k])}" for i, k in far]
    caption = (
        f"{words.capitalize()}, {len(labels)} devices, {unit}, median and the span of nine "
        f"of ten: {spans}; {_named(distances.max(axis=1), named)}."
    )
    size = (440, 60 + 100 * len(shown))
    return {"kind": "Spread", "caption": caption, "plot": plot, "size": size}
