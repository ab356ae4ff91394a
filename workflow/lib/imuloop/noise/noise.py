"""Noise of a device: coefficients, Allan curves and summary figures from its rests."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from imuloop.core.files import write_json
from imuloop.core.noise_model import AxisNoise, NoiseModel
from imuloop.core.samples import CHANNELS, TEMPERATURE, TIME
from imuloop.core.segments import STATIC
from imuloop.noise.allan import COLUMNS, allan_table, allan_variance, averaging_factors
from imuloop.noise.curve_covariance import curve_covariance
from imuloop.noise.fit import MIN_POINTS, design, fit_curve
from imuloop.noise.statistics import summary

# sessions pool into one curve where their rates agree within this share
RATE_TOLERANCE = 0.01
# spread of the sampling interval that is worth a note, share of its mean
JITTER = 0.05
# range of temperature that is worth a note, K
TEMPERATURE_RANGE = 2.0


@dataclass(frozen=True)
class Session:
    """One session of a device.

    Attributes
    ----------
    name : str
        Name in the config.
    kind : str
        'static', 'six_position' or 'multi_position'.
    samples : DataFrame
        Samples, SI; empty where the session was rejected.
    segments : DataFrame
        Segments of these samples.
    """

    name: str
    kind: str
    samples: pd.DataFrame
    segments: pd.DataFrame


@dataclass(frozen=True)
class NoiseResult:
    """Result of the noise stage.

    Attributes
    ----------
    model : NoiseModel
        Coefficients of the six axes.
    statistics : dict of str to dict
        For each session used and each axis the figures of `statistics.summary`.
    sessions : tuple of str
        Sessions behind the coefficients.
    notes : tuple of str
        What a reader of the coefficients must know.
    allan : dict of str to DataFrame
        For each session given its own Allan curve, columns of allan.parquet; without rows where
        the session was not used.
    """

    model: NoiseModel
    statistics: dict
    sessions: tuple[str, ...]
    notes: tuple[str, ...]
    allan: dict

    def to_dict(self):
        """Return the content of noise.json."""
        return {
            **self.model.to_dict(),
            "statistics": self.statistics,
            "sessions": list(self.sessions),
            "notes": list(self.notes),
        }

    def to_json(self, path):
        """Write noise.json."""
        write_json(path, self.to_dict())


@dataclass(frozen=True)
class _Record:
    """Clean stretches of a session as slices of its samples, and their mean rate in Hz."""

    session: Session
    slices: tuple[slice, ...]
    rate: float

    @property
    def lengths(self):
        return np.array([s.stop - s.start for s in self.slices])

    def stretches(self, axis):
        x = self.session.samples[axis].to_numpy()
        return [x[s] for s in self.slices]


def estimate_noise(device, sessions, settings):
    """Estimate the noise of a device from its static sessions, else from all its rests.

    Parameters
    ----------
    device : str
        Name of the device.
    sessions : sequence of Session
        All; the static ones count or, where none of them holds a rest, the rests of all others.
    settings : NoiseSettings
        Averaging times and level of the tests.

    Returns
    -------
    NoiseResult
        One fit to the Allan variance pooled over all clean stretches of all sessions used; no
        term is identifiable where there is nothing to fit.
    """
    notes = []
    records = _static_records(sessions, notes)
    if not records:
        records = _all_rests(sessions, notes)
    if not records:
        notes.append("no session holds a rest: no coefficient can be estimated")
        model = NoiseModel(device, dict.fromkeys(CHANNELS, AxisNoise()))
        return NoiseResult(model, {}, (), tuple(notes), {s.name: _empty() for s in sessions})
    records = _one_rate(records, notes)
    for record in records:
        _note_conditions(record, notes)

    lengths = np.concatenate([record.lengths for record in records])
    rate = np.average(
        [record.rate for record in records], weights=[record.lengths.sum() for record in records]
    )
    factors = averaging_factors(lengths.max(), settings)
    covariance = curve_covariance(factors, lengths, rate)
    axes, thetas = {}, {}
    for axis in CHANNELS:
        stretches = [x for record in records for x in record.stretches(axis)]
        if not all(np.isfinite(x).all() for x in stretches):
            notes.append(f"{axis}: values that are not finite, no coefficient estimated")
            axes[axis] = AxisNoise()
            continue
        variance = allan_variance(stretches, factors)
        fit = fit_curve(factors / rate, variance, covariance, settings)
        axes[axis], thetas[axis] = fit.noise, fit.theta
        if not fit.theta.any():
            notes.append(_why_nothing(axis, factors, variance))
        if fit.misfit:
            notes.append(
                f"{axis}: the curve leaves the five terms by {100 * fit.misfit:.2g} % of the "
                "variance beyond chance (a filter, a hump, a line): intervals are widened by it"
            )
    _note_walk(axes, lengths.max() / rate, notes)

    tables = {session.name: _empty() for session in sessions}
    statistics = {}
    for record in records:
        name = record.session.name
        tables[name] = _session_table(record, thetas, settings)
        statistics[name] = {axis: summary(record.stretches(axis), record.rate) for axis in CHANNELS}
    names = tuple(record.session.name for record in records)
    return NoiseResult(NoiseModel(device, axes), statistics, names, tuple(notes), tables)


def _record(session):
    """Return the clean stretches of a session, each with at least two samples; None without."""
    static = session.segments[session.segments["kind"] == STATIC]
    t = session.samples[TIME].to_numpy()
    first = np.searchsorted(t, static["start_s"].to_numpy(dtype=float))
    last = np.searchsorted(t, static["end_s"].to_numpy(dtype=float))
    slices = [slice(int(i), int(j)) for i, j in zip(first, last, strict=True) if j - i > 1]
    if not slices:
        return None
    intervals = sum(s.stop - s.start - 1 for s in slices)
    return _Record(
        session, tuple(slices), intervals / sum(t[s.stop - 1] - t[s.start] for s in slices)
    )


def _static_records(sessions, notes):
    """Return a record for each static session that holds a rest."""
    records = []
    for session in sessions:
        if session.kind != "static":
            continue
        record = _record(session)
        if record is None:
            notes.append(f"static session {session.name} holds no rest and is left out")
        else:
            records.append(record)
    return records


def _all_rests(sessions, notes):
    """Return a record for each session that holds a rest, and note what rests cannot tell."""
    records = [_record(s) for s in sessions if s.kind != "static"]
    records = [record for record in records if record is not None]
    if records:
        count = sum(len(record.slices) for record in records)
        seconds = max(record.lengths.max() / record.rate for record in records)
        notes.append(
            f"no static record: from all {count} rests, the longest of {seconds:.3g} s; what "
            f"changes the output over more than {seconds / 3:.2g} s (flicker, walk, ramp) is not "
            "seen there and only limited from above"
        )
    return records


def _one_rate(records, notes):
    """Return the records that share the rate of the largest one."""
    largest = max(records, key=lambda record: record.lengths.sum())
    kept = []
    for record in records:
        if abs(record.rate / largest.rate - 1) <= RATE_TOLERANCE:
            kept.append(record)
        else:
            notes.append(
                f"session {record.session.name} has {record.rate:.4g} Hz and is left out beside "
                f"{largest.session.name} with {largest.rate:.4g} Hz"
            )
    return kept


def _note_conditions(record, notes):
    """Note jitter and temperature of a record."""
    samples, name = record.session.samples, record.session.name
    t = samples[TIME].to_numpy()
    interval = np.concatenate([np.diff(t[s]) for s in record.slices])
    jitter = interval.std() / interval.mean()
    if jitter > JITTER:
        notes.append(
            f"session {name}: sampling interval scatters by {100 * jitter:.2g} %; the curve takes "
            "the mean rate"
        )
    if TEMPERATURE in samples:
        temperature = samples[TEMPERATURE].to_numpy()
        temperature = np.concatenate([temperature[s] for s in record.slices])
        low, high = np.nanmin(temperature), np.nanmax(temperature)
        if high - low > TEMPERATURE_RANGE:
            notes.append(
                f"session {name}: temperature went from {low:.1f} to {high:.1f} degC; B, K and R "
                "hold the bias' dependence on it"
            )


def _why_nothing(axis, factors, variance):
    """Return the note for an axis without any coefficient."""
    if len(factors) < MIN_POINTS:
        return f"{axis}: {len(factors)} averaging times, {MIN_POINTS} needed for a fit"
    constant = "constant" if not variance.any() else "constant over some averaging times"
    return f"{axis}: output is {constant}, no coefficient estimated"


def _note_walk(axes, seconds, notes):
    """Note where the walk, which weighs most in long integrals, could not be seen."""
    unseen = [axis for axis, noise in axes.items() if not noise.K.identifiable]
    if unseen:
        notes.append(
            f"random walk not supported by the longest clean stretch of {seconds:.4g} s: "
            f"{', '.join(unseen)}; it shows once the record is many times sqrt(3) N/K, so K has "
            "an upper limit only"
        )


def _session_table(record, thetas, settings):
    """Return the Allan curves of one session's own data."""
    factors = averaging_factors(record.lengths.max(), settings)
    spread = curve_covariance(factors, record.lengths, record.rate, reach=1.0)
    tables = [_empty()]
    for axis, theta in thetas.items():
        # a curve that could not be fitted: as for white noise
        theta = theta if theta[:4].any() else np.array([0, 1.0, 0, 0, 0])
        tau = factors / record.rate
        variance = allan_variance(record.stretches(axis), factors)
        edf = 2 * (design(tau) @ theta) ** 2 / spread.variance(theta)
        tables.append(allan_table(axis, tau, variance, edf))
    return pd.concat(tables, ignore_index=True)


def _empty():
    """Return an Allan table without rows."""
    return pd.DataFrame(
        {name: pd.Series(dtype=str if name in ("axis", "stage") else float) for name in COLUMNS}
    )
