"""Scans of a record for a step at any time."""

import numpy as np

from imuloop.effects.steps import Steps, joined, share_after
from imuloop.estimate.axis_fit import log_f_tail
from imuloop.model.effects import SensorEffect

# least number of windows on either side of a step, and number of times tried within one window
BESIDE, WITHIN = 3, 4
# largest number of steps in all records; the search may stop if log p of the first step is above
# this
MOST_STEPS, HOPELESS = 6, 6.0

# least number of poses on either side of a step: with fewer it could be an outlier. A pose gives
# one residual of an accelerometer, three of a gyroscope
POSES_BESIDE = {"accelerometer": 3, "gyroscope": 2}
# most times that are tried first, and the resolution of the best time, s
MOST_TIMES, CLOSE = 50, 0.01


def best_steps(search, base, may_give_up=False):
    """Return the Trial, the significance test, of the best steps of the bias in time, or None.

    A step changes the bias at one instant. Steps are added one by one, each at the instant that is
    clearest with the other steps in the model. The search ends if one more step does not lower
    log p, the logarithm of the p-value of all steps together. A second step is tried even if the
    first one is not significant: as long as the model lacks the second step, it looks like a random
    walk, which can hide the first. `search` is the Search of static records, which have the means
    over windows of a rest. `base` has the effects that are in the model already.

    The result is None if no step can be estimated. If `may_give_up` is true, it is also None if the
    first step is hopeless: its log p, corrected for the number of instants and axes that were
    tried, is above `HOPELESS`.
    """
    best, steps, log_tries, variants = None, (), 0.0, ()
    for number in range(1, MOST_STEPS + 1):
        log_p, step, count = most_promising_step(search, base + variants, steps)
        # the order in which the steps were found does not matter: a set of times counts as one try
        log_tries += np.log(max(count, 1) / number)
        # the step may be seen on any of three axes, which counts as three tries
        corrected = log_p + np.log(3) + log_tries
        if not step or (may_give_up and number == 1 and corrected > HOPELESS):
            break
        steps = (*steps, step)
        variants = (joined(steps),)
        trial = search.best_variant(base, variants, log_tries)
        if best is not None and (trial is None or trial.log_p >= best.log_p):
            break
        best = trial or best
    return best


def most_promising_step(search, base, earlier=()):
    """Return log p of the clearest step, the step itself, and the number of instants tried.

    A step changes the bias at one instant. All instants and axes are compared; the clearest step
    has the smallest p-value on its axis. The number of instants serves to correct the p-value. The
    step is None, with log p zero, if no window is left to try. `search` is the Search of static
    records, which have the means over windows of a rest. `base` has the effects that are in the
    model, the `earlier` steps included. Windows close to the earlier steps are not tried.
    """
    # log p, axis and step; the first entry stands for the case without a step, whose p is one
    steps, training_fit = [(0.0, 3, None)], search.training_fit(base)
    evidence = training_fit.evidence
    # the training windows of each record, and the windows at whose start a step is tried
    starts, count = [], 0
    for i, record in enumerate(search.problem.records):
        # windows that are not held out, without those too close to an end or to another step
        rows = np.delete(np.arange(len(record.windows)), training_fit.held_rows[i])
        windows, length = record.windows[rows], np.median(record.length)
        rows = rows[BESIDE : len(rows) - BESIDE + 1]
        for step in earlier:
            if step.sessions == (record.session,):
                distance = np.abs(record.windows[rows, 0] - step.times[0]) - step.spans[0] / 2
                rows = rows[distance > (BESIDE - 0.5) * length]
        if len(rows):
            starts.append((i, record, windows, length, rows))
            count += WITHIN * len(rows)
    for axis in range(3):
        fit, columns = training_fit.fit(base, axis), evidence.columns_of(base, axis)
        # the likeliest hypothesis, one of the covariances that the noise may have
        hypothesis = int(np.argmax(fit.log_probability))
        matrix = evidence.matrix((evidence.residual_columns[axis], *columns))
        # residuals divided by the estimated size of the noise have the covariance of the hypothesis
        residuals = matrix @ np.append(1.0, -fit.coefficients[hypothesis])
        residuals = evidence.split(residuals / np.sqrt(fit.scale[hypothesis]))
        most, step = -1.0, None
        for i, record, windows, length, rows in starts:
            weighted = training_fit.apply_precision(i, hypothesis, residuals[i][:, None])[:, 0]
            # products of residuals and steps, one at the start of each window: the sum of the
            # weighted residuals from there on
            score = weighted[::-1].cumsum()[::-1][rows]
            drop = _chi_square_drops(score, training_fit.step_information(i, hypothesis)[rows])
            # the time of the step is refined within the two windows next to the best start
            start = record.windows[rows[np.argmax(drop)], 0]
            times = start + length * np.arange(-1, 1 + 1 / WITHIN, 1 / WITHIN)
            shares = share_after(record.windows, times)
            weighted_shares = training_fit.apply_precision(i, hypothesis, shares)
            information = np.einsum("nf,nf->f", shares, weighted_shares)
            drops = _chi_square_drops(weighted @ shares, information)
            if drops.max() > most:
                time, span = span_between(times[np.argmax(drops)], windows)
                most = drops.max()
                step = Steps(times=(time,), sessions=(record.session,), spans=(span,))
        if step:
            steps.append((log_f_tail(most, 1, fit.dof - 1), axis, step))
    log_p, _, step = min(steps, key=lambda entry: entry[:2])
    return log_p, step, count


