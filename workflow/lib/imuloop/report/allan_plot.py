"""Allan deviation: measured with its interval, and the curve of the fitted model."""

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.report.columns import rows
from imuloop.report.numbers import NOISE_UNITS, coefficient_text, missing, number, with_unit
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.svg import AXES, INK, Picture, draw, write_csv

NOTE = (
    "How much two neighbouring means over τ seconds differ. Falling at −½: white noise N, "
    "averaging helps. Lowest part: the best that averaging can do, B. Rising: the bias wanders, K "
    "and R. GM: a Gauss–Markov process. Good: the dashed model stays in the band, and the curve "
    "still falls at the times over which you average."
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
        # without noise there is no deviation above 0
        if any(len(curve(session.allan, channel, "raw")["tau_s"]) for channel in channels)
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
            ax.fill_between(*(after[c] for c in ("tau_s", "ci_low", "ci_high")), color=colour)
            ax.loglog(raw["tau_s"], raw["adev"], color=colour, ls=":", lw=1.6)
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(f"Allan deviation, {UNITS[sensor]}")
        ax.legend(handles, XYZ)

    parts = [f"{axis} {text}" for axis, pair in curves.items() if (text := _fall(sensor, *pair))]
    caption = f"{session.name}, {sensor}, as logged and corrected: {'; '.join(parts)}."
    stem = f"{session.name}_allan_{sensor}_corrected"
    of_sensor = np.isin(session.allan["axis"].astype(str), SENSORS[sensor])
    csv = write_csv(folder, stem, rows(session.allan, of_sensor))
    name = f"{device.name}.{session.name}.allan_{sensor}_corrected"
    alt = f"Allan deviation, {caption}"
    return Picture(name, draw(name, alt, 440, 300, plot), caption, CORRECTED_NOTE, (csv,))


def _fall(sensor, raw, after):
    """Return by how much the correction lowers a curve where it lowers it most."""
    tau, adev = raw["tau_s"], raw["adev"]
    if not len(tau) or not len(after["tau_s"]):
        return ""
    inside = (tau >= after["tau_s"][0]) & (tau <= after["tau_s"][-1])
    if not inside.any():
        return ""
    tau, adev = tau[inside], adev[inside]
    # the two may have other averaging times
    level = np.exp(np.interp(np.log(tau), np.log(after["tau_s"]), np.log(after["adev"])))
    k = int((adev / level).argmax())
    return (
        f"{number(adev[k], 2)} → {with_unit(number(level[k], 2), UNITS[sensor])} at "
        f"{with_unit(number(tau[k], 2), 's')}"
    )


def curve(allan, axis, stage="corrected"):
    """Return the rows of one axis: of that stage, or the raw ones where it has none."""
    known = (allan["axis"] == axis) & (allan["adev"] > 0)
    chosen = known & (allan["stage"] == stage)
    at = np.flatnonzero(chosen if chosen.any() else known & (allan["stage"] == "raw"))
    return rows(allan, at[np.argsort(allan["tau_s"][at], kind="stable")])


def _terms(content, tau):
    """Return the Allan deviation of each term of a model alone, by its letter."""
    terms = {}
    for key in "QNBKR":
        if not missing((content.get(key) or {}).get("value")):
            known = {key: Coefficient.from_dict(content[key])}
            terms[key] = np.sqrt(AxisNoise(**known).allan_variance(tau))
    whole = AxisNoise.from_dict(content)
    for key, letter in (("gauss_markov", "GM"), ("sinusoid", "line")):
        for process in getattr(whole, key):
            alone = AxisNoise(**{key: (process,)})
            terms[letter] = np.sqrt(terms.get(letter, 0) ** 2 + alone.allan_variance(tau))
    return terms


def _picture(device, session, sensor, channels, axes, csv):
    curves = {c: curve(session.allan, c, "raw") for c in channels}

    def plot(areas):
        levels = [r[c] for r in curves.values() for c in ("ci_low", "ci_high")]
        levels = np.concatenate([v[v > 0] for v in levels])
        for ax, axis, colour, (channel, r) in zip(areas, XYZ, AXES, curves.items(), strict=True):
            ax.set_xlabel(f"{axis}: averaging time τ, s")
            tau = r["tau_s"]
            ax.fill_between(tau, r["ci_low"], r["ci_high"], color=colour)
            measured = ax.loglog(tau, r["adev"], color=colour, lw=1.6)
            # a term may lie far below the curve
            ax.set_ylim(levels.min() / 1.3, levels.max() * 1.3)
            if not len(tau):
                continue
            handles, labels = measured, ["measured, 95 % band"]
            grid = np.geomspace(tau[0], tau[-1], 30)
            content = axes.get(channel)
            model = AxisNoise.from_dict(content).allan_variance(grid) if content else np.zeros(1)
            if (model > 0).all():
                for letter, values in _terms(content, grid).items():
                    part = ax.loglog(grid, values, color=INK, ls=":", lw=1)
                    shown = np.flatnonzero(values > levels.min())
                    if len(shown):
                        # at the end where the term is largest
                        at = shown[values[shown].argmax()]
                        side = "left" if at < len(grid) / 2 else "right"
                        ax.text(grid[at], values[at], letter, side, "bottom", fontsize=10)
                whole = ax.loglog(grid, np.sqrt(model), color=INK, ls="--", lw=1.2)
                handles, labels = handles + whole + part, [*labels, "model", "its terms"]
        areas[0].set_ylabel(f"Allan deviation, {UNITS[sensor]}")
        areas[-1].legend(handles, labels)

    caption = f"{session.name}, {sensor}: {_finding(sensor, channels, axes)}{_fit(curves, axes)}"
    lowest = "; ".join(
        f"{axis} lowest {r['adev'].min():.3g} {UNITS[sensor]} at "
        f"{r['tau_s'][r['adev'].argmin()]:.3g} s"
        for axis, r in zip(XYZ, curves.values(), strict=True)
        if len(r["adev"])
    )
    name = f"{device.name}.{session.name}.allan_{sensor}"
    svg = draw(
        name,
        f"Allan deviation, {sensor}, session {session.name}: {lowest}",
        1000,
        280,
        plot,
        columns=(1, 1, 1),
        sharey=True,
    )
    return Picture(name, svg, caption, NOTE, (csv,), wide=True)


def _fit(curves, axes):
    """Return at how many averaging times the model lies within the band."""
    inside, count = 0, 0
    for channel, r in curves.items():
        if channel in axes:
            model = np.sqrt(AxisNoise.from_dict(axes[channel]).allan_variance(r["tau_s"]))
            inside += int(((r["ci_low"] <= model) & (model <= r["ci_high"])).sum())
            count += len(model) if (model > 0).all() else 0
    return f" The model lies in the band at {inside} of {count} averaging times." if count else ""


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
