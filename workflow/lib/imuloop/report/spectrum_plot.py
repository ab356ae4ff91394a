"""Power spectral density with the model over it, and autocorrelation, of a record at rest."""

import numpy as np

from imuloop.core.noise_model import AxisNoise
from imuloop.report.columns import rows
from imuloop.report.noise_units import quantities
from imuloop.report.numbers import coefficient_text, joined, number, percent, with_unit
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.svg import AXES, GRID, Picture, draw, write_csv

DENSITY_NOTE = (
    "How much power there is at each frequency (one-sided; Welch's estimate, band: its 95 % "
    "interval; dashed: the model, fitted to the record and not to this curve). Flat: white noise, "
    "at 2N². Rising to the left: flicker, −1, and random walk, −2; to the right: quantisation. "
    "Bend: a Gauss–Markov process. A ramp: in the lowest two or three points only. "
    "Triangle: a line of the model. Grey: frequencies that the fit leaves out."
)
CORRELATION_NOTE = (
    "How much a sample tells about the one that comes a lag later. Grey: where 95 % of the values "
    "of white noise would lie. Quantisation: −½ at the first lag; a slow fall: flicker, walk or a "
    "Gauss–Markov process; a wave: a line."
)
# departure of the measured density from the model that is worth a word: this factor of power, in
# so many neighbouring points, and so many standard deviations that hundreds of groups have none
DEPARTURE, NEIGHBOURS, SURE = 1.1, 10, 5.0


def density_pictures(device, session, folder):
    """Return the power spectral density of a session's accelerometer and gyroscope.

    Parameters
    ----------
    device : Device
        The device.
    session : Session
        A session; no picture where its views hold no density.
    folder : Path
        Where the CSV files go.
    """
    found = view(session, "psd")
    if not len(found["x"]):
        return []
    rate = device.noise.get("rate_hz") or session.quality["rate_hz"]
    found["model"] = np.full(len(found["x"]), np.nan)
    for channel, content in (device.noise.get("axes") or {}).items():
        at = found["axis"] == channel
        if at.any():
            noise, f = AxisNoise.from_dict(content), found["x"][at]
            found["model"][at] = noise.density(f, rate) + noise.R.square * _ramp(f)
    return _pictures(_density, device, session, folder, found, ("frequency_hz", "psd"))


def correlation_pictures(device, session, folder):
    """Return the autocorrelation of a session's accelerometer and gyroscope; as above."""
    found = view(session, "autocorrelation")
    found = rows(found, found["x"] > 0)
    if not len(found["x"]):
        return []
    return _pictures(_correlation, device, session, folder, found, ("lag_s", "autocorrelation"))


def view(session, name):
    """Return the rows of one view of a session, in order; none where it was not computed."""
    if session.views is None:
        return {c: np.empty(0) for c in ("view", "axis", "x", "value", "ci_low", "ci_high")}
    found = rows(
        session.views, (session.views["view"] == name) & np.isfinite(session.views["value"])
    )
    return rows(found, np.lexsort((found["x"], found["axis"].astype(str))))


def _pictures(picture, device, session, folder, found, names):
    """Return a picture of each sensor that has rows; `names` of x and value in the CSV file."""
    called = dict(zip(("x", "value"), names, strict=True))
    csv = write_csv(
        folder,
        f"{session.name}_{names[1]}",
        {called.get(name, name): values for name, values in found.items() if name != "view"},
    )
    return [
        picture(
            device,
            session,
            sensor,
            {a: rows(found, found["axis"] == c) for a, c in zip(XYZ, channels, strict=True)},
            csv,
        )
        for sensor, channels in SENSORS.items()
        if set(channels) & set(found["axis"])
    ]


def _ramp(frequency):
    r"""Return what a ramp of 1 SI/s adds to Welch's estimate, SI^2/Hz.

    Under a Hann window, in segments of T whose mean is off:
    :math:`T^3/(3 \pi^2 k^2 (k^2 - 1)^2)`, k = f T. The lowest frequency is the second of the
    longest segments; what shorter ones have of it is nothing beside that.
    """
    longest = 2 / frequency.min()
    k = frequency * longest
    return longest**3 / (3 * np.pi**2 * k**2 * (k**2 - 1) ** 2)


