"""The problem of the poses of a device and the rotations between them: rows, folds and noise."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from imuloop.diagnose.records.linearization import (
    Linearization,
    kind_hypotheses,
    split_by_effect,
)
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.steps import Steps
from imuloop.estimate.evidence import Evidence, Hypotheses, RowGroup
from imuloop.estimate.noise_components import SizeLikelihood, likely_sizes, total_covariance
from imuloop.estimate.training_fit import ABSORBED
from imuloop.factors.factors import OF_SENSOR

# alternatives of the noise: steps from the sizes as estimated to the likeliest sizes
PATH = (0.0, 0.3, 0.6, 1.0)
# rise of the log likelihood at which the estimate of the noise for a detection limit ends
ROUGH = 0.05
# number of effects whose derivatives are computed at once
BATCH_SIZE = 32


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """The poses of a device, as a problem for `imuloop.estimate.choice.Choices`.

    A row is one component of a residual of a pose or of a rotation between two poses. All N rows
    are one group, since their noise is correlated; the last ones are rows of a prior from other
    records. The nuisance parameters are the base model and the effects that other records showed.
    """

    joint_fit: object  # JointFit
    recording: object  # Recording
    variants: dict  # variants to try, a tuple for each kind of effect
    settings: DiagnoseSettings
    tests: int  # number of tests that share the significance
    # (n,): fold of each pose, or of each move in a MotionProblem; -1 is no fold
    fold_of_pose: np.ndarray
    nuisance_effects: tuple = ()  # effects that other records showed; every fit estimates them
    # function that takes effects and returns the Fisher information of other records about θ,
    # their parameters: A and b, the logarithm of whose likelihood is ``-θᵀ A θ/2 + bᵀ θ``
    information: object = None
    # prior of the parameters x of the base model: R and z; ``R x - z`` has mean 0 and variance 1
    base_rows: tuple = (np.zeros((0, 0)), np.zeros(0))
    # for kinds of effects with too many variants for a list: the function that finds the best one
    scans: dict = field(default_factory=dict)
    _fits: dict = field(default_factory=dict, repr=False)
    _columns: dict = field(default_factory=dict, repr=False)
    # whether a scan is repeated when the base has grown: turns show the steps of both sensors
    scans_again = True
    error_scale = 1.0  # unit of the held-out errors in the error ratio

    @cached_property
    def folds(self):
        """Number of folds."""
        return int(self.fold_of_pose.max()) + 1

    @cached_property
    def prior_rows(self):
        """Rows ``R θ - z``, with mean 0 and variance 1, that add prior knowledge to each fit.

        θ are the q parameters of an effect. The value is a dict of R, (k, q), by effect, and z,
        (k,). The first of the k rows are the prior of the base model, where R is zero. The others
        hold what other records tell about the effects: for their Fisher information A and moment b,
        ``Rᵀ R = A`` and ``Rᵀ z = b``.
        """
        z_of_base = self.base_rows[1]
        if self.information is None:
            return {}, z_of_base
        # static records have too few attitudes to show formulas
        named = (variants for kind, variants in self.variants.items() if not kind.is_formula)
        effects = self.nuisance_effects + tuple(
            s for variants in named for s in variants if "temperature" in s.needs and not s.timed
        )
        if not effects:
            return {}, z_of_base
        information, moment = self.information(effects)
        # parameters have different units: each is scaled so that its information is one
        size = np.sqrt(np.maximum(np.diag(information), 0.0))
        size[size == 0] = 1.0
        # one row for each direction about which there is information
        values, axes = np.linalg.eigh(information / np.outer(size, size))
        shown = values > ABSORBED * max(values.max(initial=0.0), ABSORBED)
        roots, axes = np.sqrt(values[shown]), axes[:, shown].T
        rows = np.pad(roots[:, None] * axes * size, ((len(z_of_base), 0), (0, 0)))
        return split_by_effect(rows, effects), np.append(z_of_base, axes @ (moment / size) / roots)

    @cached_property
    def rows(self):
        """Indices of the first and last pose of each row, (n, 2), and kind of each row, (N,).

        The row of a pose has this pose twice; the row of a move has the poses at its ends. The kind
        is the kind of residual. The N - n last rows come from the prior: they have no pose, and
        their kind is an empty string.
        """
        ends, kind = self.joint_fit.rows(self.recording)
        return ends, np.append(kind, np.full(len(self.prior_rows[1]), ""))

    @cached_property
    def row_folds(self):
        """Folds of the first and of the last pose of each row, (N, 2); -1 for the prior's rows."""
        folds = self.fold_of_pose[self.rows[0]]
        return np.concatenate([folds, np.full((len(self.prior_rows[1]), 2), -1)])

    @property
    def fold_of_row(self):
        """Fold that each row is held out with, (N,): the fold of its first pose."""
        return self.row_folds[:, 0]

    def residuals(self, search, effects):
        """Return the residuals of all rows, (N, 1), by a fit of effects to the training rows.

        `search` is the Search that has these training rows. Held-out rows next to a step are nan:
        the training rows tell the time of a step only to within two of their poses.
        """
        residuals = search.training_fit(effects).residuals(effects, 0)
        for effect in effects:
            if effect.name == Steps.name:
                residuals[self._rows_next_to_step(effect, search.held_out)] = np.nan
        return residuals[:, None]

    def _rows_next_to_step(self, effect, held_out):
        """Return the indices of the held-out rows next to a step, the SensorEffect `effect`.

        The training poses know the time of a step only to the interval between the last of them
        before it and the first of them after it. A held-out pose in that interval may lie on either
        side of the step, so the rows that depend on it cannot be predicted. `held_out` has the
        numbers of the held-out folds.
        """
        is_held_out, poses_of_row = np.isin(self.fold_of_pose, list(held_out)), self.rows[0]
        after = self.recording.poses.mid_s > effect.effect.times[0]
        # training poses on either side of the step, and the held-out poses between them
        number = np.arange(len(after))
        last = number[~is_held_out & ~after].max(initial=-1)
        first = number[~is_held_out & after].min(initial=len(after))
        poses = number[is_held_out & (number > last) & (number < first)]
        # the kinds of residual that depend on this sensor; both sensors enter a rotation
        kinds = {"rotation", *OF_SENSOR[effect.sensor]}.intersection(self.joint_fit.kinds)
        of_sensor = sum(self.of_kind(kind) for kind in kinds)[: len(poses_of_row)]
        return np.flatnonzero(of_sensor & np.isin(poses_of_row, poses).any(axis=1))

    def of_kind(self, kind):
        """Return the rows of one kind of residual, (N,) of bool."""
        return self.rows[1] == kind

    def rows_by_kind(self):
        """Return a list with the rows of each kind of residual, (N,) of bool."""
        return [self.of_kind(kind) for kind in self.joint_fit.kinds]

    def components(self, kind):
        """Return the number of rows of one residual."""
        return self.joint_fit.kinds[kind][1]

    def with_folds(self, fold_of_pose):
        """Return the PoseProblem with other folds of the poses, (n,)."""
        problem = replace(self, fold_of_pose=fold_of_pose, _fits={})
        for effects, linearization in self._fits.items():
            evidence = linearization.evidence.with_folds(problem.row_folds)
            problem._fits[effects] = replace(linearization, evidence=evidence)
        return problem

    def with_formulas(self, formulas):
        """Return the PoseProblem with more variants to try, which it tries after all others.

        `formulas` has a tuple of variants, which are products of powers without a known cause, for
        each kind of effect.
        """
        # the new problem shares the stored fits and derivatives; each kind is one more test
        count = self.tests + self.settings.family * len(formulas)
        return replace(self, variants=self.variants | formulas, tests=count)

    def linearization(self, effects=()):
        """Return the Linearization at the fit of all poses with some effects; it is stored."""
        if effects not in self._fits:
            self._fits[effects] = self._linearize(effects)
        return self._fits[effects]

    def _linearize(self, effects):
        """Fit all poses with some effects and return the Linearization there."""
        fitted_effects = (*self.nuisance_effects, *effects)
        # effects are added one by one: the fit without the last one is near
        start = self.linearization(effects[:-1]).solution.x if effects else None
        R, z = self._prior_rows_of(fitted_effects), self.prior_rows[1]
        # rows of the prior by all p parameters: the base model's columns, then the effects'
        R_base = self.base_rows[0].reshape(-1, len(self.joint_fit.names))
        R = np.hstack([np.pad(R_base, ((0, len(z) - len(R_base)), (0, 0))), R])
        solution = self.joint_fit.fit(self.recording, fitted_effects, start, (R, z))
        factors = self.joint_fit.linearise(solution, self.recording)
        values = np.append(factors.residual, R @ solution.x - z)
        jacobian = np.concatenate([factors.jacobian, R])
        fixed, slow, excess = self.joint_fit.noise_components(factors, len(z))
        likelihood = SizeLikelihood(jacobian, fixed, [*slow, *excess])
        likeliest = likelihood.maximise(values)
        # alternatives for the verdict: slow noise between the sizes as estimated and the likeliest
        estimated = np.array([component.size for component in slow])
        change = likely_sizes(values, jacobian, fixed, slow) - estimated
        distance = change / [component.deviation for component in slow]
        log_prior = np.array([-distance @ distance * share**2 / 2 for share in PATH])
        covariances = [total_covariance(fixed, slow, estimated + share * change) for share in PATH]
        hypotheses, as_estimated = kind_hypotheses([*slow, *excess], likelihood, likeliest)
        evidence = self._evidence(effects, values, jacobian, hypotheses, as_estimated)
        return Linearization(
            solution=solution,
            factors=factors,
            values=values,
            jacobian=jacobian,
            log_prior=log_prior,
            covariances=covariances,
            evidence=evidence,
            likelihood=likelihood,
            likeliest=likeliest,
        )

    def _evidence(self, effects, values, jacobian, hypotheses, as_estimated):
        """Return the Evidence of the rows at the fit of all poses with some effects.

        Parameters
        ----------
        effects : tuple of SensorEffect
        values : ndarray, shape (N,)
            Residuals of the fit.
        jacobian : ndarray, shape (N, p)
            Their derivative with respect to the parameters of the fit; those of the effects are
            last.
        hypotheses : Hypotheses
            The h covariances that the noise may have, which are equally probable.
        as_estimated : ndarray, shape (h,) of bool
            Those that have the noise as estimated.

        Returns
        -------
        Evidence
            Its one group has all rows. Its nuisance parameters are those of the fit without
            `effects`.
        """
        nuisances = jacobian.shape[1] - sum(len(e.parameters) for e in effects)
        patterns = split_by_effect(jacobian[:, None, nuisances:], effects)

        def designs(variants):
            """Return the derivative of all rows by the parameters of each variant, (N, 1, q)."""
            new_patterns = self.patterns(
                [variant for variant in variants if variant not in patterns]
            )
            return [(patterns | new_patterns)[variant] for variant in variants]

        group = RowGroup(
            values=-values[:, None],
            nuisance=jacobian[:, :nuisances],
            noise=hypotheses,
            row_folds=self.row_folds,
        )
        log_prior = np.full(len(as_estimated), -np.log(len(as_estimated)))
        # the size of the noise is known, so that a small χ² does not make errors smaller
        return Evidence(
            [group], log_prior, designs, least_scale=1.0, as_estimated_mask=as_estimated
        )

    def _prior_rows_of(self, effects):
        """Return the derivative R of the k rows of the prior by the parameters of effects, (k, q).

        It is zero for an effect of which the prior tells nothing.
        """
        R_by_effect, z = self.prior_rows
        rows = (R_by_effect.get(e, np.zeros((len(z), len(e.parameters)))) for e in effects)
        return np.hstack([np.zeros((len(z), 0)), *rows])

    def patterns(self, effects):
        """Return the derivatives of all N rows by the q parameters of effects, (N, 1, q) each.

        The result is a dict by effect. The derivatives are taken at the fit without effects, and
        stored. The rows of other records are the last ones.
        """
        new = [e for e in effects if e not in self._columns]
        factors = self.linearization(()).factors
        for first in range(0, len(new), BATCH_SIZE):
            batch = new[first : first + BATCH_SIZE]
            columns = np.concatenate([factors.columns(batch), self._prior_rows_of(batch)])
            self._columns.update(split_by_effect(columns[:, None], batch))
        return {effect: self._columns[effect] for effect in effects}

    def nearest_linearization(self, effects):
        """Return the stored Linearization that has the most of some effects and no others.

        The rows are taken as linear in the remaining effects, by their derivatives in its Evidence.
        So effects that only a search without one fold chose need no new fit of all poses.
        """
        subsets = [stored for stored in self._fits if set(stored) <= set(effects)]
        return self.linearization(max(subsets, key=len, default=()))

    def training_fit(self, base, held_out):
        """Return the TrainingFit, the least-squares fit of the rows without the folds `held_out`.

        Its rows are linearised at a fit with the effects in `base`, which are in the model already.
        """
        return self.nearest_linearization(base).evidence.training_fit(held_out)

    def is_like_slow_noise(self, effect):
        """Return whether an effect changes as slowly as slow noise, which may then hide it."""
        return effect.timed or "temperature" in effect.needs

    def noise_with(self, base, values):
        """Return the Hypotheses of the one group of rows if its residuals were `values`, (N,).

        They are the noise as estimated, and the noise that is most likely for these residuals.
        `base` has the effects in the model.
        """
        linearization = self.nearest_linearization(base)
        likelihood = linearization.likelihood
        likeliest = likelihood.maximise(-values, linearization.likeliest, ROUGH)
        squares = likelihood.prior_sizes**2, likeliest**2
        return [Hypotheses.of(map(likelihood.covariance, squares))]

    def refit(self, effects):
        """Fit all poses with some effects; later tests are linearised at this fit."""
        self.linearization(effects)

    def most_changed_rows(self, search, base, trial):
        """Return the kind of residual that a trial changes most, and its rows, (N,) of bool.

        Changes are compared in standard deviations of the noise. `base` has the effects that are in
        the model already.
        """
        training_fit = search.training_fit(base)
        extended = (*base, trial.effect)
        change = training_fit.residuals(base, 0) - training_fit.residuals(extended, 0)
        # the first covariance is that of the noise as estimated
        variance = np.diag(self.nearest_linearization(base).covariances[0])
        by_kind = [rows & (self.fold_of_row >= 0) for rows in self.rows_by_kind()]
        size = [(change[rows] ** 2 / variance[rows]).sum() for rows in by_kind]
        kind = list(self.joint_fit.kinds)[int(np.argmax(size))]
        return kind, self.of_kind(kind)

    def covariance(self, effects):
        """Return the covariance of the p parameters of the fit of all poses, (p, p), nominal SI.

        It is the average over the noise hypotheses, the covariances that the noise may have,
        weighted by their probability. The covariance under one hypothesis is that of generalised
        least squares, times the reduced χ² if that is above one, plus the square of the difference
        between the solution under this hypothesis and the fit. The constants of the effects, such
        as time constants, are uncertain too: their logarithms count as further parameters with a
        prior standard deviation of one.
        """
        linearization = self.linearization(effects)
        evidence, jacobian = linearization.evidence, linearization.jacobian
        fit, p = evidence.training_fit().fit(effects, 0), jacobian.shape[1]
        of_constants = self._constant_derivatives(effects, linearization.solution.x)
        sum_of_squares, design = 0.0, np.column_stack([jacobian, *of_constants])
        # columns of length one: parameters have different units
        size = np.linalg.norm(design, axis=0)
        size[size == 0] = 1.0
        design, prior = design / size, np.diag(size**-2.0 * (np.arange(len(size)) >= p))
        probable, of_prior = fit.probability > 1e-6, self.rows[1] == ""
        for h in np.flatnonzero(probable):
            # the rows of the prior keep their variance, independent of the residuals of the poses
            scale = np.where(of_prior, 1.0, fit.scale[h])
            weighted = (design.T / scale) @ evidence.row_groups[0].noise.precision[h]
            inverse = np.linalg.inv(weighted @ design + prior / fit.scale[h])
            change = inverse @ (weighted @ linearization.values)
            square = inverse + np.outer(change, change)
            sum_of_squares = sum_of_squares + fit.probability[h] * square
        covariance = sum_of_squares / fit.probability[probable].sum() / np.outer(size, size)
        return covariance[:p, :p]

    def _constant_derivatives(self, effects, x):
        """Return the derivatives of all rows by the logarithm of the constants, (N,) each, a list.

        There is one for each effect with a constant, such as a time constant, that a fit refines;
        it is the difference quotient for a factor of 1.05. `x`, (p,), are the parameters of the fit
        with these effects.
        """
        derivatives, first = [], len(self.joint_fit.names)
        parameters = split_by_effect(x[first:], (*self.nuisance_effects, *effects))
        for effect, values in parameters.items():
            # an effect without such a constant is the same after a change
            if effect.moved(2.0) != effect:
                variants = [effect.moved(f) for f in (1.05, 1 / 1.05)]
                up, down = (design[:, 0] @ values for design in self.patterns(variants).values())
                derivatives.append((up - down) / (2 * np.log(1.05)))
        return derivatives

    def why_no_trial(self, search, kind):
        """Return the reason, text, why a kind of effect could not be tested.

        `search` is the Search that tried it.
        """
        rows = search.training_fit(()).free_rows
        variants = self.variants.get(kind) or (kind.cls(),)
        least = min(len(variant.parameters) for variant in variants)
        if rows <= least:
            return f"{rows} residuals to spare do not determine {least} more parameters"
        return "what it adds in these data is taken up by the base model"

    def fit(self, effects, held_out=frozenset()):
        """Return the Fit with some effects to the rows without the folds in `held_out`.

        It is the fit of all poses plus the linear change that the remaining rows give. Its
        covariance is zero, since it is not used.
        """
        solution, first = self.nearest_linearization(effects).solution, len(self.joint_fit.names)
        (nuisance_change,), changes = self.training_fit(effects, held_out).parameters(effects, 0)
        x = solution.x.copy()
        # the nuisance parameters: the base model and the effects that other records showed
        x[: len(nuisance_change)] += nuisance_change
        parameters = split_by_effect(x[first:], solution.effects)
        for effect, change in changes.items():
            # the fit of all poses may lack an effect: its parameters then start at zero
            parameters[effect] = parameters.get(effect, 0.0) + change
        all_effects = (*self.nuisance_effects, *effects)
        x = np.concatenate([x[:first], *(parameters[e] for e in all_effects)])
        return replace(solution, effects=all_effects, x=x, covariance=np.zeros((len(x),) * 2))


def interleaved_folds(count, folds):
    """Return the fold of each of `count` poses, (count,), with neighbours in different folds.

    So the poses before and after predict a held-out pose. If there are at most four `folds`, two
    neighbours share a fold: else too few neighbours would remain without it and a second fold.
    """
    folds = min(folds, count)
    return np.arange(count) // (1 if folds > 4 else 2) % folds
