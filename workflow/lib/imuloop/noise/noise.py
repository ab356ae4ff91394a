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

# durations of the means in `summary`, s
MEANS = {"std_10s": 10.0, "std_100s": 100.0}


@dataclass(frozen=True)
class NoiseResult:
    """Result of the noise stage: the content of noise.json and of spectra.parquet."""

    model: NoiseModel  # coefficients of the six axes
    rate_hz: float | None = None  # sampling rate of the sessions used; of two clocks, the faster
    rates_hz: dict = field(default_factory=dict)  # sampling rate of each sensor with a record
    spectrum: dict = field(default_factory=dict)  # `misfit` of the AxisEstimate, by axis
    statistics: dict = field(default_factory=dict)  # `summary` by session and axis
    sessions: tuple[str, ...] = ()  # sessions behind the coefficients
    notes: tuple[str, ...] = ()  # limits of the coefficients, for their reader
    # columns of spectra.parquet by session; without rows where the session was not used
    spectra: dict = field(default_factory=dict)

    def to_dict(self):
        """Return the content of noise.json, a dict."""
        others = {f.name: getattr(self, f.name) for f in fields(self)[1:-1]}
        return self.model.to_dict() | others

    def to_json(self, path):
        """Write the content of noise.json as a JSON file at `path`."""
        write_json(path, self.to_dict())


def estimate_noise(device, sessions, settings, views=True):
    """Return the NoiseResult of a device: noise coefficients, spectra and summary figures.

    A session is static if the device lies still in it; in other sessions the device is moved
    between rests. An axis has one estimate from all static sessions, without their disturbances and
    gaps. If no static session has a rest, the estimate comes from the rests of all other sessions.
    If there is no rest at all, no coefficient is estimated.

    Parameters
    ----------
    device : str
        Name of the device.
    sessions : list of RecordedSession
        All sessions of the device.
    settings : NoiseSettings
        Significance level of all tests.
    views : bool
        Whether the result has spectra, too.
    """
    notes, estimates, rates, statistics, longest = [], {}, {}, {}, 0.0
    spectra = {session.name: [no_spectrum()] for session in sessions}
    for sensors, records in records_by_sensor(sessions, notes):
        basis = modes([cycle for record in records for cycle in record.cycles])
        rates |= dict.fromkeys(sensors, 1 / float(basis.dt))
        longest = max(longest, *(r.lengths.max() / r.rate for r in records))
        for axis in (axis for sensor in sensors for axis in SENSORS[sensor]):
            estimates[axis] = _estimate(axis, records, basis, settings, notes)
            for record in records:
                name, x = record.session.name, record.stretches(axis)
                # attitude, and gravity with it, changes between rests: only the longest counts
                figures = summary(x if record.session.static else [max(x, key=len)], record.rate)
                statistics.setdefault(name, {})[axis] = figures
                if views and np.isfinite(figures["mean"]):
                    spectra[name].append(spectrum_table(axis, x, record.rate))
                # two axes at once would need twice the memory
                del x
    if not estimates:
        notes.append("no session holds a rest: no coefficient can be estimated")
    if unseen := [axis for axis, e in estimates.items() if not e.noise.K.identifiable]:
        # the walk weighs most in long integrals
        notes.append(
            f"random walk not supported by clean stretches of up to {longest:.4g} s: "
            f"{', '.join(unseen)}; it shows once the record is many times sqrt(3) N/K, so K has "
            "an upper limit only"
        )
    axes = {axis: estimate.noise for axis, estimate in estimates.items()}
    return NoiseResult(
        model=NoiseModel(device, dict.fromkeys(CHANNELS, AxisNoise()) | axes),
        rate_hz=max(rates.values(), default=None),
        rates_hz=rates,
        spectrum={axis: {"misfit": estimate.misfit} for axis, estimate in estimates.items()},
        statistics=statistics,
        sessions=tuple(statistics),
        notes=tuple(notes),
        spectra={name: joined(parts) for name, parts in spectra.items()},
    )


def _estimate(axis, records, basis, settings, notes):
    """Return the AxisEstimate of one axis, and add remarks for the user to the list `notes`.

    `axis` is the name of the axis, and `records` a list of Records with its output. `basis` are the
    Modes of all power cycles, the basis in which their noise is described. `settings` are
    NoiseSettings. The AxisEstimate has no coefficients if the output is constant or has a value
    that is not finite.
    """
    signals = [signal for record in records for signal in record.signals(axis)]
    finite = all(np.isfinite(signal.values).all() for signal in signals)
    if not finite or all(signal.is_constant() for signal in signals):
        reason = "output is constant" if finite else "values that are not finite"
        notes.append(f"{axis}: {reason}, no coefficient estimated")
        return AxisEstimate()
    estimate = estimate_axis(basis, signals, settings)
    if not any(getattr(estimate.noise, name).upper95 for name in "QNBKR"):
        notes.append(f"{axis}: too few samples for a coefficient")
    if estimate.misfit:
        notes.append(
            f"{axis}: over half a decade the spectrum differs from the terms by "
            f"{100 * estimate.misfit:.2g} % (a hump, a trend); intervals are widened by it"
        )
    if low_pass := estimate.noise.low_pass:
        kind, corner, hertz = low_pass.kind, low_pass.corner.value, low_pass.interval_hz
        note = f"low-pass near {corner:.3g} Hz ({kind}): N, B and K describe the noise before it"
        if hertz:
            note = f"values are {kind}, as from a sensor of {hertz:.3g} Hz"
        notes.append(f"{axis}: {note}")
    return estimate


def summary(stretches, rate):
    """Return summary figures of one axis, by which devices are compared, in the unit of the axis.

    Parameters
    ----------
    stretches : sequence of ndarray
        Output in each clean stretch, which has no disturbance and no gap.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    dict of str to float or None
        ``mean`` and ``std`` are the mean and the standard deviation of the samples. ``std_10s`` and
        ``std_100s`` are the standard deviations of the means over consecutive intervals of 10 s and
        of 100 s. A standard deviation is None if there are fewer than two values from which to
        compute it.
    """
    x = np.concatenate(stretches)
    values = {"std": x}
    for name, seconds in MEANS.items():
        count = max(round(seconds * rate), 1)
        full = [part[: len(part) // count * count] for part in stretches]
        values[name] = np.concatenate([part.reshape(-1, count).mean(axis=1) for part in full])
    std = {name: float(v.std(ddof=1)) if len(v) > 1 else None for name, v in values.items()}
    return {"mean": float(x.mean())} | std
