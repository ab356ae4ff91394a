"""Power spectral density of a record at rest, with the model over it."""

import numpy as np

from imuloop.core.errors import joined
from imuloop.noise.gains import density
from imuloop.report.figures.drawing import AXES, Picture, fill, write_csv
from imuloop.report.numbers import coefficient_text, number, with_unit
from imuloop.report.results import SENSORS, UNITS, XYZ, of_axes
from imuloop.report.units import quantities


def density_pictures(device, session):
    """Return the power spectral density of a session's accelerometer and gyroscope."""
    found = session.spectra[np.isfinite(session.spectra["psd"])].astype({"axis": str})
    if found.empty:
        return []
    found = found.sort_values(["axis", "frequency_hz"], kind="stable").assign(model=np.nan)
    for sensor, channel in ((s, axis) for s, axes in SENSORS.items() for axis in axes):
        at, noise = found["axis"] == channel, device.axes[channel]
        if at.any():
            rate = device.noise["rates_hz"].get(sensor) or session.quality["rate_hz"]
            f = found["frequency_hz"][at].to_numpy()
            found.loc[at, "model"] = density(noise, f, rate) + noise.R.square * _ramp(f)
    csv = write_csv(device.figures, f"{session.name}_psd", found)
    by_sensor = {
        sensor: {a: found[found["axis"] == c] for a, c in zip(XYZ, channels, strict=True)}
        for sensor, channels in SENSORS.items()
    }
    return [
        _density(device, session, sensor, curves, csv)
        for sensor, curves in by_sensor.items()
        if any(map(len, curves.values()))
    ]


def _ramp(frequency):
    r"""Return what a ramp of 1 SI/s adds to Welch's estimate at frequencies in Hz, SI^2/Hz.

    Under a Hann window, in segments of T without their mean, it is
    :math:`T^3/(3 \pi^2 k^2 (k^2 - 1)^2)`, k = f T. The lowest frequency is 2/T.
    """
    segment = 2 / frequency.min()
    k = frequency * segment
    return segment**3 / (3 * np.pi**2 * k**2 * (k**2 - 1) ** 2)


def _density(device, session, sensor, curves, csv):
    axes = of_axes(device.axes, sensor)
    lines = [
        (line.frequency.value, axis, line.origin)
        for axis, noise in axes
        for line in noise.sinusoid
        if line.frequency.value
    ]
    corners = [(noise.low_pass.corner.value, axis) for axis, noise in axes if noise.low_pass]

    def plot(area):
        for colour, (axis, r) in zip(AXES, curves.items(), strict=True):
            area.loglog(r["frequency_hz"], r["psd"], color=colour, label=axis)
            fill(area, r["frequency_hz"], r["ci_low"], r["ci_high"], colour)
            if (r["model"] > 0).all():
                area.loglog(r["frequency_hz"], r["model"], color=colour, ls="--", lw=1)
            at = [f for f, a, _ in lines if a == axis]
            on_top = area.get_xaxis_transform()
            area.plot(at, [0.98] * len(at), "v", color=colour, transform=on_top)
        for corner, axis in corners:
            area.axvline(corner, color=AXES[XYZ.index(axis)], lw=1, alpha=0.6)
        area.set_xlabel("frequency, Hz")
        area.set_ylabel(f"power spectral density, ({UNITS[sensor]})²/Hz")

    unit = quantities(sensor)["N"].sheet[0]
    white = ", ".join(coefficient_text(noise.N, unit.factor) for _, noise in axes)
    named = [
        f"{with_unit(number(f), 'Hz')} ({axis}{f': {origin}' if origin else ''})"
        for f, axis, origin in lines
    ]
    lines_at = f"; lines at {joined(named)}" if named else ""
    low_pass = [with_unit(number(corner), "Hz") + f" ({axis})" for corner, axis in corners]
    filtered = f"; low-pass at {joined(low_pass)}" if low_pass else ""
    caption = f"{session.name}, {sensor}: N {white} {unit.unit} (x, y, z){filtered}{lines_at}."
    name = f"{device.name}.{session.name}.psd_{sensor}"
    return Picture(name, "Power spectral density", caption, plot, csv=csv)
