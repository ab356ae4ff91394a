"""Allan deviation with the fitted model, as logged and corrected."""

import numpy as np

from imuloop.core.noise_model import AxisNoise
from imuloop.noise.gains import term_gain
from imuloop.report.figures.drawing import AXES, INK, Picture, drawn, fill, write_csv
from imuloop.report.numbers import coefficient_text, number
from imuloop.report.results import SENSORS, UNITS, XYZ, of_axes
from imuloop.report.units import quantities

# each term of a model and its letter
TERMS = {k: k for k in "QNBKR"} | {"gauss_markov": "GM", "sinusoid": "line"}
# terms whose values stand beside their letters
VALUED = "NBK"


def curve(allan, channel, stage="corrected"):
    """Return the rows of one channel: of that stage, or the raw ones where it has none."""
    known = allan[(allan["axis"] == channel) & (allan["adev"] > 0)]
    chosen = known[known["stage"] == stage]
    return (chosen if len(chosen) else known[known["stage"] == "raw"]).sort_values("tau_s")


def longest_curve_first(sessions):
    """Return the sessions with an Allan curve, that with the longest averaging time first."""
    return sorted((s for s in sessions if len(s.allan)), key=lambda s: -s.allan["tau_s"].max())


def draw_allan(area, measured, noise, sensor, colour=INK, lowest=0.0):
    """Draw an Allan curve with its interval, the model of an `AxisNoise` and each of its terms.

    In the unit of the tables. A term has its letter where it is largest, if it is above the
    `lowest` level, SI; N, B and K have their values beside it.
    """
    unit = deviation_unit(sensor)
    tau = measured["tau_s"].to_numpy()
    area.loglog(
        tau, unit.factor * measured["adev"], color=colour, lw=1.6, label="measured, 95 % band"
    )
    band = (unit.factor * measured[end] for end in ("ci_low", "ci_high"))
    fill(area, tau, *band, colour)
    grid = np.geomspace(tau[0], tau[-1], 30) if len(tau) else tau
    model = noise.allan_variance(grid) - (taken_by_filter(noise, grid) if len(tau) else 0.0)
    if not len(tau) or not (model > 0).all():
        return
    area.loglog(grid, unit.factor * np.sqrt(model), color=INK, ls="--", lw=1.2, label="model")
    for term, letter in TERMS.items():
        values = np.sqrt(AxisNoise(**{term: getattr(noise, term)}).allan_variance(grid))
        if not values.any():
            continue
        looks = {"color": INK, "ls": ":", "lw": 1, "label": "its terms"}
        area.loglog(grid, unit.factor * values, **looks)
        shown = np.flatnonzero(values > lowest)
        if not len(shown):
            continue
        # at the end where the term is largest
        at = shown[values[shown].argmax()]
        side = "left" if at < len(grid) / 2 else "right"
        if term in VALUED:
            sheet = quantities(sensor)[term].sheet[0]
            letter += f" {sheet.size(getattr(noise, term).size)}"
            area.plot(grid[at], unit.factor * values[at], "o", color=INK, ms=4)
        area.text(grid[at], unit.factor * values[at], letter, ha=side, va="bottom", fontsize=10)


def taken_by_filter(noise, tau):
    r"""Return the Allan variance of white noise that a low-pass filter takes, shape (k,).

    .. math:: \int_0^{r/2} 4 N^2 [1 - G(f)] \frac{\sin^4 \pi f \tau}{(\tau r \sin \pi f/r)^2} df

    with G its power gain, for averaging times in s of which the first is the sampling interval 1/r.
    """
    if not noise.low_pass:
        return np.zeros(len(tau))
    rate = 1 / tau[0]
    f = np.geomspace(rate * 1e-5, rate / 2, 4000)
    kernel = np.sin(np.pi * f * tau[:, None]) / np.sqrt(
        tau[:, None] * rate * np.sin(np.pi * f / rate)
    )
    taken = (1 - term_gain(noise.low_pass, f, rate)) * kernel**4
    return 4 * noise.N.square * np.trapezoid(taken, f, axis=1)


def deviation_unit(sensor):
    """Return the unit of an Allan deviation: that of the bias instability in the tables."""
    return quantities(sensor)["B"].sheet[0]


def allan_pictures(device, session):
    """Return the Allan deviation of a session's accelerometer and gyroscope."""
    csv = write_csv(device.figures, f"{session.name}_allan", session.allan)
    name = f"{device.name}.{session.name}"
    each = (allan_picture(name, s, session.allan, device.axes, csv) for s in SENSORS)
    return [picture for picture in each if picture]