def pose_step(sensor, search, base, may_give_up=False):
    """Return the Trial, the test, of the step of a sensor's bias that poses show best, or None.

    `sensor` is the name of the sensor, and `search` the Search in the poses. Times in the middle of
    the poses are tried first, then times ever closer to the best of them, since a step may lie
    within a pose or between two. This search for the time is done with two sorts of noise, because
    each can fail, and the more significant of the two steps is returned:

    - The noise is as estimated. This fails if a hand trembles: the noise is then far too small, and
      hardly tells one time from another.
    - The noise is averaged over all noise hypotheses, the covariances that it may have. This fails
      if a hypothesis with large noise counts the residuals that the step causes as noise.

    `base` has the effects that are in the model already. `may_give_up`, which lets other scans stop
    early, changes nothing here: the first times are quick to test. The result is None with too few
    poses, or if no step can be estimated.
    """
    middle, least = search.problem.recording.poses.mid_s, POSES_BESIDE[sensor]
    if len(middle) < 2 * least:
        return None
    inner = middle[least - 1 : len(middle) - least + 1]
    # at most `MOST_TIMES` times, evenly spaced in the number of the pose
    number = np.linspace(0, len(inner) - 1, min(len(inner), MOST_TIMES))
    times = np.interp(number, np.arange(len(inner)), inner)
    log_tries = np.log(2 * WITHIN * len(times))
    as_estimated = search.training_fit(base).evidence.as_estimated_mask
    steps = [
        _refine_time(sensor, search, base, times, log_tries, hypotheses)
        for hypotheses in (as_estimated, np.ones_like(as_estimated))
    ]
    return search.best_variant(base, [step for step in steps if step], log_tries)


def _refine_time(sensor, search, base, times, log_tries, hypotheses):
    """Return the step of a `sensor`'s bias at the clearest time, a SensorEffect, or None.

    The `times`, s, are tried first. If the best of them is clearer than chance, times ever closer
    to it are tried, until they differ by less than `CLOSE`. “Clearer than chance” means that log p
    plus `log_tries`, the logarithm of the number of tries, is at most zero. The result is None if
    no step can be estimated. `search` is the Search in the poses, and `base` has the effects in the
    model. A noise hypothesis is one covariance that the noise may have; `hypotheses`, (h,) of bool,
    selects those of all h by which times are compared.
    """
    spacing = np.diff(times).max() / 2
    while True:
        variants = [SensorEffect(Steps((float(t),)), sensor) for t in times]
        trials = [t for t in search.tests(base, variants, hypotheses) if t]
        if not trials:
            return None
        step = min(trials, key=lambda t: round(t.log_p, 6)).effect
        log_p = search.test(base, step).log_p
        if spacing < CLOSE or log_p + log_tries > 0:
            return step
        (time,) = step.effect.times
        times, spacing = time + spacing * np.array([0, -1, 1]), spacing / 2


def span_between(time, windows):
    """Return the middle and the length of the gap between two windows that a `time` lies in, s.

    The data cannot tell two times of a step in one gap apart. If the time lies within a window
    instead, it is returned unchanged, with length zero. `windows`, (n, 2), has start and end of
    each of n windows, s.
    """
    after = np.searchsorted(windows[:, 1], time, side="right")
    if 0 < after < len(windows) and time <= windows[after, 0]:
        start, end = windows[after - 1, 1], windows[after, 0]
        return float(start + end) / 2, float(end - start)
    return float(time), 0.0


def _chi_square_drops(score, information):
    """Return for each of f columns by how much χ² falls if this column alone is fitted, (f,).

    A column is the derivative of the residuals with respect to the size of a step at one time.
    `score`, (f,), has the product of each column and the residuals, and `information`, (f,), the
    product of each column with itself. Both products are weighted with the precision of the noise.
    A column that the level of a record explains has the result zero.
    """
    # a column that the level of the record explains has a square of rounding errors only
    shown = information > 1e-9 * information.max()
    return np.where(shown, score**2, 0.0) / np.where(shown, information, 1.0)
