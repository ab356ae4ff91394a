"""Allan deviation with the fitted model, as logged and corrected."""

import numpy as np

from imuloop.core.noise_model import AxisNoise
from imuloop.noise.gains import term_gain
from imuloop.report.figures.drawing import AXES, INK, Picture, fill
from imuloop.report.numbers import number
from imuloop.report.page import phrase
from imuloop.report.results import SENSORS, UNITS, XYZ, of_axes
from imuloop.report.units import QUANTITIES

# the letter of each term of a model
TERMS = {k: k for k in "QNBKR"} | {"gauss_markov": "GM", "sinusoid": "line"}
# terms whose values stand next to their letters
VALUED = "NBK"


def curve(allan, channel, stage="corrected"):
    """Return the Allan curve of a channel: its rows of allan.parquet, sorted by averaging time.

    `allan` has all rows of allan.parquet, a DataFrame, and `channel` is ``ax`` to ``gz``. `stage`
    is ``raw`` for samples as logged, or ``corrected`` for samples without the effects. If this
    stage has no rows, the rows of the stage ``raw`` are returned.
    """
    rows = allan[(allan["axis"] == channel) & (allan["adev"] > 0)]
    chosen = rows[rows["stage"] == stage]
    return (chosen if len(chosen) else rows[rows["stage"] == "raw"]).sort_values("tau_s")


def longest_curve_first(sessions):
    """Return those of the SessionResults `sessions` that have an Allan curve, a list.

    The session whose curve has the longest averaging time comes first.
    """
    return sorted((s for s in sessions if len(s.allan)), key=lambda s: -s.allan["tau_s"].max())


def draw_curve(area, rows, unit, **looks):
    """Draw an Allan curve with its 95 % band on the matplotlib Axes `area`.

    `rows` is the result of `curve`, `unit` is the Display of the values, the unit to show, and
    `looks` are the arguments of matplotlib for the line.
    """
    tau, ends = rows["tau_s"], (unit.factor * rows[end] for end in ("ci_low", "ci_high"))
    area.loglog(tau, unit.factor * rows["adev"], **looks)
    fill(area, tau, *ends, looks["color"])


def draw_model(area, tau, noise, sensor, lowest):
    """Draw the Allan deviation of a noise model, and of each of its terms, on the Axes `area`.

    `noise` is the AxisNoise, the model of one channel, `tau` are averaging times in rising order,
    s, (k,), and `sensor` is the name of the sensor. The letter of a term stands where the term is
    largest above the value `lowest`, SI, and nowhere if it is not above it. The letters N, B and K
    are followed by their values.
    """
    factor = QUANTITIES[sensor]["B"].factor
    grid = np.geomspace(tau[0], tau[-1], 30) if len(tau) else tau
    model = noise.allan_variance(grid) - (taken_by_filter(noise, grid) if len(tau) else 0.0)
    if not len(tau) or not (model > 0).all():
        return
    area.loglog(grid, factor * np.sqrt(model), color=INK, ls="--", lw=1.2, label="model")
    for term, letter in TERMS.items():
        values = np.sqrt(AxisNoise(**{term: getattr(noise, term)}).allan_variance(grid))
        if not values.any():
            continue
        area.loglog(grid, factor * values, color=INK, ls=":", lw=1, label="its terms")
        above = np.flatnonzero(values > lowest)
        if not len(above):
            continue
        at = above[values[above].argmax()]
        if term in VALUED:
            letter += f" {QUANTITIES[sensor][term].size(getattr(noise, term).size)}"
            area.plot(grid[at], factor * values[at], "o", color=INK, ms=4)
        side = "left" if at < len(grid) / 2 else "right"
        area.text(grid[at], factor * values[at], letter, ha=side, va="bottom")


