"""Allan deviation: measured with its interval, and the curve of the fitted model."""

import numpy as np

from imuloop.core.noise_model import AxisNoise
from imuloop.report.numbers import NOISE_UNITS, coefficient_text, missing
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.svg import AXES, Picture, decades, draw, write_csv

NOTE = (
    "How much two neighbouring means over τ seconds differ. Falling at −½: white noise, averaging "
    "helps. Lowest part: the best that averaging can do. Rising: the bias wanders. Band: 95 % "
    "interval; dashed: fitted model."
)
CORRECTED_NOTE = f"{NOTE[:-1]}; dotted: before correction."


def allan_pictures(device, session, folder):
    """Return the Allan deviation of a session's accelerometer and gyroscope.

    Parameters
    ----------
    device : Device
        The device.
    session : Session
        A session with an Allan table.
    folder : Path
        Where the CSV files go.
    """
    csv = write_csv(folder, f"{session.name}_allan", session.allan)
    axes = device.noise.get("axes", {})
    return [
        _picture(device, session, sensor, channels, axes, csv)
        for sensor, channels in SENSORS.items()
    ]


def curve(allan, axis, stage="corrected"):
    """Return the rows of one axis: of that stage, or the raw ones where it has none."""
    rows = allan[(allan["axis"] == axis) & (allan["adev"] > 0)]
    chosen = rows[rows["stage"] == stage]
    return (chosen if len(chosen) else rows[rows["stage"] == "raw"]).sort_values("tau_s")


def _picture(device, session, sensor, channels, axes, csv):
    curves = {c: curve(session.allan, c) for c in channels}

    def plot(ax):
        handles = []
        for colour, (channel, rows) in zip(AXES, curves.items(), strict=True):
            tau, adev = rows["tau_s"].to_numpy(), rows["adev"].to_numpy()
            handles += ax.loglog(tau, adev, color=colour)
            ax.fill_between(tau, rows["ci_low"], rows["ci_high"], color=colour, alpha=0.2, lw=0)
            raw = curve(session.allan, channel, "raw")
            if not np.array_equal(raw["adev"], adev):
                ax.loglog(raw["tau_s"], raw["adev"], color=colour, ls=":", lw=1)
            if channel in axes and len(tau):
                grid = np.geomspace(tau[0], tau[-1], 60)
                model = AxisNoise.from_dict(axes[channel]).allan_variance(grid)
                if (model > 0).all():
                    ax.loglog(grid, np.sqrt(model), color=colour, ls="--", lw=1)
        decades(ax.xaxis)
        decades(ax.yaxis)
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(f"Allan deviation, {UNITS[sensor]}")
        ax.legend(handles, XYZ, loc="best", ncols=3)

    caption = f"{session.name}, {sensor}: {_finding(sensor, channels, axes)}"
    lowest = "; ".join(
        f"{axis} lowest {rows['adev'].min():.3g} {UNITS[sensor]} at "
        f"{rows.loc[rows['adev'].idxmin(), 'tau_s']:.3g} s"
        for axis, rows in zip(XYZ, curves.values(), strict=True)
        if len(rows)
    )
    name = f"{device.name}.{session.name}.allan_{sensor}"
    svg = draw(name, f"Allan deviation, {sensor}, session {session.name}: {lowest}", 440, 300, plot)
    corrected = (session.allan["stage"] == "corrected").any()
    return Picture(name, svg, caption, CORRECTED_NOTE if corrected else NOTE, (csv,))


def _finding(sensor, channels, axes):
    """Return white noise and bias instability of the three axes in words."""
    parts = []
    for key, words in (("N", "white noise"), ("B", "bias instability")):
        unit = NOISE_UNITS[sensor][key][-1 if key == "B" or sensor == "gyroscope" else 1]
        found = [axes.get(c, {}).get(key) or {} for c in channels]
        values = [coefficient_text(c, unit.factor) for c in found]
        if all(missing(c.get("value")) and missing(c.get("upper95")) for c in found):
            continue
        parts.append(f"{words} {', '.join(values)} {unit.unit} (x, y, z)")
    return "; ".join(parts) + "." if parts else "no noise model could be fitted."
