"""All devices in one picture: Allan curves of one axis, parameters with intervals."""

import numpy as np

from imuloop.report.numbers import DEGREE_PER_SECOND, MILLI_G, MILLIRADIAN, PERCENT, number
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.summary import PAIRS
from imuloop.report.svg import INK, PALETTE, Picture, draw

DASHES = ("-", "--", ":")
# colour and mark of each axis or pair of axes
MARKS = tuple(zip(PALETTE, "os^Dvp", strict=False))
INTERVALS = {
    "accelerometer_bias": ("accelerometer bias", MILLI_G, XYZ),
    "gyroscope_bias": ("gyroscope bias", DEGREE_PER_SECOND, XYZ),
    "accelerometer_scale": ("accelerometer scale factor error", PERCENT, XYZ),
    "gyroscope_scale": ("gyroscope scale factor error", PERCENT, XYZ),
    "accelerometer_misalignment": ("accelerometer misalignment", MILLIRADIAN, PAIRS),
    "gyroscope_misalignment": ("gyroscope misalignment", MILLIRADIAN, PAIRS),
}


def line_style(index):
    """Return colour number and dash number of the device at that place; distinct up to 21."""
    return index % len(PALETTE), index % len(DASHES)


def allan_comparison(summaries):
    """Return six pictures: the Allan deviation of one axis, a line a device."""
    pictures = []
    for sensor, channels in SENSORS.items():
        for axis, channel in zip(XYZ, channels, strict=True):
            curves = [
                (i, s["label"], np.array(c["tau_s"], float), np.array(c["adev"], float))
                for i, s in enumerate(summaries)
                if (c := s["allan"].get(channel)) and len(c["tau_s"])
            ]
            if curves:
                pictures.append(_allan_picture(sensor, axis, channel, curves))
    return pictures


def common_time(curves):
    """Return an averaging time that all curves have, 1 s if they can, s; None if they share none.

    The ends of the curves differ and are scarcely known, so devices are compared here.
    """
    low, high = max(c[2][0] for c in curves), min(c[2][-1] for c in curves)
    return float(np.clip(1.0, low, high)) if low <= high else None


def _allan_picture(sensor, axis, channel, curves):
    def plot(ax):
        for i, _, tau, adev in curves:
            colour, dash = line_style(i)
            ax.loglog(tau, adev, color=PALETTE[colour], ls=DASHES[dash])
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(f"Allan deviation, {UNITS[sensor]}")

    unit = UNITS[sensor]
    lowest = [(adev.min(), tau[adev.argmin()], label) for _, label, tau, adev in curves]
    caption = f"{sensor.capitalize()} {axis}: "
    common = common_time(curves)
    if common is None:
        caption += "; ".join(f"{w} down to {number(a)} {unit}" for a, _, w in lowest)
    else:
        levels = sorted(
            (np.exp(np.interp(np.log(common), np.log(tau), np.log(adev))), label)
            for _, label, tau, adev in curves
        )
        told = [f"{number(level)} {unit}" for level, _ in levels]
        caption += f"over {number(common, 2)} s "
        if len(levels) > 1:
            caption += f"{levels[0][1]} is steadiest, {told[0]}; {levels[-1][1]} least, {told[-1]}"
        else:
            caption += told[0]
    name = f"comparison.allan_{channel}"
    alt = f"Allan deviation of {sensor} {axis}: " + "; ".join(
        f"{label} lowest {a:.3g} {unit} at {t:.3g} s" for a, t, label in lowest
    )
    return Picture(name, draw(name, alt, 380, 270, plot), f"{caption}.", "", ())


def interval_comparison(summaries, csv):
    """Return pictures of bias, scale factor error and misalignment with 95 % intervals."""
    return [
        _interval_picture(key, words, display, names, rows, csv)
        for key, (words, display, names) in INTERVALS.items()
        if (rows := [(s["label"], s["axes"][key]) for s in summaries if key in s["axes"]])
    ]


def _interval_picture(key, words, display, names, rows, csv):
    count = len(rows)
    # what was not estimated is not a number
    value, std = (
        np.array([r[k] for _, r in rows], float) * display.factor for k in ("value", "std")
    )
    shown = np.flatnonzero(np.isfinite(value).any(axis=0))

    def plot(ax):
        ax.axvline(0, color=INK, lw=0.8)
        offsets = np.linspace(-0.3, 0.3, len(shown)) if len(shown) > 3 else 0.2 * (shown - 1)
        for i, offset in zip(shown, offsets, strict=True):
            colour, mark = MARKS[i]
            half = 1.96 * np.nan_to_num(std[:, i])
            place = np.arange(count) + offset
            ax.errorbar(value[:, i], place, xerr=half, fmt=mark, color=colour, ms=5, lw=1.5)
            ax.plot([], [], mark, color=colour, ms=5, label=names[i])
        labels = [label if len(label) <= 22 else label[:21] + "…" for label, _ in rows]
        ax.set_yticks(range(count), labels)
        ax.set_ylim(count - 0.5, -0.5)
        ax.set_xlabel(f"{words}, {display.unit}")
        ax.legend()

    size = zip(np.nanmax(np.abs(value), axis=1), (label for label, _ in rows), strict=True)
    largest = "largest axis" if names == XYZ else "largest pair of axes"
    caption = f"{words.capitalize()}, {largest}: " + ", ".join(
        f"{label} {number(v)} {display.unit}" for v, label in sorted(size)
    )
    name = f"comparison.{key}"
    height = 90 + (34 if len(shown) <= 3 else 52) * count
    svg = draw(name, caption, 380, height, plot, margins=(140, 12, 28, 42))
    note = "Bars: 95 % interval; where none shows, it is smaller than the mark."
    return Picture(name, svg, f"{caption}.", note, (csv,))
