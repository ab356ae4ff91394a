"""Allan deviation: measured with its interval, and the curve of the fitted model."""

import numpy as np

from imuloop.core.noise_model import AxisNoise
from imuloop.report.numbers import NOISE_UNITS, coefficient_text, missing, number, with_unit
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.svg import AXES, Picture, decades, draw, write_csv

NOTE = (
    "How much two neighbouring means over τ seconds differ. Falling at −½: white noise, averaging "
    "helps. Lowest part: the best that averaging can do. Rising: the bias wanders. Band: 95 % "
    "interval; dashed: fitted model."
)
CORRECTED_NOTE = (
    "Dotted: as logged. Solid, with its 95 % interval: after the effects were taken out. Where the "
    "two part, the long end of the dotted curve was an effect and no noise: read as bias "
    "instability or random walk it would be wrong."
)


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


def corrected_pictures(device, sensor, folder):
    """Return the Allan deviation as logged and after correction, of each session that changed.

    Parameters
    ----------
    device : Device
        The device.
    sensor : str
        Its sensor.
    folder : Path
        Where the CSV files go.
    """
    pictures = []
    for session in device.used:
        if session.allan is None:
            continue
        curves = {
            axis: [curve(session.allan, channel, stage) for stage in ("raw", "corrected")]
            for axis, channel in zip(XYZ, SENSORS[sensor], strict=True)
        }
        if any(not np.array_equal(raw["adev"], after["adev"]) for raw, after in curves.values()):
            pictures.append(_corrected_picture(device, session, sensor, curves, folder))
    return pictures


def _corrected_picture(device, session, sensor, curves, folder):
    def plot(ax):
        handles = []
        for colour, (raw, after) in zip(AXES, curves.values(), strict=True):
            handles += ax.loglog(after["tau_s"], after["adev"], color=colour)
            band = (after[c].to_numpy() for c in ("tau_s", "ci_low", "ci_high"))
            ax.fill_between(*band, color=colour, alpha=0.2, lw=0)
            ax.loglog(raw["tau_s"], raw["adev"], color=colour, ls=":", lw=1.6)
        decades(ax.xaxis)
        decades(ax.yaxis)
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(f"Allan deviation, {UNITS[sensor]}")
        ax.legend(handles, XYZ, loc="best", ncols=3)

    parts = [f"{axis} {text}" for axis, pair in curves.items() if (text := _fall(sensor, *pair))]
    caption = f"{session.name}, {sensor}, as logged and corrected: {'; '.join(parts)}."
    stem = f"{session.name}_allan_{sensor}_corrected"
    rows = session.allan[session.allan["axis"].isin(SENSORS[sensor])]
    csv = write_csv(folder, stem, rows)
    name = f"{device.name}.{session.name}.allan_{sensor}_corrected"
    alt = f"Allan deviation, {caption}"
    return Picture(name, draw(name, alt, 440, 300, plot), caption, CORRECTED_NOTE, (csv,))


def _fall(sensor, raw, after):
    """Return by how much the correction lowers a curve where it lowers it most."""
    both = raw.merge(after, on="tau_s", suffixes=("", "_after"))
    if not len(both):
        return ""
    most = both.loc[(both["adev"] / both["adev_after"]).idxmax()]
    return (
        f"{number(most['adev'], 2)} → {with_unit(number(most['adev_after'], 2), UNITS[sensor])} "
        f"at {with_unit(number(most['tau_s'], 2), 's')}"
    )


def curve(allan, axis, stage="corrected"):
    """Return the rows of one axis: of that stage, or the raw ones where it has none."""
    rows = allan[(allan["axis"] == axis) & (allan["adev"] > 0)]
    chosen = rows[rows["stage"] == stage]
    return (chosen if len(chosen) else rows[rows["stage"] == "raw"]).sort_values("tau_s")


def _picture(device, session, sensor, channels, axes, csv):
    curves = {c: curve(session.allan, c, "raw") for c in channels}

    def plot(ax):
        handles = []
        for colour, (channel, rows) in zip(AXES, curves.items(), strict=True):
            tau, adev = rows["tau_s"].to_numpy(), rows["adev"].to_numpy()
            handles += ax.loglog(tau, adev, color=colour)
            ax.fill_between(tau, rows["ci_low"], rows["ci_high"], color=colour, alpha=0.2, lw=0)
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
    return Picture(name, svg, caption, NOTE, (csv,))


def _finding(sensor, channels, axes):
    """Return white noise and bias instability of the three axes in words."""
    parts = []
    for key, words in (("N", "white noise"), ("B", "bias instability")):
        unit = NOISE_UNITS[sensor][key][1]
        found = [axes.get(c, {}).get(key) or {} for c in channels]
        values = [coefficient_text(c, unit.factor) for c in found]
        if all(missing(c.get("value")) and missing(c.get("upper95")) for c in found):
            continue
        parts.append(f"{words} {', '.join(values)} {unit.unit} (x, y, z)")
    for kind, key, words in (
        ("gauss_markov", "tc", "hump of a Gauss–Markov process, T = {} s ({})"),
        ("sinusoid", "frequency", "hump of a line of {} Hz ({})"),
    ):
        parts += [
            words.format(number(process[key].get("value")), axis)
            for axis, channel in zip(XYZ, channels, strict=True)
            for process in (axes.get(channel) or {}).get(kind) or []
        ]
    return "; ".join(parts) + "." if parts else "no noise model could be fitted."
