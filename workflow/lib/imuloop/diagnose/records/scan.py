"""Scans of a record for a step at any time."""

import numpy as np

from imuloop.effects.steps import Steps, joined, share_after
from imuloop.estimate.p_values import log_f_tail
from imuloop.model.effects import SensorEffect

# windows on either side of a step, and times that are tried within one
BESIDE, WITHIN = 3, 4
# steps in one record or another; logarithm of a p-value at which a second is not looked for
MOST_STEPS, HOPELESS = 6, 6.0

# poses on either side of a step, without which it would be an outlier's second name: each shows one
# number of an accelerometer, three of a gyroscope
POSES_BESIDE = {"accelerometer": 3, "gyroscope": 2}
# times that are tried first among poses at most, and how close the best is found, s
MOST_TIMES, CLOSE = 50, 0.01


def residuals_by_record(search, base, axis):
    """Return what effects leave of an axis, (n,) of each record, degrees of freedom, hypothesis.

    In units of the noise's N, by the likeliest noise without the pattern that is looked for.
    """
    training_fit = search.training_fit(base)
    fit, columns = training_fit.fit(base, axis), training_fit.evidence.columns_of(base, axis)
    hypothesis = int(np.argmax(fit.log_weight))
    left = training_fit.evidence.matrix((training_fit.residual_columns[axis], *columns))
    left = left @ np.append(1.0, -fit.theta[hypothesis]) / np.sqrt(fit.scale[hypothesis])
    return training_fit.evidence.split(left), fit.dof, hypothesis


def best_steps(search, base, hopeful=False):
    """Return the best Trial of one step, or of several, each the best beside those before, or None.

    One step of two may show nothing: the other looks like a walk. So one more is always tried,
    unless, `hopeful`, the first is hopeless.
    """
    best, taken, tries, beside = None, (), 0.0, ()
    for number in range(1, MOST_STEPS + 1):
        promise, step, count = most_promising_step(search, base + beside, taken)
        tries += np.log(max(count, 1) / number)
        if not step or (hopeful and number == 1 and promise + np.log(3) + tries > HOPELESS):
            break
        taken = (*taken, step)
        beside = (joined(taken),)
        trial = search.best_of_shapes(base, beside, tries)
        if best is not None and (trial is None or trial.log_p >= best.log_p):
            break
        best = trial or best
    return best


def most_promising_step(search, base, taken=()):
    """Return log p of the step that an axis shows most clearly, the step, and how many were tried.

    A few windows about each of the steps that are `taken` already are left out. No step, None,
    where none is left to try.
    """
    found, training_fit, places = [(0.0, 3, None)], search.training_fit(base), []
    for i, record in enumerate(search.problem.records):
        rows = np.delete(np.arange(len(record.windows)), training_fit.held_rows[i])
        windows, length = record.windows[rows], np.median(record.length)
        rows = rows[BESIDE : len(rows) - BESIDE + 1]
        for one in taken:
            if one.sessions == (record.session,):
                apart = np.abs(record.windows[rows, 0] - one.times[0]) - one.spans[0] / 2
                rows = rows[apart > (BESIDE - 0.5) * length]
        if len(rows):
            places.append((i, record, windows, length, rows))
    count = WITHIN * sum(len(rows) for *_, rows in places)
    for axis in range(3):
        left_by_record, dof, hypothesis = residuals_by_record(search, base, axis)
        most, step = -1.0, None
        for i, record, windows, length, rows in places:
            left, starts = left_by_record[i], record.windows[rows, 0]
            weighted = training_fit.apply_precision(i, hypothesis, left[:, None])[:, 0]
            score = weighted[::-1].cumsum()[::-1][rows]
            gain = _chi_square_drops(score, training_fit.step_information(i, hypothesis)[rows])
            # within the windows beside the best start a step may lie anywhere
            within = starts[np.argmax(gain)] + length * np.arange(-1, 1 + 1 / WITHIN, 1 / WITHIN)
            shares = share_after(record.windows, within)
            gains = _chi_square_drops(
                weighted @ shares,
                np.einsum("nf,nf->f", shares, training_fit.apply_precision(i, hypothesis, shares)),
            )
            if gains.max() > most:
                time, span = span_between(within[np.argmax(gains)], windows)
                most, step = gains.max(), Steps((time,), (record.session,), (span,))
        if step:
            found.append((log_f_tail(most, 1, dof - 1), axis, step))
    log_p, _, step = min(found, key=lambda f: f[:2])
    return log_p, step, count


def pose_step(sensor, search, base, hopeful=False):
    """Return the Trial of the step of a sensor's bias that poses show most clearly, or None.

    Amid the poses and amid the gaps first, then, where one shows more than chance, ever closer
    about the best: it may lie within a pose. By the noise as estimated: what a jump leaves of the
    turns would pass for their noise otherwise. The first are cheap, so all have them, hopeful or
    not.
    """
    middle, beside = search.problem.recording.poses.mid_s, POSES_BESIDE[sensor]
    if len(middle) < 2 * beside:
        return None
    inner = middle[beside - 1 : len(middle) - beside + 1]
    number = np.linspace(0, len(inner) - 1, min(len(inner), MOST_TIMES))
    times = np.interp(number, np.arange(len(inner)), inner)
    apart, tries = np.diff(times).max() / 2, np.log(2 * WITHIN * len(times))
    estimated = search.training_fit(base).evidence.as_estimated_mask
    while True:
        shapes = [SensorEffect(Steps((float(t),)), sensor) for t in times]
        search.problem.add_columns(shapes)
        tried = [t for t in search.tests(base, shapes, estimated) if t]
        if not tried:
            return None
        clearest = min(tried, key=lambda t: t.log_p)
        best = search.best_of_shapes(base, [clearest.effect], tries)
        if best is None or apart < CLOSE or best.log_p > 0:
            return best
        (found,) = best.effect.effect.times
        times, apart = found + apart * np.array([0, -1, 1]), apart / 2


def span_between(time, windows):
    """Return the middle and the length of the span between windows that a time lies in.

    Nothing that is seen tells times in it apart; a time within a window is itself, its span 0.
    """
    after = np.searchsorted(windows[:, 1], time, side="right")
    if 0 < after < len(windows) and time <= windows[after, 0]:
        start, end = windows[after - 1, 1], windows[after, 0]
        return float(start + end) / 2, float(end - start)
    return float(time), 0.0


def _chi_square_drops(score, information):
    """Return by how much χ² falls with each of f columns, of size ``score/information``, (f,)."""
    # what a level takes up is no column
    seen = information > 1e-9 * information.max()
    return np.where(seen, score**2, 0.0) / np.where(seen, information, 1.0)
