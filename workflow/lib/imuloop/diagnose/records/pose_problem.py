"""The poses of a device and the rotations between: residuals of a calibration, and their noise."""

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

# from the noise as estimated to what the residuals make of it
PATH = (0.0, 0.3, 0.6, 1.0)
# by how much the logarithm of the likelihood may still rise where limits ask for the noise
ROUGH = 0.05
# effects whose derivative is found at once
TOGETHER = 32


@dataclass(frozen=True)
class Linearization:
    """The residuals about the fit of all poses with some effects."""

    solution: object  # the Fit
    at: object  # Linearised factors about it
    values: np.ndarray  # (N,): residuals
    jacobian: np.ndarray  # (N, p): derivative with respect to the parameters
    # what the noise may be, from what was estimated of it to what the residuals make of it:
    # logarithm of the probability beforehand and covariance, (N, N)
    alternatives: list
    evidence: Evidence  # of the values
    noise_with: object  # callable: takes residuals, gives their Hypotheses


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """The poses of a device: one group of rows, whose nuisances are the base parameters."""

    sensor: object  # JointFit
    recording: object
    shapes: dict  # tuple of the shapes of each effect to try, by kind
    settings: DiagnoseSettings
    tests: int  # number of tests of the family
    # (n,): the part that each pose, or whatever rows are of, is held out with; -1 for none
    fold_of_pose: np.ndarray
    given_effects: tuple = ()  # effects that other records show, which every fit estimates
    information: object = None  # takes effects, gives `static.information` of other records
    # rows R and z of what other data say of the base model: ``R x - z`` has variance one
    base_rows: tuple = (np.zeros((0, 0)), np.zeros(0))
    # what looks for patterns whose shapes cannot be listed, by kind
    scans: dict = field(default_factory=dict)
    _fits: dict = field(default_factory=dict, repr=False)
    _columns: dict = field(default_factory=dict, repr=False)
    # whether a scan is made again beside what was found later: turns show the steps of both sensors
    scans_again = True
    # in what held-out errors are compared: they are all alike
    error_scale = 1.0

    @cached_property
    def folds(self):
        """Number of parts that are held out in turn."""
        return int(self.fold_of_pose.max()) + 1

    @cached_property
    def prior_rows(self):
        """What other records say: rows ``R θ - z``, variance one, by effect, and z of all.

        The base model's own rows come first.
        """
        known = self.base_rows[1]
        if self.information is None:
            return {}, known
        # of formulas static records, in few attitudes, say nothing
        shapes = (s for kind, own in self.shapes.items() for s in own if not kind.is_formula)
        effects = (
            *self.given_effects,
            *(s for s in shapes if "temperature" in s.needs and not s.timed),
        )
        if not effects:
            return {}, known
        information, moment = self.information(effects)
        size = np.sqrt(np.maximum(np.diag(information), 0.0))
        size[size == 0] = 1.0
        values, axes = np.linalg.eigh(information / np.outer(size, size))
        shown = values > ABSORBED * max(values.max(initial=0.0), ABSORBED)
        roots, axes = np.sqrt(values[shown]), axes[:, shown].T
        rows = np.pad(roots[:, None] * axes * size, ((len(known), 0), (0, 0)))
        return by_effect(rows, effects), np.append(known, axes @ (moment / size) / roots)

    @cached_property
    def rows(self):
        """Poses where each residual of the poses starts and ends, (n, 2), and its kind, (N,).

        Rows of other records come last, of no kind.
        """
        ends, kind = self.sensor.rows(self.recording)
        return ends, np.append(kind, np.full(len(self.prior_rows[1]), ""))

    @cached_property
    def row_folds(self):
        """The parts that each row touches, the one that it is held out with first, (N, 2)."""
        own = self.fold_of_pose[self.rows[0]]
        return np.concatenate([own, np.full((len(self.prior_rows[1]), 2), -1)])

    @property
    def fold_of_row(self):
        """The part that each row is held out with: that of its first pose, shape (N,)."""
        return self.row_folds[:, 0]

    def residuals(self, search, base):
        """Return what effects, fitted to what is seen, leave of all residuals, shape (N, 1).

        Not a number about a step: what is seen tells its time between two poses at best.
        """
        left = search.training_fit(base).residuals(base, 0)
        for effect in base:
            if effect.name == Steps.name:
                left[self._about_step(effect, search.held_out)] = np.nan
        return left[:, None]

    def _about_step(self, effect, held_out):
        """Return which rows are of poses that lie on either side of a step, for all that is seen.

        Between the last pose before it and the first after it that are in no part of `held_out`.
        """
        held, pair = np.isin(self.fold_of_pose, list(held_out)), self.rows[0]
        after = self.recording.poses.mid_s > effect.effect.times[0]
        number = np.arange(len(held))
        last = number[~held & ~after].max(initial=-1)
        first = number[~held & after].min(initial=len(held))
        poses = number[held & (number > last) & (number < first)]
        kinds = {"rotation", *OF_SENSOR[effect.sensor]}.intersection(self.sensor.kinds)
        shown = sum(self.of_kind(kind) for kind in kinds)
        return np.flatnonzero(shown[: len(pair)] & np.isin(pair, poses).any(axis=1))

    def of_kind(self, kind):
        """Return the rows, shape (N,), of one kind of residual."""
        return self.rows[1] == kind

    def rows_by_kind(self):
        """Return the rows of each kind of residual."""
        return [self.of_kind(kind) for kind in self.sensor.kinds]

    def components(self, kind):
        """Return how many rows make one residual."""
        return self.sensor.kinds[kind][1]

    def linearization(self, base=()):
        """Return the residuals about the fit with some effects."""
        if base not in self._fits:
            self._fits[base] = self._linearize(base)
        return self._fits[base]

    def with_folds(self, fold_of_pose):
        """Return the problem with another part of each pose, (n,)."""
        problem = replace(self, fold_of_pose=fold_of_pose, _fits={})
        for base, about in self._fits.items():
            evidence = about.evidence.with_folds(problem.row_folds)
            problem._fits[base] = replace(about, evidence=evidence)
        return problem

    def _linearize(self, base):
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
        # each kind of residual as estimated or likeliest, and all others as estimated or likeliest:
        # all as estimated first, all likeliest last
        one = np.eye(len(kinds), dtype=bool)
        chosen = np.unique(np.vstack([0 * one, one, ~one, 0 * one == 0]), axis=0)[:, number]

        noisy = likely_sizes(values, jacobian, covariance, slow)
        off = (noisy - estimated) / [component.deviation for component in slow]
        alternatives = [
            (-off @ off * s**2 / 2, total(covariance, slow, estimated + s * (noisy - estimated)))
            for s in PATH
        ]

        def hypotheses(chosen, likeliest):
            """Return what the noise may be with some sizes likeliest, the others as estimated."""
            sizes = np.where(chosen, likeliest, first)
            return Hypotheses.of(precision(total(covariance, components, own)) for own in sizes)

        def noise_with(values):
            """Return the noise as estimated, and as other residuals make it likeliest."""
            start = likelihood.projection(likeliest)
            return hypotheses(chosen[[0, -1]], likelihood.maximise(values, start, ROUGH))

        noise = hypotheses(chosen, likeliest)
        rows = RowGroup(-values[:, None], jacobian[:, :nuisances], noise, self.row_folds)

        def design(effect):
            return own[effect] if effect in own else self.added_columns(effect)

        prior, plain = np.full(len(chosen), -np.log(len(chosen))), ~chosen.any(axis=1)
        evidence = Evidence([rows], prior, design, least=1.0, as_estimated_mask=plain)
        return Linearization(solution, at, values, jacobian, alternatives, evidence, noise_with)

    def _known_base(self):
        """Return what other records say of the base parameters, rows R as above."""
        own = self.base_rows[0].reshape(-1, len(self.sensor.names))
        return np.pad(own, ((0, len(self.prior_rows[1]) - len(own)), (0, 0)))

    def _known_effects(self, effects):
        """Return what other records say of the parameters of effects, rows R as above."""
        of_effects, z = self.prior_rows
        rows = (of_effects.get(e, np.zeros((len(z), len(e.parameters)))) for e in effects)
        return np.hstack([np.zeros((len(z), 0)), *rows])

    def added_columns(self, effect):
        """Return what an effect adds to the residuals about the fit without any, (N, 1, p)."""
        shapes = self.shapes.get(effect.kind, ())
        self.add_columns(shapes if effect in shapes else (effect,))
        return self._columns[effect]

    def with_formulas(self, formulas):
        """Return the problem with more shapes, by kind, that are tried after all others."""
        count = self.tests + self.settings.family * len(formulas)
        problem = replace(self, shapes=self.shapes | formulas, tests=count)
        # what was linearised before finds them there
        problem.add_columns([shape for shapes in formulas.values() for shape in shapes])
        return problem

    def add_columns(self, effects):
        """Find what several effects add, many at once: what they have in common is found once."""
        new = [e for e in effects if e not in self._columns]
        about = self.linearization(()).at
        for first in range(0, len(new), TOGETHER):
            own = new[first : first + TOGETHER]
            columns = np.concatenate([about.columns(own), self._known_effects(own)])
            self._columns.update(by_effect(columns[:, None], own))

    def nearest_linearization(self, base):
        """Return the residuals about the fit with the most of some effects that was asked for.

        The evidence holds the others as patterns: what a part chooses is worth no fit of all data.
        """
        made = [b for b in self._fits if set(b) <= set(base)]
        return self.linearization(max(made, key=len, default=()))

    def training_fit(self, base, held_out):
        """Return the TrainingFit, about a fit of all poses with some of the effects."""
        return self.nearest_linearization(base).evidence.training_fit(held_out)

    def is_like_slow_noise(self, effect):
        """Return whether noise could be larger for an effect: it changes as slow noise does."""
        return effect.timed or "temperature" in effect.needs

    def noise_with(self, base, values):
        """Return what the noise of each group of rows may be, were its residuals these."""
        return [self.nearest_linearization(base).noise_with(-values)]

    def refit(self, base):
        """Fit all poses with some effects: what is tested beside them is linear about that fit."""
        self.linearization(base)

    def most_changed_rows(self, search, base, trial):
        """Return kind and rows in which a trial changes most, in standard deviations."""
        training_fit = search.training_fit(base)
        wider = (*base, trial.effect)
        change = training_fit.residuals(base, 0) - training_fit.residuals(wider, 0)
        variance = np.diag(self.nearest_linearization(base).alternatives[0][1])
        by_kind = [rows & (self.fold_of_row >= 0) for rows in self.rows_by_kind()]
        size = [(change[rows] ** 2 / variance[rows]).sum() for rows in by_kind]
        kind = list(self.sensor.kinds)[int(np.argmax(size))]
        return kind, self.of_kind(kind)

    def covariance(self, base):
        """Return the covariance of the parameters of the fit of all poses, (p, p), SI as logged.

        Under every hypothesis that of generalised least squares, its scale that of the residual
        where this is larger, and what the solution under it is off; averaged by the likelihood.
        Fitted constants of the effects are parameters too, known to a factor of e beforehand.
        """
        about = self.linearization(base)
        fit = about.evidence.training_fit().fit(base, 0)
        count, more = about.jacobian.shape[1], self._by_constants(base, about.solution.x)
        total, design = 0.0, np.column_stack([about.jacobian, *more])
        size = np.linalg.norm(design, axis=0)
        size[size == 0] = 1.0
        design, prior = design / size, np.diag(size**-2.0 * (np.arange(len(size)) >= count))
        counted, known = fit.weight > 1e-6, self.rows[1] == ""
        for h in np.flatnonzero(counted):
            # what other records say is as good as they have it, whatever is left here
            scale = np.where(known, 1.0, fit.scale[h])
            weighted = (design.T / scale) @ about.evidence.row_groups[0].noise.precision[h]
            inverse = np.linalg.inv(weighted @ design + prior / fit.scale[h])
            off = inverse @ (weighted @ about.values)
            total = total + fit.weight[h] * (inverse + np.outer(off, off))
        found = total / fit.weight[counted].sum() / np.outer(size, size)
        return found[:count, :count]

    def _by_constants(self, base, x):
        """Return what the logarithm of each fitted constant changes in the residuals, (N,) each."""
        effects, found = (*self.given_effects, *base), []
        for effect, values in by_effect(x[len(self.sensor.names) :], effects).items():
            if effect.moved(2.0) != effect:
                up, down = (
                    self.added_columns(effect.moved(f))[:, 0] @ values for f in (1.05, 1 / 1.05)
                )
                found.append((up - down) / (2 * np.log(1.05)))
        return found

    def why_no_trial(self, search, kind):
        """Return why a kind of effect has no trial."""
        rows = search.training_fit(()).free_rows
        shapes = self.shapes.get(kind) or (kind.cls(),)
        least = min(len(shape.parameters) for shape in shapes)
        if rows <= least:
            return f"{rows} residuals to spare do not determine {least} more parameters"
        return "what it adds in these data is taken up by the base model"

    def fit(self, base, held_out=frozenset()):
        """Return the Fit with some effects that does not see some parts."""
        solution, count = self.nearest_linearization(base).solution, len(self.sensor.names)
        nuisance, vectors = self.training_fit(base, held_out).parameters(base, 0)
        start = solution.x.copy()
        # the nuisances: the base model, and what other records show
        start[: len(nuisance[0])] += nuisance[0]
        x = by_effect(start[count:], solution.effects)
        for effect, vector in vectors.items():
            x[effect] = x.get(effect, 0.0) + vector
        effects = (*self.given_effects, *base)
        values = np.concatenate([start[:count], *(x[e] for e in effects)])
        # nobody asks how well a part determines them
        nothing = np.zeros((len(values), len(values)))
        return replace(solution, effects=effects, x=values, covariance=nothing)


def by_effect(values, effects):
    """Return the last axis of values, one entry a parameter, by effect."""
    ends = pairwise(np.cumsum([0, *(len(e.parameters) for e in effects)]))
    return {e: values[..., i:j] for e, (i, j) in zip(effects, ends, strict=True)}


def interleaved_folds(count, folds):
    """Return the part of each pose: neighbours in different ones, so that both sides predict.

    Of few folds two neighbours are in one: without two folds some have to stay neighbours.
    """
    folds = min(folds, count)
    return np.arange(count) // (1 if folds > 4 else 2) % folds
