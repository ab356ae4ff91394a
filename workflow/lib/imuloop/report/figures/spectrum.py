"""Power spectral density of a record at rest, with the model over it."""

import numpy as np

from imuloop.noise.gains import density
from imuloop.report.figures.drawing import AXES, Picture, fill
from imuloop.report.page import phrase
from imuloop.report.results import SENSORS, UNITS, XYZ, of_axes


def density_pictures(device, session):
    """Return the Pictures of the power spectral density in a session, a list: one for each sensor.

    A sensor without a spectrum has none. `device` is a DeviceResults, and `session` one of its
    SessionResults.
    """
    spectra = session.spectra[np.isfinite(session.spectra["psd"])].astype({"axis": str})
    spectra = spectra.sort_values(["axis", "frequency_hz"], kind="stable").assign(model=np.nan)
    pictures = []
    for sensor, channels in SENSORS.items():
        rate = device.noise["rates_hz"].get(sensor) or session.quality["rate_hz"]
        for channel in channels:
            rows, noise = spectra["axis"] == channel, device.axes[channel]
            if rows.any():
                f = spectra["frequency_hz"][rows].to_numpy()
                spectra.loc[rows, "model"] = density(noise, f, rate) + noise.R.square * _ramp(f)
    for sensor, channels in SENSORS.items():
        curves = {a: spectra[spectra["axis"] == c] for a, c in zip(XYZ, channels, strict=True)}
        if any(map(len, curves.values())):
            pictures.append(_picture(device, session, sensor, curves, spectra))
    return pictures


def _ramp(frequency):
    r"""Return the density that a ramp of 1 SI unit per s adds to Welch's estimate, SI²/Hz, (n,).

    The estimate has segments of the length T less their mean, under a Hann window. The density is
    :math:`T^3/(3 \pi^2 k^2 (k^2 - 1)^2)` with k = f T. `frequency` are n frequencies f, Hz, (n,);
    the lowest is 2/T.
    """
    segment = 2 / frequency.min()
    k = frequency * segment
    return segment**3 / (3 * np.pi**2 * k**2 * (k**2 - 1) ** 2)


def _picture(device, session, sensor, curves, spectra):
    """Return the Picture of the power spectral density of one sensor in a session.

    `device` is a DeviceResults, `session` one of its SessionResults, and `sensor` the name of the
    sensor. `spectra` is the table of all channels of the session, a DataFrame, and `curves` has its
    rows by axis, x, y, z.
    """
    axes = of_axes(device.axes, sensor)
    lines = [(line.frequency.value, axis) for axis, noise in axes for line in noise.sinusoid]
    corners = [(noise.low_pass.corner.value, axis) for axis, noise in axes if noise.low_pass]

    def plot(area):
        """Draw the spectrum, model, lines and low-pass corner of each axis on the Axes `area`."""
        for colour, (axis, r) in zip(AXES, curves.items(), strict=True):
            area.loglog(r["frequency_hz"], r["psd"], color=colour, label=axis)
            fill(area, r["frequency_hz"], r["ci_low"], r["ci_high"], colour)
            if (r["model"] > 0).all():
                area.loglog(r["frequency_hz"], r["model"], color=colour, ls="--", lw=1)
            at, on_top = [f for f, a in lines if f and a == axis], area.get_xaxis_transform()
            area.plot(at, [0.98] * len(at), "v", color=colour, transform=on_top)
        for corner, axis in corners:
            area.axvline(corner, color=AXES[XYZ.index(axis)], lw=1, alpha=0.6)
        area.set_xlabel("frequency, Hz")
        area.set_ylabel(f"power spectral density, ({UNITS[sensor]})²/Hz")

    caption = phrase("density", session=session.name, sensor=sensor, axes=axes)
    name = f"{device.name}.{session.name}.psd_{sensor}"
    file = f"{session.name}_psd"
    return Picture(name, "Power spectral density", caption, plot, spectra, file=file)
