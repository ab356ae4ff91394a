"""Allan deviation with the fitted model, as logged and corrected, and deviations of other names."""

from itertools import cycle

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.noise.representations import label
from imuloop.report.figures.drawing import AXES, INK, PALETTE, fill, picture, write_csv
from imuloop.report.noise_units import quantities
from imuloop.report.numbers import coefficient_text, missing, number, with_unit
from imuloop.report.results import SENSORS, UNITS, XYZ

# views that have pictures of their own
SPECTRA = ("psd", "autocorrelation")


def curve(allan, channel, stage="corrected"):
    """Return the rows of one channel: of that stage, or the raw ones where it has none."""
    known = allan[(allan["axis"] == channel) & (allan["adev"] > 0)]
    chosen = known[known["stage"] == stage]
    return (chosen if len(chosen) else known[known["stage"] == "raw"]).sort_values("tau_s")


def draw_allan(area, measured, content, colour=INK, lowest=0.0):
    """Draw an Allan curve with its interval, the model of noise.json and each of its terms.

    A term has its letter where it is largest, if it is above the `lowest` level.
    """
    tau = measured["tau_s"].to_numpy()
    handles = area.loglog(tau, measured["adev"], color=colour, lw=1.6)
    fill(area, tau, measured["ci_low"], measured["ci_high"], colour)
    labels = ["measured, 95 % band"]
    grid = np.geomspace(tau[0], tau[-1], 30) if len(tau) else tau
    model = AxisNoise.from_dict(content).allan_variance(grid) if content else np.zeros(1)
    if not len(tau) or not (model > 0).all():
        return handles, labels
    for letter, values in _terms(content, grid).items():
        part = area.loglog(grid, values, color=INK, ls=":", lw=1)
        shown = np.flatnonzero(values > lowest)
        if len(shown):
            # at the end where the term is largest
            at = shown[values[shown].argmax()]
            side = "left" if at < len(grid) / 2 else "right"
            area.text(grid[at], values[at], letter, ha=side, va="bottom", fontsize=10)
    whole = area.loglog(grid, np.sqrt(model), color=INK, ls="--", lw=1.2)
    return handles + whole + part, [*labels, "model", "its terms"]


def _terms(content, tau):
    """Return the Allan deviation of each term of a model alone, by its letter."""
    terms = {}
    for key in "QNBKR":
        if not missing((content.get(key) or {}).get("value")):
            alone = AxisNoise(**{key: Coefficient.from_dict(content[key])})
            terms[key] = np.sqrt(alone.allan_variance(tau))
    whole = AxisNoise.from_dict(content)
    for key, letter in (("gauss_markov", "GM"), ("sinusoid", "line")):
        for process in getattr(whole, key):
            variance = AxisNoise(**{key: (process,)}).allan_variance(tau)
            terms[letter] = np.sqrt(terms.get(letter, 0) ** 2 + variance)
    return terms


def allan_pictures(device, session):
    """Return the Allan deviation of a session's accelerometer and gyroscope."""
    if not session.has_allan:
        return []
    csv = write_csv(device.figures, f"{session.name}_allan", session.allan)
    found = []
    for sensor, channels in SENSORS.items():
        curves = {c: curve(session.allan, c, "raw") for c in channels}
        # without noise there is no deviation above 0
        if not any(len(r) for r in curves.values()):
            continue

        def plot(areas, curves=curves, sensor=sensor):
            ends = [r[c] for r in curves.values() for c in ("ci_low", "ci_high")]
            low = min(v[v > 0].min() for v in ends if (v > 0).any())
            high = max(np.nanmax(v) for v in ends if np.isfinite(v).any())
            for area, axis, colour, (channel, r) in zip(
                areas, XYZ, AXES, curves.items(), strict=True
            ):
                key = draw_allan(area, r, device.axes.get(channel), colour, low)
                area.set_xlabel(f"{axis}: averaging time τ, s")
            # a term may lie far below the curve
            areas[0].set_ylim(low / 1.3, high * 1.3)
            areas[0].set_ylabel(f"Allan deviation, {UNITS[sensor]}")
            return key

        found.append(
            picture(
                f"{device.name}.{session.name}.allan_{sensor}",
                "Allan deviation",
                f"{session.name}, {sensor}: {_finding(device, sensor)}{_fit(device, curves)}",
                plot,
                (1000, 280),
                csv,
                wide=True,
                columns=(1, 1, 1),
                sharey=True,
            )
        )
    return found


def _fit(device, curves):
    """Return at how many averaging times the model lies within the band."""
    inside, count = 0, 0
    for channel, r in curves.items():
        if channel in device.axes:
            variance = AxisNoise.from_dict(device.axes[channel]).allan_variance(r["tau_s"])
            inside += r["adev"][
                r["ci_low"].pow(2).le(variance) & r["ci_high"].pow(2).ge(variance)
            ].size
            count += len(r) if (variance > 0).all() else 0
    return f" The model lies in the band at {inside} of {count} averaging times." if count else ""


def _finding(device, sensor):
    """Return white noise, bias instability and humps of the three axes in words."""
    contents = [device.axes.get(c) or {} for c in SENSORS[sensor]]
    parts = []
    for key, words in (("N", "white noise"), ("B", "bias instability")):
        unit = quantities(sensor)[key].sheet[0]
        found = [content.get(key) or {} for content in contents]
        if not all(missing(c.get("value")) and missing(c.get("upper95")) for c in found):
            values = ", ".join(coefficient_text(c, unit.factor) for c in found)
            parts.append(f"{words} {values} {unit.unit} (x, y, z)")
    for kind, key, words in (
        ("gauss_markov", "tc", "hump of a Gauss–Markov process, T = {} s ({})"),
        ("sinusoid", "frequency", "hump of a line of {} Hz ({})"),
    ):
        parts += [
            words.format(number(process[key].get("value")), axis)
            for axis, content in zip(XYZ, contents, strict=True)
            for process in content.get(kind) or []
        ]
    return "; ".join(parts) + "." if parts else "no noise model could be fitted."


