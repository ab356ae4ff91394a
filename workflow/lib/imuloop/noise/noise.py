"""Noise of a device: coefficients, spectra and summary figures."""

from dataclasses import dataclass, field, fields, replace
from itertools import product

import numpy as np

from imuloop.core.files import write_json
from imuloop.core.noise_model import AxisNoise, NoiseModel
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.tables import joined
from imuloop.noise.axis import AxisEstimate, estimate_axis
from imuloop.noise.modes import modes
from imuloop.noise.records import closed_up, records_by_sensor
from imuloop.noise.spectrum import no_spectrum, spectrum_table
from imuloop.noise.statistics import repeatability, summary


@dataclass(frozen=True)
class NoiseResult:
    """Result of the noise stage.

    Attributes
    ----------
    model : NoiseModel
        Coefficients of the six axes.
    rate_hz : float or None
        Sampling rate of the sessions used, Hz; of two clocks that of the faster.
    rates_hz : dict of str to float
        That of each sensor that has a record.
    spectrum : dict of str to dict
        For each axis ``misfit`` of its `AxisEstimate`.
    repeatability, statistics : dict
        See `statistics.repeatability`; for each session used and each axis `statistics.summary`.
    sessions, notes : tuple of str
        Sessions behind the coefficients; what a reader of the coefficients must know.
    spectra : dict of str to dict of ndarray
        For each session given the columns of spectra.parquet; without rows where the session was
        not used.
    """

    model: NoiseModel
    rate_hz: float | None = None
    rates_hz: dict = field(default_factory=dict)
    spectrum: dict = field(default_factory=dict)
    repeatability: dict | None = None
    statistics: dict = field(default_factory=dict)
    sessions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    spectra: dict = field(default_factory=dict)

    def to_dict(self):
        """Return the content of noise.json."""
        others = {f.name: getattr(self, f.name) for f in fields(self)[1:-1]}
        return self.model.to_dict() | others

    def to_json(self, path):
        """Write noise.json."""
        write_json(path, self.to_dict())


def no_noise(device, sessions, *notes):
    """Return an empty NoiseResult of a device and its sessions, with the reason."""
    return NoiseResult(
        model=NoiseModel(device, dict.fromkeys(CHANNELS, AxisNoise())),
        notes=notes,
        spectra={name: no_spectrum() for name in sessions},
    )


def estimate_noise(device, sessions, settings, views=True):
    """Return the NoiseResult of a device's static sessions, else of all its rests.

    One estimate from all clean stretches of all sessions used; no term is identifiable where there
    is nothing to fit.

    Takes the device's name, all its Sessions, of which the static ones count or, where none of them
    holds a rest, the rests of all others, NoiseSettings, and whether spectra are wanted too.
    """
    notes = []
    by_sensor = records_by_sensor(sessions, notes)
    nothing = no_noise(device, [session.name for session in sessions])
    if not by_sensor:
        notes.append("no session holds a rest: no coefficient can be estimated")
        return replace(nothing, notes=tuple(notes))
    static = next(iter(by_sensor.values()))[0].session.static
    rates = {
        s: float(np.average([r.rate for r in own], weights=[r.lengths.sum() for r in own]))
        for s, own in by_sensor.items()
    }
    # sensors of one clock share their records
    each = {id(records): records for records in by_sensor.values()}
    bases = {key: modes([s for r in own for s in r.samplings]) for key, own in each.items()}
    found = {
        axis: _estimate(axis, records, bases[id(records)], settings, notes)
        for sensor, records in by_sensor.items()
        for axis in SENSORS[sensor]
    }
    axes = {axis: estimate.noise for axis, estimate in found.items()}
    if unseen := [axis for axis, noise in axes.items() if not noise.K.identifiable]:
        # the walk weighs most in long integrals
        longest = max(r.lengths.max() / rates[s] for s, own in by_sensor.items() for r in own)
        notes.append(
            f"random walk not supported by clean stretches of up to {longest:.4g} s: "
            f"{', '.join(unseen)}; it shows once the record is many times sqrt(3) N/K, so K has "
            "an upper limit only"
        )
    names = dict.fromkeys(record.session.name for own in by_sensor.values() for record in own)
    statistics = {name: {} for name in names}
    spectra = {name: [each] for name, each in nothing.spectra.items()}
    for sensor, records in by_sensor.items():
        for axis, record in product(SENSORS[sensor], records):
            # a few missing samples are taken for none
            name, x = record.session.name, closed_up(record.signals(axis))
            # attitude, and gravity with it, changes from rest to rest: the longest speaks alone
            statistics[name][axis] = summary(x if static else [max(x, key=len)], record.rate)
            if views and np.isfinite(statistics[name][axis]["mean"]):
                spectra[name].append(spectrum_table(axis, x, record.rate))
            # or two axes would be in memory at once
            x = None
    means = {n: {a: f["mean"] for a, f in s.items()} for n, s in statistics.items()}
    return NoiseResult(
        model=NoiseModel(device, nothing.model.axes | axes),
        rate_hz=max(rates.values()),
        rates_hz=rates,
        spectrum={a: {"misfit": e.misfit} for a, e in found.items()},
        repeatability=repeatability(means if static else {}),
        statistics=statistics,
        sessions=tuple(statistics),
        notes=tuple(notes),
        spectra={name: joined(parts) for name, parts in spectra.items()},
    )


def _estimate(axis, records, basis, settings, notes):
    signals = [signal for record in records for signal in record.signals(axis)]
    nothing = AxisEstimate(AxisNoise(), 0.0)
    if not all(np.isfinite(signal.values).all() for signal in signals):
        notes.append(f"{axis}: values that are not finite, no coefficient estimated")
        return nothing
    if all(signal.is_constant() for signal in signals):
        notes.append(f"{axis}: output is constant, no coefficient estimated")
        return nothing
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
    if low_pass.interval_hz:
        return f"values are {low_pass.kind}, as of a sensor of {low_pass.interval_hz:.3g} Hz"
    return (
        f"low-pass near {low_pass.corner.value:.3g} Hz ({low_pass.kind}): N, B and K are those of "
        "the noise in front of it"
    )