def taken_by_filter(noise, tau):
    r"""Return the part of the Allan variance of white noise that a low-pass filter removes, (k,).

    .. math:: \int_0^{r/2} 4 N^2 [1 - G(f)] \frac{\sin^4 \pi f \tau}{(\tau r \sin \pi f/r)^2} df

    G(f) is the power gain of the filter at the frequency f, N the white noise, r the sampling rate.
    `noise` is the AxisNoise of a channel, which has N and the filter, and `tau` are the k averaging
    times τ, s, (k,); the first is the sampling interval 1/r. The result is in SI units squared, and
    zero without a filter.
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


def allan_pictures(device, session):
    """Return the Pictures of the Allan deviation in a session, one for each sensor, a list.

    `device` is a DeviceResults, and `session` one of its SessionResults.
    """
    name = f"{device.name}.{session.name}"
    pictures = (
        allan_picture(name, session.name, sensor, session.allan, device.axes) for sensor in SENSORS
    )
    return [picture for picture in pictures if picture]


def allan_picture(name, session, sensor, allan, axes):
    """Return the Picture of a sensor's Allan deviation as logged; None if no value is above zero.

    `name` is the first part of the name of the Picture, `session` the name of the session, and
    `sensor` the name of the sensor. `allan` are the rows of allan.parquet of the session, a
    DataFrame. `axes` is the noise model, a dict of AxisNoise by channel.
    """
    curves = {c: curve(allan, c, "raw") for c in SENSORS[sensor]}
    if not any(len(r) for r in curves.values()):
        return None
    unit = QUANTITIES[sensor]["B"]

    def plot(areas):
        """Draw the measured curve, the model and its terms; `areas` are the Axes of x, y and z."""
        ends = [r[c] for r in curves.values() for c in ("ci_low", "ci_high")]
        low = min(v[v > 0].min() for v in ends if (v > 0).any())
        high = max(np.nanmax(v) for v in ends if np.isfinite(v).any())
        for area, axis, colour, (channel, r) in zip(areas, XYZ, AXES, curves.items(), strict=True):
            draw_curve(area, r, unit, color=colour, lw=1.6, label="measured, 95 % band")
            draw_model(area, r["tau_s"].to_numpy(), axes[channel], sensor, low)
            area.set_xlabel(f"{axis}: averaging time τ, s")
        # a term may lie far below the curve: its part there is not shown
        areas[0].set_ylim(unit.factor * low / 1.3, unit.factor * high * 1.3)
        areas[0].set_ylabel(f"Allan deviation, {unit.unit}")

    return Picture(
        f"{name}.allan_{sensor}",
        "Allan deviation",
        phrase("allan", session=session, sensor=sensor, axes=of_axes(axes, sensor)),
        plot,
        allan,
        size=(1000, 280),
        columns=(1, 1, 1),
        file=f"{session}_allan",
    )


def corrected_pictures(device, block):
    """Return the Pictures of the Allan deviation before and after effects are corrected, a list.

    There is one for each session whose Allan deviation the added effects changed. The list is empty
    if the diagnosis is not of static records. `device` is a DeviceResults, and `block` the
    diagnosis of a sensor, as `block_of` returns it.
    """
    if block["part"] != "static_record" or not block["effects"]:
        return []
    sensor, pictures = block["sensor"], []
    unit = QUANTITIES[sensor]["B"]
    for session in (s for s in device.used if len(s.allan)):
        curves = {
            axis: [curve(session.allan, channel, stage) for stage in ("raw", "corrected")]
            for axis, channel in zip(XYZ, SENSORS[sensor], strict=True)
        }
        if all(np.array_equal(raw["adev"], after["adev"]) for raw, after in curves.values()):
            continue

        def plot(area, curves=curves):
            """Draw the curves of three axes, as logged and corrected, on the Axes `area`.

            `curves` has for each axis the two curves, results of `curve`.
            """
            for colour, (axis, (raw, after)) in zip(AXES, curves.items(), strict=True):
                draw_curve(area, after, unit, color=colour, label=axis)
                area.loglog(raw["tau_s"], unit.factor * raw["adev"], color=colour, ls=":", lw=1.6)
            area.set_xlabel("averaging time τ, s")
            area.set_ylabel(f"Allan deviation, {unit.unit}")

        lowest = ", ".join(
            f"{axis} {' → '.join(number(rows['adev'].min(), 2) for rows in pair)}"
            for axis, pair in curves.items()
        )
        caption = (
            f"{session.name}, {sensor}: lowest Allan deviation, as logged (dotted) → corrected: "
            f"{lowest} {UNITS[sensor]}."
        )
        name = f"{device.name}.{session.name}.allan_{sensor}_corrected"
        numbers = session.allan[session.allan["axis"].isin(SENSORS[sensor])]
        pictures.append(Picture(name, "Allan deviation", caption, plot, numbers))
    return pictures
