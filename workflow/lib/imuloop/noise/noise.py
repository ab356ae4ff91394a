"""Noise of a device: coefficients, Allan curves, other views and summary figures."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass

import numpy as np

from imuloop.core.files import write_json
from imuloop.core.noise_model import AxisNoise, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.core.tables import joined, table
from imuloop.noise import views
from imuloop.noise.allan import COLUMNS, allan_table, allan_variance, averaging_factors
from imuloop.noise.axis import AxisEstimate, estimate_axis
from imuloop.noise.curve_covariance import curve_covariance, degrees_of_freedom
from imuloop.noise.fit import TERMS, fit_curve
from imuloop.noise.modes import modes
from imuloop.noise.records import all_rests, note_conditions, one_rate, record_of, static_records
from imuloop.noise.statistics import repeatability, summary


@dataclass(frozen=True)
class NoiseResult:
    """Result of the noise stage.

    Attributes
    ----------
    model : NoiseModel
        Coefficients of the six axes.
    rate_hz : float or None
        Sampling rate of the sessions used, Hz.
    curve_fit : dict of str to dict
        For each axis Q, N, B, K, R of the plain fit to the Allan curve, the cross-check; 0 where
        not in the fit.
    spectrum : dict of str to dict
        For each axis ``misfit`` and ``band_hz`` of its `AxisEstimate`.
    uncut : dict or None
        ``seconds`` that were cut and, under ``axes``, the coefficients with them left in.
    repeatability : dict or None
        Of the static sessions, see `statistics.repeatability`.
    statistics : dict of str to dict
        For each session used and each axis the figures of `statistics.summary`.
    sessions : tuple of str
        Sessions behind the coefficients.
    notes : tuple of str
        What a reader of the coefficients must know.
    allan, views : dict of str to dict of ndarray
        For each session given its own Allan curve, columns of allan.parquet, and its other views,
        columns of views.parquet; without rows where the session was not used.
    """

    model: NoiseModel
    rate_hz: float | None
    curve_fit: dict
    spectrum: dict
    uncut: dict | None
    repeatability: dict | None
    statistics: dict
    sessions: tuple[str, ...]
    notes: tuple[str, ...]
    allan: dict
    views: dict

    def to_dict(self):
        """Return the content of noise.json."""
        return {
            **self.model.to_dict(),
            "rate_hz": self.rate_hz,
            "curve_fit": self.curve_fit,
            "spectrum": self.spectrum,
            "uncut": self.uncut,
            "repeatability": self.repeatability,
            "statistics": self.statistics,
            "sessions": list(self.sessions),
            "notes": list(self.notes),
        }

    def to_json(self, path, failed=None):
        """Write noise.json; `failed` is what went wrong where there is nothing to write."""
        write_json(path, self.to_dict() | ({"failed": failed} if failed else {}))


def no_noise(device, sessions, reason):
    """Return the NoiseResult that knows nothing, with the reason.

    Parameters
    ----------
    device : str
        Name of the device.
    sessions : iterable of str
        Names of its sessions.
    reason : str
        Why there is none.
    """
    return NoiseResult(
        model=NoiseModel(device, dict.fromkeys(CHANNELS, AxisNoise())),
        rate_hz=None,
        curve_fit={},
        spectrum={},
        uncut=None,
        repeatability=None,
        statistics={},
        sessions=(),
        notes=(reason,),
        allan={name: _empty() for name in sessions},
        views={name: views.empty() for name in sessions},
    )


def estimate_noise(device, sessions, settings, uncut=True, threads=1):
    """Estimate the noise of a device from its static sessions, else from all its rests.

    Parameters
    ----------
    device : str
        Name of the device.
    sessions : sequence of Session
        All; the static ones count or, where none of them holds a rest, the rests of all others.
    settings : NoiseSettings
        Averaging times, levels of the tests, other views.
    uncut : bool
        Whether the coefficients are also estimated with the disturbed stretches left in.
    threads : int
        What is worked on at once, of one axis; results do not depend on it.

    Returns
    -------
    NoiseResult
        One estimate from all clean stretches of all sessions used; no term is identifiable where
        there is nothing to fit.
    """
    notes = []
    static = static_records(sessions, notes)
    records = static or all_rests(sessions, notes)
    tables = {session.name: [_empty()] for session in sessions}
    pictures = {session.name: [views.empty()] for session in sessions}
    axes, curves, spectra, statistics, uncut_axes = {}, {}, {}, {}, {}
    rate, added = None, 0.0
    if records:
        records = one_rate(records, notes)
        for record in records:
            note_conditions(record, notes)
            statistics[record.session.name] = {}
        whole = [record_of(r.session, disturbed=True) for r in records] if uncut and static else []
        added = _seconds(whole) - _seconds(records)
        layouts = [layout for record in records for layout in record.layouts]
        lengths = np.concatenate([record.lengths for record in records])
        rate = float(
            np.average([r.rate for r in records], weights=[sum(r.lengths) for r in records])
        )
        pooled = _Curve(lengths, rate, settings)
        # one session's own curve is the pooled one
        own = [_Curve(r.lengths, r.rate, settings) for r in records] if len(records) > 1 else []
        basis = modes(layouts)
        if added > 0.5 / rate:
            whole_layouts = [layout for record in whole for layout in record.layouts]
            whole_basis = modes(whole_layouts)
        for axis in CHANNELS:
            columns = [record.column(axis) for record in records]
            values = [record.cut(x) for record, x in zip(records, columns, strict=True)]
            # curves and views take a few missing samples for none
            closed = [r.close_up(x) for r, x in zip(records, values, strict=True)]
            with ThreadPoolExecutor(threads) as pool:
                curve = pool.submit(pooled.fitted, [x for each in closed for x in each])
                told = pool.submit(_told, axis, records, closed, settings)
                curve, fitted = curve.result()
                start = np.square(fitted[:4]) if any(fitted[:4]) else None
                runs = _runs(records, values)
                found = _estimate(axis, layouts, basis, runs, settings, notes, start)
                if added > 0.5 / rate:
                    every = [record.cut(x) for record, x in zip(whole, columns, strict=True)]
                    every = _runs(whole, every)
                    other = _estimate(axis, whole_layouts, whole_basis, every, settings, [], start)
                    uncut_axes[axis] = asdict(other.noise)
                told = told.result()
            curves[axis] = dict(zip(TERMS, fitted, strict=True))
            axes[axis] = found.noise
            spectra[axis] = {"misfit": found.misfit, "band_hz": found.band_hz}
            for i, (record, (figures, of_axis)) in enumerate(zip(records, told, strict=True)):
                name = record.session.name
                statistics[name][axis] = figures
                pictures[name] += of_axis
                if own:
                    each, variance = own[i], allan_variance(closed[i], own[i].factors)
                else:
                    each, variance = pooled, curve
                tables[name].append(each.table(axis, variance, found.noise))
            # or two axes would be in memory at once
            columns = values = closed = runs = every = None
        _note_walk(axes, lengths.max() / rate, notes)
    else:
        notes.append("no session holds a rest: no coefficient can be estimated")
        axes = dict.fromkeys(CHANNELS, AxisNoise())
    means = {n: {a: f["mean"] for a, f in s.items()} for n, s in statistics.items()}
    return NoiseResult(
        model=NoiseModel(device, axes),
        rate_hz=rate,
        curve_fit=curves,
        spectrum=spectra,
        uncut={"seconds": added, "axes": uncut_axes} if uncut_axes else None,
        repeatability=repeatability(means if static else {}),
        statistics=statistics,
        sessions=tuple(record.session.name for record in records),
        notes=tuple(notes),
        allan={name: joined(parts) for name, parts in tables.items()},
        views={name: joined(parts) for name, parts in pictures.items()},
    )


class _Curve:
    """Allan curve of stretches: what does not depend on the axis is calculated once."""

    def __init__(self, lengths, rate, settings):
        self.factors = averaging_factors(lengths.max(), settings)
        self.tau = self.factors / rate
        self.covariance = curve_covariance(self.factors, lengths, rate, reach=1.0)

    def fitted(self, stretches):
        """Return the Allan variance and the coefficients of the plain fit to it."""
        variance = allan_variance(stretches, self.factors)
        return variance, fit_curve(self.tau, variance, self.covariance)

    def table(self, axis, variance, noise):
        """Return the curve of one axis with its intervals."""
        edf = degrees_of_freedom(noise, self.tau, self.covariance)
        return allan_table(axis, self.tau, variance, edf)


def _told(axis, records, values, settings):
    """Return the summary and the tables of other views of each record."""
    told = []
    for record, stretches in zip(records, values, strict=True):
        # from rest to rest the attitude changes, and gravity with it: the longest speaks alone
        still = stretches if record.session.kind == "static" else [max(stretches, key=len)]
        figures = summary(still, record.rate)
        finite = np.isfinite(figures["mean"])
        pictures = [views.views(record, stretches, axis, settings)] if finite else []
        told.append((figures, pictures))
    return told


def _runs(records, values):
    """Return the stretches of each run of each record."""
    return [run for record, x in zip(records, values, strict=True) for run in record.runs(x)]


def _estimate(axis, layouts, basis, values, settings, notes, start):
    """Return the AxisEstimate of one axis, with notes on what stands in its way."""
    nothing = AxisEstimate(AxisNoise(), 0.0, 0.5 / basis.dt)
    if not all(np.isfinite(x).all() for each in values for x in each):
        notes.append(f"{axis}: values that are not finite, no coefficient estimated")
        return nothing
    if not any(np.ptp(x) for each in values for x in each):
        notes.append(f"{axis}: output is constant, no coefficient estimated")
        return nothing
    estimate = estimate_axis(layouts, basis, values, settings, start)
    if not any(getattr(estimate.noise, n).upper95 for n in TERMS):
        notes.append(f"{axis}: too few samples for a coefficient")
    if estimate.misfit:
        notes.append(
            f"{axis}: over half a decade the spectrum leaves the terms by "
            f"{100 * estimate.misfit:.2g} % beyond chance (a filter, a hump, a trend): intervals "
            "are widened by it"
        )
    if estimate.band_hz < 0.4 / basis.dt:
        notes.append(
            f"{axis}: power is lacking above {estimate.band_hz:.3g} Hz (a filter, or a log that "
            "was resampled): the coefficients are those of the noise below"
        )
    return estimate


def _seconds(records):
    """Return the time that records hold, s."""
    return float(sum(record.lengths.sum() / record.rate for record in records))


def _note_walk(axes, seconds, notes):
    """Note where the walk, which weighs most in long integrals, could not be seen."""
    unseen = [axis for axis, noise in axes.items() if not noise.K.identifiable]
    if unseen:
        notes.append(
            f"random walk not supported by clean stretches of up to {seconds:.4g} s: "
            f"{', '.join(unseen)}; it shows once the record is many times sqrt(3) N/K, so K has "
            "an upper limit only"
        )


def _empty():
    """Return an Allan table without rows."""
    return table(COLUMNS, "", *[[]] * 5, "")
