"""Scans of a record for a line of any frequency and a step at any time."""

import numpy as np

from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.diagnose.p_values import log_f_tail
from imuloop.effects.sinusoid import Sinusoid
from imuloop.effects.steps import Steps, share_after

# periods of a line that a record must hold, and frequencies that are tried in a period's width
LEAST_PERIODS, FINENESS = 2, 4
# windows on either side of a step, and times that are tried within one
BESIDE, WITHIN = 3, 4

# poses on either side of a step, without which it would be an outlier's second name
POSES_BESIDE = 3
# times that are tried first among poses at most, and how close the best is found, s
MOST_TIMES, CLOSE = 100, 0.05


def whitened(search, base, axis):
    """Return what is seen of one axis in each record, for a scan, and degrees of freedom.

    Of each record the windows that are seen, (m,), their precision for the likeliest noise without
    the pattern, the level taken out, (m, m), and the residual in units of the noise's N, (m,).
    """
    training = search.training(base)
    fit, columns = training.fit(base, axis), training.evidence.columns_of(base, axis)
    point, found = int(np.argmax(fit.log_weight)), []
    left = training.evidence.matrix((training.values[axis], *columns))
    left = left @ np.append(1.0, -fit.theta[point]) / np.sqrt(fit.scale[point])
    for i, (own, held) in enumerate(zip(training.evidence.split(left), training.held, strict=True)):
        seen = np.delete(np.arange(len(own)), held)
        found.append((seen, training.precision(i, point), own[seen]))
    return found, fit.dof


def frequencies(records):
    """Return the frequencies to try: a quarter of a period of the longest record apart, Hz."""
    span = max(np.ptp(r.windows) for r in records)
    highest = 0.5 / max(np.median(r.length) for r in records)
    steps = np.arange(FINENESS * LEAST_PERIODS, FINENESS * span * highest - 0.5)
    return steps / (FINENESS * span)


def line_scan(search, base):
    """Return the most promising line of each axis with its log p, and how many were tried."""
    records = search.problem.merged
    tried = frequencies(records)
    if not len(tried):
        return (), 0
    sessions, best, waves = tuple(dict.fromkeys(r.session for r in records)), [], []
    for record, held in zip(records, search.training(base).held, strict=True):
        phase = 2 * np.pi * np.outer(np.delete(record.channels.t, held), tried)
        waves.append(np.stack([np.cos(phase), np.sin(phase)]))
    for axis in range(3):
        parts, dof = whitened(search, base, axis)
        total, q = np.zeros(len(tried)), 2 * len(parts)
        for (_, precision, left), wave in zip(parts, waves, strict=True):
            weighted = precision @ wave
            score = np.einsum("kmf,m->fk", weighted, left)
            information = np.einsum("kmf,lmf->fkl", wave, weighted)
            total += np.einsum("fk,fk->f", score, _solved(information, score))
        log_p = log_f_tail(total / q, q, dof - q)
        at = int(np.argmin(log_p))
        best.append((log_p[at], Sinusoid(float(tried[at]), sessions)))
    return _distinct(best), len(tried)


def step_scan(search, base, taken=()):
    """Return the most promising step of each axis with its log p, and how many were tried.

    A few windows about each of the steps that are `taken` already are left out.
    """
    records, best, count = search.problem.merged, [], 0
    for axis in range(3):
        parts, dof = whitened(search, base, axis)
        count, found = 0, []
        for (seen, *part), record in zip(parts, records, strict=True):
            if len(seen) <= 2 * BESIDE:
                continue
            windows, length = record.windows[seen], np.median(record.length)
            starts = windows[BESIDE : len(windows) - BESIDE + 1, 0]
            for one in taken:
                if one.sessions == (record.session,):
                    apart = np.abs(starts - one.times[0]) - one.spans[0] / 2
                    starts = starts[apart > (BESIDE - 0.5) * length]
            if not len(starts):
                continue
            gain = _gain(*part, windows, starts)
            # within the windows beside the best start a step may lie anywhere
            within = starts[np.argmax(gain)] + length * np.arange(-1, 1 + 1 / WITHIN, 1 / WITHIN)
            gains = _gain(*part, windows, within)
            count += WITHIN * len(starts)
            time, span = unseen(within[np.argmax(gains)], windows)
            step = Steps((time,), (record.session,), (span,))
            found.append((log_f_tail(gains.max(), 1, dof - 1), step))
        if found:
            best.append(min(found, key=lambda f: f[0]))
    return _distinct(best), count


def pose_step(sensor, search, base, hopeful=False):
    """Return the Trial of the step of a sensor's bias that poses show most clearly, or None.

    Amid the poses and amid the gaps first, then, where one shows more than chance, ever closer
    about the best: it may lie within a pose. The first are cheap, so all have them, hopeful or not.
    """
    middle = search.problem.recording.poses.mid_s
    if len(middle) < 2 * POSES_BESIDE:
        return None
    inner = middle[POSES_BESIDE - 1 : len(middle) - POSES_BESIDE + 1]
    number = np.linspace(0, len(inner) - 1, min(2 * len(inner) - 1, MOST_TIMES))
    times = np.interp(number, np.arange(len(inner)), inner)
    apart, tries = np.diff(times).max() / 2, np.log(WITHIN * len(times))
    while True:
        shapes = [OfSensor(Steps((float(t),)), sensor) for t in times]
        best = search.shaped(base, shapes, tries)
        if best is None or apart < CLOSE or best.log_p > 0:
            return best
        (found,) = best.effect.times
        times, apart = found + apart * np.array([0, -1, 1]), apart / 2


def unseen(time, windows):
    """Return the middle and the length of the span between windows that a time lies in.

    Nothing that is seen tells times in it apart; a time within a window is itself, its span 0.
    """
    after = np.searchsorted(windows[:, 1], time, side="right")
    if 0 < after < len(windows) and time <= windows[after, 0]:
        start, end = windows[after - 1, 1], windows[after, 0]
        return float(start + end) / 2, float(end - start)
    return float(time), 0.0


def _gain(precision, left, windows, times):
    """Return by how much χ² falls with a step at each time."""
    after = share_after(windows, times)
    weighted = precision @ after
    information = np.einsum("mk,mk->k", after, weighted)
    known = information > 1e-9 * information.max()
    score = weighted.T @ left
    return np.where(known, score**2 / np.where(known, information, 1.0), 0.0)


def _solved(matrices, vectors):
    """Return the solutions of small systems, zero where one is singular."""
    size = np.sqrt(np.maximum(np.einsum("fkk->fk", matrices), 1e-300))
    scaled = matrices / size[:, :, None] / size[:, None, :]
    inverse = np.linalg.pinv(scaled, rcond=1e-6, hermitian=True)
    return np.einsum("fkl,fl->fk", inverse, vectors / size) / size


def _distinct(best):
    """Return (log p, effect), the best first, each effect once."""
    smallest = {}
    for log_p, effect in sorted(best, key=lambda f: f[0]):
        smallest.setdefault(effect, log_p)
    return tuple((log_p, effect) for effect, log_p in smallest.items())