def corrected_pictures(device, sensor):
    """Return the Allan deviation as logged and corrected, of each session that changed."""
    pictures = []
    for session in device.used:
        if not session.has_allan:
            continue
        curves = {
            axis: [curve(session.allan, channel, stage) for stage in ("raw", "corrected")]
            for axis, channel in zip(XYZ, SENSORS[sensor], strict=True)
        }
        if all(np.array_equal(raw["adev"], after["adev"]) for raw, after in curves.values()):
            continue

        def plot(area, curves=curves):
            handles = []
            for colour, (raw, after) in zip(AXES, curves.values(), strict=True):
                handles += area.loglog(after["tau_s"], after["adev"], color=colour)
                fill(area, after["tau_s"], after["ci_low"], after["ci_high"], colour)
                area.loglog(raw["tau_s"], raw["adev"], color=colour, ls=":", lw=1.6)
            area.set_xlabel("averaging time τ, s")
            area.set_ylabel(f"Allan deviation, {UNITS[sensor]}")
            return handles, XYZ

        stem = f"{session.name}_allan_{sensor}_corrected"
        of_sensor = session.allan[np.isin(session.allan["axis"], SENSORS[sensor])]
        parts = [
            f"{axis} {text}" for axis, pair in curves.items() if (text := _fall(sensor, *pair))
        ]
        pictures.append(
            picture(
                f"{device.name}.{session.name}.allan_{sensor}_corrected",
                "Allan deviation",
                f"{session.name}, {sensor}, as logged and corrected: {'; '.join(parts)}.",
                plot,
                csv=write_csv(device.figures, stem, of_sensor),
            )
        )
    return pictures


def _fall(sensor, raw, after):
    """Return by how much the correction lowers a curve where it lowers it most."""
    raw = raw[raw["tau_s"].between(after["tau_s"].min(), after["tau_s"].max())]
    if raw.empty:
        return ""
    # the two may have other averaging times
    level = np.exp(np.interp(np.log(raw["tau_s"]), np.log(after["tau_s"]), np.log(after["adev"])))
    k = int((raw["adev"] / level).to_numpy().argmax())
    tau, adev = raw[["tau_s", "adev"]].iloc[k]
    return (
        f"{number(adev, 2)} → {with_unit(number(level[k], 2), UNITS[sensor])} at "
        f"{with_unit(number(tau, 2), 's')}"
    )


def definitions(device):
    """Return what each deviation beside Allan's means that was asked for."""
    asked = (s.views["view"].unique() for s in device.used if s.views is not None)
    return [
        label(n) for n in dict.fromkeys(n for names in asked for n in names) if n not in SPECTRA
    ]


def deviation_pictures(device, session):
    """Return the deviations beside Allan's that were asked for, each with its definition."""
    if session.views is None:
        return []
    table = session.views[~session.views["view"].isin(SPECTRA)].dropna(subset="value")
    if table.empty:
        return []
    called = {"view": "definition", "x": "tau_s", "value": "deviation"}
    csv = write_csv(device.figures, f"{session.name}_deviations", table.rename(columns=called))
    names = list(dict.fromkeys(table["view"]))
    found = {_short(n): table[table["view"] == n] for n in names}
    if session.has_allan:
        allan = session.allan[session.allan["stage"] == "raw"]
        found = {"Allan": allan.rename(columns={"tau_s": "x", "adev": "value"}), **found}
    colours = [INK] * session.has_allan + list(PALETTE)

    def one(sensor, channels):
        def plot(areas):
            for area, axis, channel in zip(areas, XYZ, channels, strict=True):
                handles = []
                for colour, curves in zip(cycle(colours), found.values(), strict=False):
                    r = curves[curves["axis"] == channel]
                    handles += area.loglog(r["x"], r["value"], color=colour)
                    fill(area, r["x"], r["ci_low"], r["ci_high"], colour, 0.1)
                area.set_xlabel(f"{axis}: averaging time τ, s")
            areas[0].set_ylabel(f"deviation, {UNITS[sensor]}")
            return handles, list(found)

        lows = []
        for words, curves in found.items():
            low = curves.groupby(curves["axis"].astype(str))["value"].min().reindex(channels)
            if low.notna().any():
                size = with_unit(number(low.max()), UNITS[sensor])
                lows.append(f"{words} {size} ({low.idxmax()[-1]})")
        caption = (
            f"{session.name}, {sensor}: lowest part, by definition, of the axis where it is "
            f"highest: {'; '.join(lows)}."
        )
        return picture(
            f"{device.name}.{session.name}.deviations_{sensor}",
            "Deviations of several definitions",
            caption,
            plot,
            (1000, 300),
            csv,
            wide=True,
            legend="outside right upper",
            columns=(1, 1, 1),
            sharey=True,
        )

    return [one(*each) for each in SENSORS.items()]


def _short(name):
    """Return how a deviation is called: the part of its label before what it means."""
    return label(name).partition(" deviation")[0].replace("M-", f"{name.rpartition('_')[2]}-")