def _density(device, session, sensor, curves, csv):
    lines = _lines(device, sensor)
    band = _band(device, sensor)

    def plot(ax):
        handles = []
        for colour, (axis, r) in zip(AXES, curves.items(), strict=True):
            handles += ax.loglog(r["x"], r["value"], color=colour)
            ax.fill_between(r["x"], r["ci_low"], r["ci_high"], color=colour)
            if (r["model"] > 0).all():
                # the model is smooth: a few points draw it
                few = slice(None, None, len(r["x"]) // 60 + 1)
                ax.loglog(r["x"][few], r["model"][few], color=colour, ls="--", lw=1)
            for f in (f for f, a, _ in lines if a == axis):
                ax.flag(f, colour)
        highest = max(r["x"].max(initial=0.0) for r in curves.values())
        if band and band < 0.95 * highest:
            ax.axvspan(band, highest, color=GRID, alpha=0.35)
        ax.set_xlabel("frequency, Hz")
        ax.set_ylabel(f"power spectral density, ({UNITS[sensor]})²/Hz")
        ax.legend(handles, XYZ)

    departure = _departure(curves, band or np.inf)
    unit = quantities(sensor)["N"].sheet[0]
    axes = device.noise.get("axes") or {}
    white = [coefficient_text((axes.get(c) or {}).get("N"), unit.factor) for c in SENSORS[sensor]]
    named = [
        f"{with_unit(number(f), 'Hz')} ({axis}{f': {origin}' if origin else ''})"
        for f, axis, origin in lines
    ]
    caption = (
        f"{session.name}, {sensor}: N {', '.join(white)} {unit.unit} (x, y, z); "
        f"{'lines at ' + joined(named) + '; ' if named else ''}{departure}."
    )
    lowest = "; ".join(
        f"{axis} {r['value'][0]:.3g} at {r['x'][0]:.3g} Hz, "
        f"{r['value'][-1]:.3g} at {r['x'][-1]:.3g} Hz"
        for axis, r in curves.items()
        if len(r["x"])
    )
    name = f"{device.name}.{session.name}.psd_{sensor}"
    alt = (
        f"Power spectral density in ({UNITS[sensor]})²/Hz, {sensor}, session {session.name}: "
        f"{lowest}; {departure}"
    )
    svg = draw(name, alt, 440, 300, plot)
    return Picture(name, svg, caption, DENSITY_NOTE, (csv,))


def _lines(device, sensor):
    """Return frequency, axis and origin of each line of the model."""
    axes = device.noise.get("axes") or {}
    return [
        (line["frequency"]["value"], axis, line.get("origin"))
        for axis, channel in zip(XYZ, SENSORS[sensor], strict=True)
        for line in (axes.get(channel) or {}).get("sinusoid") or []
        if line["frequency"].get("value")
    ]


def _band(device, sensor):
    """Return the highest frequency that the fit of any axis used, None where not told."""
    spectrum = device.noise.get("spectrum") or {}
    bands = [(spectrum.get(c) or {}).get("band_hz") for c in SENSORS[sensor]]
    return max((b for b in bands if b), default=None)


def _departure(curves, highest):
    """Return where the measured density leaves the model most, as far as chance lets one tell."""
    known = {axis: rows(r, (r["model"] > 0) & (r["x"] <= highest)) for axis, r in curves.items()}
    if not any((r["model"] > 0).any() for r in curves.values()):
        return "no model to compare it with"
    worst = (
        np.log(DEPARTURE),
        f"the record keeps within {percent(DEPARTURE - 1)} of the model, chance left aside",
    )
    for axis, r in known.items():
        x, value, low, high, model = (r[c] for c in ("x", "value", "ci_low", "ci_high", "model"))
        # neighbours together: of hundreds of points some leave their intervals by chance
        first = np.arange(0, len(x), NEIGHBOURS)
        if not len(first):
            continue
        # weights from the variance of the estimate over the truth, by the width of the interval
        weight = (3.92 / np.log(high / low)) ** 2
        total = np.add.reduceat(weight, first)
        ratio = np.add.reduceat(weight * value / model, first) / total
        size = np.abs(np.log(ratio)) * (np.abs(ratio - 1) * np.sqrt(total) > SURE)
        k = int(size.argmax())
        if size[k] > worst[0]:
            last = min(first[k] + NEIGHBOURS, len(x)) - 1
            ends = f"{number(x[first[k]])} to {number(x[last])}"
            worst = (
                size[k],
                f"the record leaves the model most at {with_unit(ends, 'Hz')} ({axis}), with "
                f"{number(ratio[k], 2)} times its power",
            )
    return worst[1]


def _correlation(device, session, sensor, curves, csv):
    known = {axis: r for axis, r in curves.items() if len(r["x"])}
    # that of white noise depends on the number of samples only
    band = next(iter(known.values()))

    def plot(ax):
        ax.axhline(0)
        ax.fill_between(*(band[c] for c in ("x", "ci_low", "ci_high")), color=GRID, alpha=0.6)
        for colour, r in zip(AXES, curves.values(), strict=True):
            ax.semilogx(r["x"], r["value"], color=colour)
        ax.set_xlabel("lag, s")
        ax.set_ylabel("autocorrelation, 1")
        ax.legend(ax.lines, XYZ)

    first = ", ".join(number(r["value"][0], 2) for r in known.values())
    lag = band["x"][0]
    farthest = {axis: _farthest(r) for axis, r in known.items()}
    axis = max(farthest, key=farthest.get)
    reach = (
        f"beyond chance up to {with_unit(number(farthest[axis]), 's')} ({axis})"
        if farthest[axis]
        else "no lag beyond chance"
    )
    caption = (
        f"{session.name}, {sensor}: {first} from a sample to that {with_unit(number(lag), 's')} "
        f"later ({', '.join(known)}); {reach}."
    )
    name = f"{device.name}.{session.name}.autocorrelation_{sensor}"
    svg = draw(name, f"Autocorrelation, {caption}", 440, 300, plot)
    return Picture(name, svg, caption, CORRELATION_NOTE, (csv,))


def _farthest(curve):
    """Return the lag up to which every value leaves the band of white noise, 0 without any."""
    inside = (curve["ci_low"] <= curve["value"]) & (curve["value"] <= curve["ci_high"])
    count = int(inside.argmax()) if inside.any() else len(inside)
    return curve["x"][count - 1] if count else 0.0