def allan_picture(name, sensor, allan, axes, csv=""):
    """Return the Allan deviation of a sensor as logged; None where there is none above 0.

    Takes the rows of allan.parquet, and an `AxisNoise` by channel.
    """
    curves = {c: curve(allan, c, "raw") for c in SENSORS[sensor]}
    if not any(len(r) for r in curves.values()):
        return None
    found = _finding(of_axes(axes, sensor), sensor)

    def plot(areas):
        ends = [r[c] for r in curves.values() for c in ("ci_low", "ci_high")]
        low = min(v[v > 0].min() for v in ends if (v > 0).any())
        high = max(np.nanmax(v) for v in ends if np.isfinite(v).any())
        for area, axis, colour, (channel, r) in zip(areas, XYZ, AXES, curves.items(), strict=True):
            draw_allan(area, r, axes[channel], sensor, colour, low)
            area.set_xlabel(f"{axis}: averaging time τ, s")
        # a term may lie far below the curve
        unit = deviation_unit(sensor)
        areas[0].set_ylim(unit.factor * low / 1.3, unit.factor * high * 1.3)
        areas[0].set_ylabel(f"Allan deviation, {unit.unit}")

    return Picture(
        f"{name}.allan_{sensor}",
        "Allan deviation",
        f"{name.rpartition('.')[2]}, {sensor}: {found}",
        plot,
        (1000, 280),
        csv,
        columns=(1, 1, 1),
    )


def _finding(axes, sensor):
    """Return white noise, bias instability and humps of the three axes in words."""
    parts = []
    for key, words in (("N", "white noise"), ("B", "bias instability")):
        unit = quantities(sensor)[key].sheet[0]
        found = [getattr(noise, key) for _, noise in axes]
        if any(c.size is not None for c in found):
            values = ", ".join(coefficient_text(c, unit.factor) for c in found)
            parts.append(f"{words} {values} {unit.unit} (x, y, z)")
    parts += [
        f"hump of a Gauss–Markov process, T = {number(p.tc.value)} s ({axis})"
        for axis, noise in axes
        for p in noise.gauss_markov
    ]
    parts += [
        f"hump of a line of {number(p.frequency.value)} Hz ({axis})"
        for axis, noise in axes
        for p in noise.sinusoid
    ]
    parts += [
        f"bends down below {number(1 / noise.low_pass.corner.value)} s, as a low-pass at "
        f"{number(noise.low_pass.corner.value)} Hz takes white noise ({axis})"
        for axis, noise in axes
        if noise.low_pass
    ]
    return "; ".join(parts) + "." if parts else "no noise model could be fitted."


def corrected_pictures(device, sensor):
    """Return the Allan deviation as logged and corrected, of each session that changed."""
    pictures = []
    for session in (s for s in device.used if len(s.allan)):
        curves = {
            axis: [curve(session.allan, channel, stage) for stage in ("raw", "corrected")]
            for axis, channel in zip(XYZ, SENSORS[sensor], strict=True)
        }
        if all(np.array_equal(raw["adev"], after["adev"]) for raw, after in curves.values()):
            continue

        def plot(area, curves=curves):
            unit = deviation_unit(sensor)
            for colour, (axis, (raw, after)) in zip(AXES, curves.items(), strict=True):
                tau = after["tau_s"]
                adev, low, high = (unit.factor * after[c] for c in ("adev", "ci_low", "ci_high"))
                area.loglog(tau, adev, color=colour, label=axis)
                fill(area, tau, low, high, colour)
                looks = {"color": colour, "ls": ":", "lw": 1.6}
                area.loglog(raw["tau_s"], unit.factor * raw["adev"], **looks)
            area.set_xlabel("averaging time τ, s")
            area.set_ylabel(f"Allan deviation, {unit.unit}")

        of_sensor = session.allan[session.allan["axis"].isin(SENSORS[sensor])]
        lowest = ", ".join(
            f"{axis} {' → '.join(number(rows['adev'].min(), 2) for rows in pair)}"
            for axis, pair in curves.items()
        )
        caption = (
            f"{session.name}, {sensor}: as logged (dotted) and corrected, lowest value {lowest} "
            f"{UNITS[sensor]}."
        )
        stem = f"{session.name}.allan_{sensor}_corrected"
        pictures.append(drawn(device, stem, "Allan deviation", caption, plot, of_sensor))
    return pictures
