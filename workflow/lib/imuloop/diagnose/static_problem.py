"""The problem of static records: means over windows at rest, with slow noise of unknown size."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.steps import BESIDE, best_steps
from imuloop.effects.steps import Steps
from imuloop.estimate.axis_fit import combine_axes
from imuloop.estimate.evidence import Evidence, Hypotheses, RowGroup
from imuloop.estimate.search import Search
from imuloop.estimate.training_fit import ABSORBED
from imuloop.model.effect import FittedEffect

# ratio of neighbouring variances of flicker, and of random walk, on the grid of noise hypotheses
STEP = 6.0
# prior probability that an axis has no flicker, and that it has no random walk
ABSENT = (1 / 2, 1 / 10)
# probability that a device which was not moved counts as moved
MOVED = 1e-3


@dataclass(frozen=True)
class StaticProblem:
    """The static records of one sensor, as a problem for `imuloop.estimate.choice.Choices`.

    A row is the mean over one window, on the three axes of the sensor; there are N rows. Each
    record is a group of rows with its own level, since bias and attitude change from one power
    cycle to the next. Cross-validation holds out one fold, some of the rows, at a time.
    """

    records: tuple  # StaticRecords; a session with several power cycles has several
    variants: dict  # variants to try, a tuple for each kind of effect
    settings: DiagnoseSettings
    tests: int  # number of tests that share the significance
    noise: tuple | None = None  # Hypotheses of each record; default: a grid of white and slow noise
    # for kinds of effects with too many variants for a list: the function that finds the best one
    scans: ClassVar = {Steps: best_steps}
    # whether a scan is repeated after an effect was added; unit of the held-out errors
    scans_again, error_scale = False, 1.0
    # the only kind of residual, with its unit and number of components
    kinds: ClassVar = {"bias": ("output", 1)}
    why_no_trial = "what it adds in these data is taken up by the bias"

    @property
    def folds(self):
        """Number of folds: stretches of time, of which cross-validation holds out one at a time."""
        return self.settings.blocks

    @cached_property
    def fold_of_row(self):
        """Number of the fold of each row, (N,); a row is the mean over one window.

        A fold is one stretch of time in each record, and all folds of a record have equal time at
        rest. It is at a different place in each record, so that the start of one record is
        predicted from the starts of the others.
        """
        folds = []
        for i, record in enumerate(self.records):
            # middle of each window as a share of the time at rest
            share = (np.cumsum(record.length) - record.length / 2) / record.length.sum()
            fold = np.minimum((share * self.folds).astype(int), self.folds - 1)
            folds.append((fold + i * self.folds // len(self.records)) % self.folds)
        return np.concatenate(folds)

    @cached_property
    def evidence(self):
        """Evidence of all rows: means over windows, and the covariances that their noise may have.

        These covariances are the noise hypotheses. They come from a grid of two ratios: flicker and
        random walk, each relative to white noise.
        """
        span = max(np.ptp(r.windows) for r in self.records)
        length = min(np.median(r.length) for r in self.records)
        grid, prior = ratios(span, length)
        noise = self.noise or [hypotheses(r.windows, grid) for r in self.records]
        # no row depends on a second fold
        folds = np.column_stack([self.fold_of_row, np.full(len(self.fold_of_row), -1)])
        ends = np.cumsum([len(r.values) for r in self.records])[:-1]
        # the nuisance parameter of a record is its level
        groups = [
            RowGroup(
                values=r.values - r.values.mean(axis=0),
                nuisance=np.ones((len(r.values), 1)),
                noise=hypotheses_of_record,
                row_folds=row_folds,
            )
            for r, hypotheses_of_record, row_folds in zip(
                self.records, noise, np.split(folds, ends), strict=True
            )
        ]
        # Parameters are estimated without random walk: its weights would use the fastest changes
        # only, where a lag that the model lacks matters most.
        # The level is estimated with white noise, the first hypothesis, so that it is the mean.
        return Evidence(
            groups, prior, self.designs, estimation_mask=grid[:, 1] == 0, nuisance_index=0
        )

    @property
    def values(self):
        """All rows minus the mean of their record, (N, 3), SI: N windows on three axes."""
        return np.concatenate([g.values for g in self.evidence.row_groups])

    def subtract(self, effects):
        """Return the `values` without the errors that some `effects` cause, (N, 3), SI.

        `effects` are FittedEffects. There are N windows on three axes.
        """
        designs = self.designs([fitted.effect for fitted in effects])
        outputs = (d @ fitted.vector for d, fitted in zip(designs, effects, strict=True))
        return self.values - sum(outputs, np.zeros(()))

    def designs(self, effects):
        """Return for each of the `effects` the derivative of all rows, (N, 3, p), SI, a list.

        The derivative is with respect to the p parameters of the effect. A row is the mean over one
        of N windows, on the three axes of the sensor.
        """
        return [
            np.concatenate([e.in_session(r.channels, r.session, r.windows) for r in self.records])
            for e in effects
        ]

    def residuals(self, search, effects):
        """Return the residuals of all rows, (N, 3), SI, by a fit of `effects` to the training rows.

        A row is the mean over one of N windows, on the three axes of the sensor. `search` is the
        Search, which says which rows are training rows.
        """
        training_fit = search.training_fit(effects)
        return np.column_stack([training_fit.residuals(effects, axis) for axis in range(3)])

    def training_fit(self, base, held_out):
        """Return the TrainingFit: least squares of the rows outside the folds in `held_out`.

        `held_out` is a set of numbers of folds. The result does not depend on the effects in
        `base`, since the rows are linear in all effects.
        """
        return self.evidence.training_fit(held_out)

    def refit(self, effects):
        """Do nothing: no fit of the records with these `effects` is needed.

        The rows, means over windows, are linear in all effects, so they are not linearised again.
        """

    def most_changed_rows(self, search, base, trial):
        """Return the only kind of residual, ``bias``, and a slice that selects all rows.

        In a problem with several kinds, the method returns the kind that an added effect changes
        most. Such a problem needs `search`, `base` (the effects in the model) and `trial` (the test
        of the added effect). Here these arguments do not matter.
        """
        return "bias", slice(None)

    def is_like_slow_noise(self, effect):
        """Return False, for any `effect`: no test has to be repeated with more slow noise.

        The noise hypotheses, covariances that the noise may have, already include the slow noise
        that an effect may resemble.
        """
        return False

    def of_kind(self, kind):
        """Return the mask of the rows of one kind of residual, (N,) of bool: all N rows.

        `kind` does not matter, since there is only one kind of residual.
        """
        return np.ones(len(self.fold_of_row), dtype=bool)


def ratios(span, length):
    """Return a grid of g pairs of noise ratios to try, (g, 2), and the log prior of each, (g,).

    The ratios are ``B²/N²``, Hz, and ``K²/N²``, Hz². N, B and K are the coefficients of white
    noise, flicker and random walk. The record has the `span` S and windows of `length` τ, s. A mode
    of the record is a wave that has k half waves in S; k goes from 1 to S/τ. In mode k, white noise
    has the variance ``N²/τ``, flicker has ``B² S/(π k τ)``, and random walk ``K² S²/(π² k² τ)``.

    Each ratio takes the value zero, with its prior probability in `ABSENT`, and values between two
    limits, with a prior that is uniform in the logarithm. At the lower limit, the variance of
    flicker or random walk is half that of white noise in the slowest mode. At the upper limit, it
    is at least thirty times that of white noise in the middle mode.
    """
    axes, priors = [], []
    for power, absent in zip((1, 2), ABSENT, strict=True):
        # least ratio, from the slowest mode, and largest ratio, from the middle mode
        low, high = 0.5 * (np.pi / span) ** power, 30 * (0.5 * np.pi / length) ** power
        count = max(2, int(np.ceil(np.log(high / low) / np.log(STEP))) + 1)
        axes.append(np.concatenate([[0.0], low * STEP ** np.arange(count)]))
        priors.append(np.concatenate([[absent], np.full(count, (1 - absent) / count)]))
    flicker, walk = np.meshgrid(*axes, indexing="ij")
    grid = np.column_stack([flicker.ravel(), walk.ravel()])
    return grid, np.log(np.outer(*priors)).ravel()


def hypotheses(windows, grid):
    """Return the Hypotheses of the means over n windows: g covariances of their noise.

    `windows`, (n, 2), are start and end of each window, s. `grid`, (g, 2), has for each covariance
    the ratios ``B²/N²``, Hz, and ``K²/N²``, Hz², of flicker and of random walk to white noise.
    White noise has N = 1.
    """
    one = Coefficient(1.0)
    white, flicker, walk = (AxisNoise(**{n: one}).mean_covariance(windows) for n in "NBK")
    return Hypotheses.of(white + b * flicker + k * walk for b, k in grid)


def fitted_effects(search, effects):
    """Return the parameters of some `effects` of static records, a tuple of FittedEffect, or None.

    The effects are fitted together to all rows. The result is None if the rows of an axis do not
    determine the parameters. `search` is the Search of the records.
    """
    training_fit, estimates = search.training_fit(effects), []
    evidence = training_fit.evidence
    for axis in range(evidence.axes):
        index, scale = evidence.parameters_of(effects, axis)
        if not len(index):
            continue
        coefficients, covariance = training_fit.estimate(effects, axis)
        if coefficients is None:
            return None
        estimates.append((index, coefficients / scale, covariance / np.outer(scale, scale)))
    ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
    values, covariance = combine_axes(ends[-1], estimates)
    std, fitted = np.sqrt(np.diag(covariance)), []
    for effect, (i, j) in zip(effects, pairwise(ends), strict=True):
        by_name, std_by_name = (
            dict(zip(effect.parameters, x[i:j].tolist(), strict=True)) for x in (values, std)
        )
        fitted.append(FittedEffect(effect, by_name, std_by_name))
    return tuple(fitted)


def information(search, base, effects):
    """Return the knowledge of static records about q parameters θ of some effects, A and b.

    They are a prior of θ for the fit of the poses. Each is a sum over the axes. An axis with the
    rows y adds ``Dᵀ P̃ D/κ`` to A and ``Dᵀ P̃ y/κ`` to b. D is the derivative of the rows with
    respect to θ, and P̃ is the precision of the noise after the levels of the records are projected
    out. κ is a factor on the variance: it makes the errors as large as the errors of a fit of the
    effects to the records. It is computed for each column d of D, as the ratio of ``dᵀ P̃ Σ P̃ d``
    to ``dᵀ P̃ d``, and the largest value is used. Σ is the noise covariance averaged over the noise
    hypotheses, the covariances that the noise may have.

    Parameters
    ----------
    search : Search
        The search in the records.
    base : tuple of Effect
        Effects that the records have. Those that are not in `effects` are nuisance parameters.
    effects : tuple of Effect
        The effects with the parameters θ.

    Returns
    -------
    ndarray, shape (q, q), and ndarray, shape (q,)
        Fisher information A and moment b, SI: the logarithm of the likelihood of θ is
        ``-θᵀ A θ/2 + bᵀ θ``. Parameters that the records do not show have zeros.
    """
    nuisances = tuple(e for e in base if e not in effects)
    training_fit, q = search.training_fit(base), sum(len(e.parameters) for e in effects)
    evidence = training_fit.evidence
    design = np.concatenate([p.design for p in evidence.patterns((*effects, *nuisances))], axis=2)
    # columns of length one: parameters have different units
    size = np.linalg.norm(design.reshape(-1, design.shape[2]), axis=0)
    size[size == 0] = 1.0
    precision, moment = np.zeros((len(size),) * 2), np.zeros(len(size))
    values = search.problem.values
    for axis in range(evidence.axes):
        fit = training_fit.fit(base, axis)
        columns = np.column_stack([design[:, axis] / size, values[:, axis]])
        products, variance = training_fit.moments(fit, columns)
        # the last column has the values
        square, variance = np.diag(products)[:-1], np.diag(variance)[:-1]
        shown = square > ABSORBED * square.max()
        if shown.any():
            products = products / np.max(variance[shown] / square[shown])
            precision, moment = precision + products[:-1, :-1], moment + products[:-1, -1]
    # the nuisance parameters are eliminated
    inverse = np.linalg.pinv(precision[q:, q:], rcond=ABSORBED, hermitian=True)
    share = precision[:q, q:] @ inverse
    A = precision[:q, :q] - share @ precision[q:, :q]
    b = moment[:q] - share @ moment[q:]
    return A * np.outer(size[:q], size[:q]), b * size[:q]


def cut_at_tilts(records, least):
    """Return the StaticRecords of an accelerometer, cut where a disturbance tilted the device.

    Each of the `records` has the means over windows of one rest, which a disturbance may interrupt.
    A tilt changes the means of an accelerometer, but it is not an effect of the sensor. A
    disturbance counts as a tilt if the means before and after it differ by more than the noise,
    slow noise included, but have the same magnitude of gravity. A piece, what lies between two
    cuts, is left out if it has fewer than `least` windows.
    """
    steps = [Steps((t,), (r.session,)) for r in records for t in _disturbances(r)]
    if not steps:
        return list(records)
    problem = StaticProblem(
        records=records,
        variants={},
        settings=DiagnoseSettings(significance=MOVED),
        tests=len(steps),
    )
    # the most significant step is added, then the next, until no further step is significant
    search, significant = Search(problem, held_out=frozenset()), ()
    while True:
        trials = search.tests(significant, [s for s in steps if s not in significant])
        best = min((t for t in trials if t), key=lambda t: t.log_p, default=None)
        if best is None or best.log_p >= search.threshold(len(significant)):
            break
        significant = (*significant, best.effect)
    jumps, pieces = fitted_effects(search, significant), []
    for record in records:
        starts, cuts, last = record.windows[:, 0], [], -np.inf
        in_record = [jump for jump in jumps if jump.effect.sessions == (record.session,)]
        for jump in sorted(in_record, key=lambda jump: jump.effect.times):
            (t,) = jump.effect.times
            before = (starts >= last) & (starts < t)
            if is_tilt(jump, record.values[before].mean(axis=0)):
                cuts.append(t)
            last = t
        piece = np.searchsorted(cuts, starts, side="right")
        pieces += [record.part(piece == k) for k in np.unique(piece)]
    return [piece for piece in pieces if len(piece.windows) >= least]


def is_tilt(jump, level):
    """Return whether a jump of specific force may be a tilt, which keeps the magnitude.

    `jump` is the FittedEffect of the jump h, and `level` the specific force f before it, (3,),
    m/s^2. ``|f + h| = |f|`` if ``u·h + |h|²/2|f|`` is zero, with the direction u of f. The jump
    counts as a tilt if this term is within three standard errors of zero. So a jump along gravity
    is not a tilt.
    """
    h, std = (np.array(list(v.values())) for v in (jump.values, jump.std))
    size = np.linalg.norm(level)
    along = level @ h / size + h @ h / (2 * size)
    return bool(abs(along) <= 3 * np.linalg.norm(level / size * std))


def _disturbances(record):
    """Return the times of the disturbances of a `record`, s, a list of float.

    The windows of a record lie in undisturbed stretches of a rest. A disturbance, between two
    stretches, counts if there are at least `BESIDE` windows in the stretch before it and in the one
    after it. Its time is the start of the first window after it.
    """
    first = np.flatnonzero(np.diff(record.stretch)) + 1
    sizes = np.diff(np.concatenate([[0], first, [len(record.windows)]]))
    enough = (sizes[:-1] >= BESIDE) & (sizes[1:] >= BESIDE)
    return record.windows[first[enough], 0].tolist()
