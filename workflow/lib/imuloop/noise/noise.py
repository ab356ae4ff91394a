"""Noise of a device: coefficients, spectra and summary figures."""

from dataclasses import dataclass, field, fields

import numpy as np

from imuloop.core.files import write_json
from imuloop.core.noise_model import AxisNoise, NoiseModel
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.tables import joined
from imuloop.noise.axis import AxisEstimate, estimate_axis
from imuloop.noise.modes import modes
from imuloop.noise.records import records_by_sensor
from imuloop.noise.spectrum import no_spectrum, spectrum_table
from imuloop.noise.statistics import summary


@dataclass(frozen=True)
class NoiseResult:
    """Result of the noise stage."""

    model: NoiseModel  # coefficients of the six axes
    rate_hz: float | None = None  # sampling rate of the sessions used; of two clocks, the faster
    rates_hz: dict = field(default_factory=dict)  # sampling rate of each sensor with a record
    spectrum: dict = field(default_factory=dict)  # `misfit` of the AxisEstimate, by axis
    statistics: dict = field(default_factory=dict)  # `statistics.summary` by session and axis
    sessions: tuple[str, ...] = ()  # sessions behind the coefficients
    notes: tuple[str, ...] = ()  # what a reader of the coefficients must know
    # columns of spectra.parquet by session; without rows where the session was not used
    spectra: dict = field(default_factory=dict)

    def to_dict(self):
        """Return the content of noise.json."""
        others = {f.name: getattr(self, f.name) for f in fields(self)[1:-1]}
        return self.model.to_dict() | others

    def to_json(self, path):
        """Write noise.json."""
        write_json(path, self.to_dict())


def no_noise(device, sessions, *notes):
    """Return an empty NoiseResult of a device and its sessions, by name, with the reason."""
    return NoiseResult(
        model=NoiseModel(device, dict.fromkeys(CHANNELS, AxisNoise())),
        notes=notes,
        spectra={name: no_spectrum() for name in sessions},
    )


def estimate_noise(device, sessions, settings, views=True):
    """Return the NoiseResult of a device.

    There is one estimate from all clean stretches of all static sessions or, where none of these
    holds a rest, from the rests of all other sessions. No term is identifiable where there is
    nothing to fit.

    Parameters
    ----------
    device : str
        Name of the device.
    sessions : list of RecordedSession
        All sessions of the device.
    settings : NoiseSettings
    views : bool
        Whether spectra are wanted too.
    """
    notes, names = [], [session.name for session in sessions]
    by_sensor = records_by_sensor(sessions, notes)
    if not by_sensor:
        reason = "no session holds a rest: no coefficient can be estimated"
        return no_noise(device, names, *notes, reason)
    estimates, rates, statistics = {}, {}, {}
    spectra = {name: [no_spectrum()] for name in names}
    for sensors, records in by_sensor:
        basis = modes([sampling for record in records for sampling in record.samplings])
        rate = np.average([r.rate for r in records], weights=[r.lengths.sum() for r in records])
        rates |= dict.fromkeys(sensors, float(rate))
        for axis in (axis for sensor in sensors for axis in SENSORS[sensor]):
            estimates[axis] = _estimate(axis, records, basis, settings, notes)
            for record in records:
                name, x = record.session.name, record.stretches(axis)
                # attitude, and gravity with it, changes between rests: only the longest counts
                counted = x if record.session.static else [max(x, key=len)]
                figures = summary(counted, record.rate)
                statistics.setdefault(name, {})[axis] = figures
                if views and np.isfinite(figures["mean"]):
                    spectra[name].append(spectrum_table(axis, x, record.rate))
                # two axes at once would need twice the memory
                del x, counted
    if unseen := [axis for axis, found in estimates.items() if not found.noise.K.identifiable]:
        # the walk weighs most in long integrals
        longest = max(r.lengths.max() / r.rate for _, records in by_sensor for r in records)
        notes.append(
            f"random walk not supported by clean stretches of up to {longest:.4g} s: "
            f"{', '.join(unseen)}; it shows once the record is many times sqrt(3) N/K, so K has "
            "an upper limit only"
        )
    axes = {axis: found.noise for axis, found in estimates.items()}
    return NoiseResult(
        model=NoiseModel(device, dict.fromkeys(CHANNELS, AxisNoise()) | axes),
        rate_hz=max(rates.values()),
        rates_hz=rates,
        spectrum={axis: {"misfit": found.misfit} for axis, found in estimates.items()},
        statistics=statistics,
        sessions=tuple(statistics),
        notes=tuple(notes),
        spectra={name: joined(parts) for name, parts in spectra.items()},
    )


def _estimate(axis, records, basis, settings, notes):
    """Return the AxisEstimate of an axis from its Records and their Modes; adds to `notes`."""
    signals = [signal for record in records for signal in record.signals(axis)]
    if not all(np.isfinite(signal.values).all() for signal in signals):
        notes.append(f"{axis}: values that are not finite, no coefficient estimated")
        return AxisEstimate()
    if all(signal.is_constant() for signal in signals):
        notes.append(f"{axis}: output is constant, no coefficient estimated")
        return AxisEstimate()
    estimate = estimate_axis(basis, signals, settings)
    if not any(getattr(estimate.noise, name).upper95 for name in "QNBKR"):
        notes.append(f"{axis}: too few samples for a coefficient")
    if estimate.misfit:
        notes.append(
            f"{axis}: over half a decade the spectrum leaves the terms by "
            f"{100 * estimate.misfit:.2g} % beyond chance (a filter, a hump, a trend): "
            "intervals are widened by it"
        )
    if low_pass := estimate.noise.low_pass:
        notes.append(f"{axis}: {_filter_note(low_pass)}")
    return estimate


def _filter_note(low_pass):
    """Return what a reader must know of a LowPassTerm, a text."""
    if low_pass.interval_hz:
        return f"values are {low_pass.kind}, as of a sensor of {low_pass.interval_hz:.3g} Hz"
    return (
        f"low-pass near {low_pass.corner.value:.3g} Hz ({low_pass.kind}): N, B and K are those of "
        "the noise in front of it"
    )
