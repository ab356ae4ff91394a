"""Allan deviation of all devices in one picture: a line each, or the band of many."""

import numpy as np

from imuloop.report.figures.drawing import BLUE, PALETTE, Picture, fill
from imuloop.report.numbers import number
from imuloop.report.results import FILE_UNITS, SENSORS, UNITS, XYZ

DASHES = ("-", "--", ":")
# averaging times of the band
TIMES = 60


def line_style(index):
    """Return the index of the colour, and the index of the dash, of the line of a device.

    `index` is the number of the device, from 0. The pairs of 21 devices are distinct.
    """
    return index % len(PALETTE), index % len(DASHES)


def allan_comparison(summaries, together):
    """Return pictures of the Allan deviation of all devices, a list: one per axis of each sensor.

    `summaries` are the contents of summary.json of the devices. If `together` is true, a picture
    has a line per device. Otherwise it has the median of all devices and the band from the 5th to
    the 95th percentile. An axis for which no device has a curve has no picture.
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
                draw = _lines if together else _band
                caption, plot, numbers = draw(sensor, curves)
                name, caption = f"all.comparison_allan_{channel}", f"{sensor} {axis}, {caption}."
                caption = caption[0].upper() + caption[1:]
                pictures.append(Picture(name, "Allan deviation", caption, plot, numbers))
    return pictures


def _lines(sensor, curves):
    """Return the caption, the function `plot` and the numbers of a Picture with a line per device.

    The picture shows the Allan deviation of an axis. `sensor` is the name of the sensor, and
    `curves` has a tuple for each device: its number, its label, averaging times in s, and Allan
    deviations, SI.
    """

    def plot(area):
        """Draw a line per device on the Axes `area`."""
        for i, _, tau, adev in curves:
            colour, dash = line_style(i)
            area.loglog(tau, adev, color=PALETTE[colour], ls=DASHES[dash])
        area.set(xlabel="averaging time τ, s", ylabel=f"Allan deviation, {UNITS[sensor]}")

    lowest = "; ".join(f"{label} {number(adev.min())}" for _, label, _, adev in curves)
    numbers = {
        "device": np.repeat([c[1] for c in curves], [len(c[2]) for c in curves]),
        "tau_s": np.concatenate([c[2] for c in curves]),
        f"adev_{FILE_UNITS[sensor]}": np.concatenate([c[3] for c in curves]),
    }
    return f"lowest Allan deviation, {UNITS[sensor]}: {lowest}", plot, numbers


def _band(sensor, curves):
    """Return caption, `plot` and numbers of a Picture with the median and the 5–95 % band.

    The picture shows the Allan deviation of an axis. `sensor` is the name of the sensor, and
    `curves` has a tuple for each device: its number, its label, averaging times in s, and Allan
    deviations, SI.
    """
    # averaging times at which at least half of the devices have a value
    ends = [np.median([c[2][k] for c in curves]) for k in (0, -1)]
    common = float(np.clip(1.0, *ends))
    grid = np.unique(np.append(np.geomspace(*ends, TIMES), common))
    outside = {"left": np.nan, "right": np.nan}
    levels = np.array(
        [np.interp(np.log(grid), np.log(t), np.log(adev), **outside) for _, _, t, adev in curves]
    )
    seen = np.isfinite(levels).any(axis=0)
    grid = grid[seen]
    low, middle, high = np.exp(np.nanpercentile(levels[:, seen], (5, 50, 95), axis=0))
    at = int(np.abs(grid - common).argmin())

    def plot(area):
        """Draw the median and the band of all devices on the Axes `area`."""
        fill(area, grid, low, high, BLUE)
        area.loglog(grid, middle, color=BLUE, lw=2, label="median, 5–95 %")
        area.set(xlabel="averaging time τ, s", ylabel=f"Allan deviation, {UNITS[sensor]}")

    caption = (
        f"{len(curves)} devices: at τ = {number(grid[at], 2)} s the median is {number(middle[at])} "
        f"{UNITS[sensor]}, nine of ten lie between {number(low[at])} and {number(high[at])}"
    )
    columns = zip(("p5", "median", "p95"), (low, middle, high), strict=True)
    return (
        caption,
        plot,
        {"tau_s": grid} | {f"adev_{k}_{FILE_UNITS[sensor]}": v for k, v in columns},
    )
