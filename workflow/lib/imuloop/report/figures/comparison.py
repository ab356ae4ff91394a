"""Allan deviation of all devices in one picture: a line each, or the band of many."""

import numpy as np

from imuloop.report.figures.drawing import BLUE, PALETTE, Picture, fill, write_csv
from imuloop.report.numbers import number
from imuloop.report.results import FILE_UNITS, SENSORS, UNITS, XYZ

DASHES = ("-", "--", ":")
# averaging times of the band
TIMES = 60


def line_style(index):
    """Return colour number and dash number of the device at that place; distinct up to 21."""
    return index % len(PALETTE), index % len(DASHES)


def _drawn(folder, stem, kind, caption, plot, numbers, size):
    """Return a `Picture` of all devices; the numbers behind it are written into the folder."""
    write_csv(folder, stem, numbers)
    csv = f"{folder.name}/{stem}.csv"
    return Picture(f"all.{stem}", kind, caption, plot, size, csv)


def allan_comparison(summaries, folder, together):
    """Return six pictures: the Allan deviation of one axis of all devices, given summary.json.

    Where the devices are shown together there is a line per device, else the band of all. Their
    numbers are written into the folder.
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

    lowest = "; ".join(f"{w} down to {number(a.min())}" for _, w, _, a in curves)
    caption = f"{sensor.capitalize()} {axis}, {UNITS[sensor]}: {lowest}"
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
    at = int(np.abs(grid - common).argmin())

    def plot(area):
        fill(area, grid, low, high, BLUE)
        area.loglog(grid, middle, color=BLUE, lw=2, label="median, 5–95 %")
        area.set(**_labels(sensor))

    caption = (
        f"{sensor.capitalize()} {axis}, {len(curves)} devices: over {number(grid[at], 2)} s the "
        f"median is {number(middle[at])} {UNITS[sensor]}, nine of ten lie between "
        f"{number(low[at])} and {number(high[at])}"
    )
    columns = zip(("p5", "median", "p95"), (low, middle, high), strict=True)
    numbers = {"tau_s": grid, **{f"adev_{k}_{FILE_UNITS[sensor]}": v for k, v in columns}}
    return _drawn(folder, stem, "Allan deviation", f"{caption}.", plot, numbers, (380, 270))


def _labels(sensor):
    return {"xlabel": "averaging time τ, s", "ylabel": f"Allan deviation, {UNITS[sensor]}"}
