"""The problem of the poses of a device and the rotations between them: rows, folds and noise."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from imuloop.core.precision import precision
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.steps import Steps
from imuloop.estimate.evidence import Evidence, Hypotheses, RowGroup
from imuloop.estimate.noise_components import SizeLikelihood, likely_sizes, total
from imuloop.estimate.training_fit import ABSORBED
from imuloop.factors.factors import OF_SENSOR

# alternatives of the noise: steps from the sizes as estimated to the likeliest sizes
PATH = (0.0, 0.3, 0.6, 1.0)
# rise of the log likelihood at which the estimate of the noise for a detection limit ends
ROUGH = 0.05
# number of effects whose derivatives are computed at once
BATCH_SIZE = 32


@dataclass(frozen=True)
class Linearization:
    """The rows, linearised at the fit of all poses with some effects."""

    solution: object  # the Fit
    at: object  # Linearised factors at its parameters
    values: np.ndarray  # (N,): residuals
    jacobian: np.ndarray  # (N, p): derivative with respect to the parameters
    # alternatives of the noise, from the sizes as estimated to the likeliest ones: logarithm of
    # the prior probability, and covariance, (N, N)
    alternatives: list
    evidence: Evidence  # Evidence of the rows
    noise_with: object  # takes residuals, (N,); returns Hypotheses with the noise likeliest there


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """The poses of a device, as a problem for `imuloop.estimate.choice.Choices`.

    A row is one component of a residual of a pose or of a rotation between two poses. All N rows
    are one group, since their noise is correlated; the last ones are rows of a prior from other
    records. The nuisance parameters are the base model and the given effects.
    """

    sensor: object  # JointFit
    recording: object  # Recording
    shapes: dict  # shapes to try, a tuple for each kind of effect
    settings: DiagnoseSettings
    tests: int  # number of tests that share the significance
    # (n,): fold of each pose, or of each move in a MotionProblem; -1 is no fold
    fold_of_pose: np.ndarray
    given_effects: tuple = ()  # effects that other records showed; every fit estimates them
    # takes effects; returns the information of other records about them, as `static.information`
    information: object = None
    # prior of the base model: rows R and z, ``R x - z`` has variance one
    base_rows: tuple = (np.zeros((0, 0)), np.zeros(0))
    # for kinds of effects with too many shapes for a list: the function that finds the best one
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
        """Rows ``R θ - z`` of the prior, with variance one: R by effect, (k, q), and z, (k,).

        θ are the q parameters of the effect. The k rows are those of the base model's prior, where
        R is zero, and then those of the information from other records.
        """
        of_base = self.base_rows[1]
        if self.information is None:
            return {}, of_base
        # static records have too few attitudes to show formulas
        shapes = (s for kind, own in self.shapes.items() for s in own if not kind.is_formula)
        effects = self.given_effects
        effects += tuple(s for s in shapes if "temperature" in s.needs and not s.timed)
        if not effects:
            return {}, of_base
        information, moment = self.information(effects)
        size = np.sqrt(np.maximum(np.diag(information), 0.0))
        size[size == 0] = 1.0
        values, axes = np.linalg.eigh(information / np.outer(size, size))
        shown = values > ABSORBED * max(values.max(initial=0.0), ABSORBED)
        roots, axes = np.sqrt(values[shown]), axes[:, shown].T
        rows = np.pad(roots[:, None] * axes * size, ((len(of_base), 0), (0, 0)))
        return by_effect(rows, effects), np.append(of_base, axes @ (moment / size) / roots)

    @cached_property
    def rows(self):
        """Indices of the first and last pose of each row, (n, 2), and kind of each row, (N,).

        The N - n last rows are those of the prior; their kind is an empty string.
        """
        ends, kind = self.sensor.rows(self.recording)
        return ends, np.append(kind, np.full(len(self.prior_rows[1]), ""))

    @cached_property
    def row_folds(self):
        """Folds of each row, (N, 2), as in `RowGroup`: of its first pose and of its last pose."""
        folds = self.fold_of_pose[self.rows[0]]
        return np.concatenate([folds, np.full((len(self.prior_rows[1]), 2), -1)])

    @property
    def fold_of_row(self):
        """Fold that each row is held out with, (N,): the fold of its first pose."""
        return self.row_folds[:, 0]

    def residuals(self, search, base):
        """Return the residuals of all rows, (N, 1), by a fit of effects to the training rows.

        Held-out rows next to a step are nan: the training rows tell the time of a step only to
        within two of their poses.
        """
        residuals = search.training_fit(base).residuals(base, 0)
        for effect in base:
            if effect.name == Steps.name:
                residuals[self._rows_next_to_step(effect, search.held_out)] = np.nan
        return residuals[:, None]

    def _rows_next_to_step(self, effect, held_out):
        """Return the indices of the held-out rows next to a step.

        The training poses know the time of a step only to the interval between the last of them
        before it and the first of them after it. A held-out pose in that interval may lie on either
        side of the step, so nobody can predict the rows that depend on it. `held_out` has the
        numbers of the held-out folds.
        """
        held, poses_of_row = np.isin(self.fold_of_pose, list(held_out)), self.rows[0]
        after = self.recording.poses.mid_s > effect.effect.times[0]
        number = np.arange(len(held))
        last = number[~held & ~after].max(initial=-1)
        first = number[~held & after].min(initial=len(held))
        poses = number[held & (number > last) & (number < first)]
        kinds = {"rotation", *OF_SENSOR[effect.sensor]}.intersection(self.sensor.kinds)
        of_sensor = sum(self.of_kind(kind) for kind in kinds)[: len(poses_of_row)]
        return np.flatnonzero(of_sensor & np.isin(poses_of_row, poses).any(axis=1))

    def of_kind(self, kind):
        """Return the rows of one kind of residual, (N,) of bool."""
        return self.rows[1] == kind

    def rows_by_kind(self):
        """Return a list with the rows of each kind of residual, (N,) of bool."""
        return [self.of_kind(kind) for kind in self.sensor.kinds]

    def components(self, kind):
        """Return the number of rows of one residual."""
        return self.sensor.kinds[kind][1]

    def linearization(self, base=()):
        """Return the Linearization at the fit of all poses with the base effects."""
        if base not in self._fits:
            self._fits[base] = self._linearize(base)
        return self._fits[base]

    def with_folds(self, fold_of_pose):
        """Return the PoseProblem with other folds of the poses, (n,)."""
        problem = replace(self, fold_of_pose=fold_of_pose, _fits={})
        for base, about in self._fits.items():
            evidence = about.evidence.with_folds(problem.row_folds)
            problem._fits[base] = replace(about, evidence=evidence)
        return problem

    def _linearize(self, base):
        """Fit all poses with the base effects and return the Linearization there."""
        effects, count = (*self.given_effects, *base), len(self.sensor.names)
        start = self.linearization(base[:-1]).solution.x if base else None
        _, z = self.prior_rows
        known = np.hstack([self._known_base(), self._known_effects(effects)])
        solution = self.sensor.fit(self.recording, effects, start, (known, z))
        x = solution.x
        at = self.sensor.linearise(solution, self.recording)
        values = np.append(at.residual, known @ x - z)
        jacobian = np.concatenate([at.jacobian, known])
        nuisances = count + sum(len(e.parameters) for e in self.given_effects)
        own = by_effect(jacobian[:, None, nuisances:], base)
        covariance, slow, missing = self.sensor.noise_components(at, len(z))
        components = [*slow, *missing]
        estimated, first = (np.array([c.size for c in each]) for each in (slow, components))
        likelihood = SizeLikelihood(jacobian, covariance, components)
        likeliest = likelihood.maximise(values, likelihood.projection())
        kinds, number = np.unique([c.kind for c in components], return_inverse=True)
        # Hypotheses: the sizes of one kind of residual are likeliest and those of the others as
        # estimated, or the reverse. The first has all sizes as estimated, the last all likeliest.
        one = np.eye(len(kinds), dtype=bool)
        chosen = np.unique(np.vstack([0 * one, one, ~one, 0 * one == 0]), axis=0)[:, number]

        noisy = likely_sizes(values, jacobian, covariance, slow)
        off = (noisy - estimated) / [component.deviation for component in slow]
        alternatives = [
            (-off @ off * s**2 / 2, total(covariance, slow, estimated + s * (noisy - estimated)))
            for s in PATH
        ]

        def hypotheses(chosen, likeliest):
            """Return the Hypotheses that take the `likeliest` size of some components, (h, k).

            `chosen`, (h, k) of bool, are these components; the others have the size as estimated.
            """
            sizes = np.where(chosen, likeliest, first)
            return Hypotheses.of(precision(total(covariance, components, own)) for own in sizes)

        def noise_with(values):
            """Return two Hypotheses: the noise as estimated, and the likeliest for `values`."""
            start = likelihood.projection(likeliest)
            return hypotheses(chosen[[0, -1]], likelihood.maximise(values, start, ROUGH))

        noise = hypotheses(chosen, likeliest)
        rows = RowGroup(-values[:, None], jacobian[:, :nuisances], noise, self.row_folds)

        def designs(effects):
            more = self.patterns([effect for effect in effects if effect not in own])
            return [(own | more)[effect] for effect in effects]

        prior, plain = np.full(len(chosen), -np.log(len(chosen))), ~chosen.any(axis=1)
        evidence = Evidence([rows], prior, designs, least=1.0, as_estimated_mask=plain)
        return Linearization(solution, at, values, jacobian, alternatives, evidence, noise_with)

    def _known_base(self):
        """Return the prior rows R for the parameters of the base model, (k, p)."""
        own = self.base_rows[0].reshape(-1, len(self.sensor.names))
        return np.pad(own, ((0, len(self.prior_rows[1]) - len(own)), (0, 0)))

    def _known_effects(self, effects):
        """Return the prior rows R for the q parameters of some effects, (k, q)."""
        of_effects, z = self.prior_rows
        rows = (of_effects.get(e, np.zeros((len(z), len(e.parameters)))) for e in effects)
        return np.hstack([np.zeros((len(z), 0)), *rows])

    def with_formulas(self, formulas):
        """Return the problem with more shapes, by kind, that are tried after all others."""
        # both problems share `_columns` and the linearisations
        count = self.tests + self.settings.family * len(formulas)
        return replace(self, shapes=self.shapes | formulas, tests=count)

    def patterns(self, effects):
        """Return the derivatives of all N rows by the q parameters of effects, (N, 1, q) each.

        The result is a dict by effect. The derivatives are taken at the fit without effects, and
        stored. The rows of other records are the last ones.
        """
        new = [e for e in effects if e not in self._columns]
        base_model = self.linearization(()).at
        for first in range(0, len(new), BATCH_SIZE):
            batch = new[first : first + BATCH_SIZE]
            columns = np.concatenate([base_model.columns(batch), self._known_effects(batch)])
            self._columns.update(by_effect(columns[:, None], batch))
        return {effect: self._columns[effect] for effect in effects}

    def nearest_linearization(self, base):
        """Return the stored Linearization that has the most effects of the base and no others.

        The other effects of the base are patterns in its Evidence. So effects that only a search
        without one fold chose need no new fit of all poses.
        """
        made = [b for b in self._fits if set(b) <= set(base)]
        return self.linearization(max(made, key=len, default=()))

    def training_fit(self, base, held_out):
        """Return the TrainingFit without some folds, linearised with effects of the base."""
        return self.nearest_linearization(base).evidence.training_fit(held_out)

    def is_like_slow_noise(self, effect):
        """Return whether an effect changes as slowly as slow noise, which may then hide it."""
        return effect.timed or "temperature" in effect.needs

    def noise_with(self, base, values):
        """Return the Hypotheses of each group of rows if its residuals were `values`, (N,)."""
        return [self.nearest_linearization(base).noise_with(-values)]

    def refit(self, base):
        """Fit all poses with the base effects; later tests are linearised at this fit."""
        self.linearization(base)

    def most_changed_rows(self, search, base, trial):
        """Return the kind of residual that a trial changes most, and its rows, (N,) of bool.

        Changes are compared in standard deviations of the noise.
        """
        training_fit = search.training_fit(base)
        wider = (*base, trial.effect)
        change = training_fit.residuals(base, 0) - training_fit.residuals(wider, 0)
        variance = np.diag(self.nearest_linearization(base).alternatives[0][1])
        by_kind = [rows & (self.fold_of_row >= 0) for rows in self.rows_by_kind()]
        size = [(change[rows] ** 2 / variance[rows]).sum() for rows in by_kind]
        kind = list(self.sensor.kinds)[int(np.argmax(size))]
        return kind, self.of_kind(kind)

    def covariance(self, base):
        """Return the covariance of the parameters of the fit of all poses, (p, p), nominal SI.

        It is the average over the noise hypotheses, weighted by their probability. Under each one
        it is that of generalised least squares, times the reduced χ² if that is above one, plus the
        square of the difference between the solution under this hypothesis and the fit. The
        constants of the effects are parameters too, with a prior standard deviation of a factor e.
        """
        about = self.linearization(base)
        fit = about.evidence.training_fit().fit(base, 0)
        count, more = about.jacobian.shape[1], self._by_constants(base, about.solution.x)
        total, design = 0.0, np.column_stack([about.jacobian, *more])
        size = np.linalg.norm(design, axis=0)
        size[size == 0] = 1.0
        design, prior = design / size, np.diag(size**-2.0 * (np.arange(len(size)) >= count))
        counted, of_prior = fit.weight > 1e-6, self.rows[1] == ""
        for h in np.flatnonzero(counted):
            # the rows of the prior keep their variance, independent of the residuals of the poses
            scale = np.where(of_prior, 1.0, fit.scale[h])
            weighted = (design.T / scale) @ about.evidence.row_groups[0].noise.precision[h]
            inverse = np.linalg.inv(weighted @ design + prior / fit.scale[h])
            off = inverse @ (weighted @ about.values)
            total = total + fit.weight[h] * (inverse + np.outer(off, off))
        covariance = total / fit.weight[counted].sum() / np.outer(size, size)
        return covariance[:count, :count]

    def _by_constants(self, base, x):
        """Return the derivatives of all rows by the log of each effect's constants, (N,) each.

        `x`, (p,), are the parameters of the fit.
        """
        effects, derivatives = (*self.given_effects, *base), []
        for effect, values in by_effect(x[len(self.sensor.names) :], effects).items():
            if effect.moved(2.0) != effect:
                moved = self.patterns([effect.moved(f) for f in (1.05, 1 / 1.05)]).values()
                up, down = (pattern[:, 0] @ values for pattern in moved)
                derivatives.append((up - down) / (2 * np.log(1.05)))
        return derivatives

    def why_no_trial(self, search, kind):
        """Return the reason, text, why a kind of effect has no trial."""
        rows = search.training_fit(()).free_rows
        shapes = self.shapes.get(kind) or (kind.cls(),)
        least = min(len(shape.parameters) for shape in shapes)
        if rows <= least:
            return f"{rows} residuals to spare do not determine {least} more parameters"
        return "what it adds in these data is taken up by the base model"

    def fit(self, base, held_out=frozenset()):
        """Return the Fit with the base effects to the rows without some folds.

        Its covariance is zero, since it is not used.
        """
        solution, count = self.nearest_linearization(base).solution, len(self.sensor.names)
        nuisance, vectors = self.training_fit(base, held_out).parameters(base, 0)
        start = solution.x.copy()
        # the nuisance parameters: the base model and the given effects
        start[: len(nuisance[0])] += nuisance[0]
        x = by_effect(start[count:], solution.effects)
        for effect, vector in vectors.items():
            x[effect] = x.get(effect, 0.0) + vector
        effects = (*self.given_effects, *base)
        values = np.concatenate([start[:count], *(x[e] for e in effects)])
        return replace(solution, effects=effects, x=values, covariance=np.zeros((len(values),) * 2))


def by_effect(values, effects):
    """Return a dict that has for each effect its part of the last axis of `values`.

    The last axis, (q,), has the parameters of all effects, one effect after the other.
    """
    ends = pairwise(np.cumsum([0, *(len(e.parameters) for e in effects)]))
    return {e: values[..., i:j] for e, (i, j) in zip(effects, ends, strict=True)}


def interleaved_folds(count, folds):
    """Return the fold of each of `count` poses, (count,), with neighbours in different folds.

    So the poses before and after predict a held-out pose. If there are at most four folds, two
    neighbours share a fold: else too few neighbours would remain without it and a second fold.
    """
    folds = min(folds, count)
    return np.arange(count) // (1 if folds > 4 else 2) % folds
