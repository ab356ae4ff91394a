"""The search for effects: test, add the best that passes, refit; and on held-out data."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.special import chdtrc

from imuloop.core.effect import Effect
from imuloop.diagnose.pairs import best_pair
from imuloop.diagnose.residuals import held_out_variance
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.trial import Linear, White, excess, try_shapes
from imuloop.effects.thermometer import LEAST_SPAN, span


def candidates(sensor, record, channels):
    """Return the effects to try on a sensor, each with its shapes, and why others are not.

    Parameters
    ----------
    sensor : {'accelerometer', 'gyroscope'}
        Sensor.
    record : {'poses', 'static_record'}
        Kind of data.
    channels : Channels
        What the effects see in them.

    Returns
    -------
    dict of type to tuple of Effect
        The shapes of each effect that can be tried.
    dict of type to (str, str)
        Status and reason of those that cannot.
    """
    available, others = {}, {}
    for cls in Effect.library.values():
        if sensor not in cls.sensors or (record not in cls.records and not cls.unobservable):
            continue
        if cls.unobservable:
            others[cls] = ("not_observable", cls.unobservable)
        elif "temperature" in cls.needs and channels.temperature is None:
            others[cls] = ("not_available", "not every session logs a temperature")
        elif "temperature" in cls.needs and span(channels) <= LEAST_SPAN:
            others[cls] = (
                "not_observable",
                f"the temperature changes by {span(channels):.2g} K: a thermometer's own error can "
                f"do so up to {LEAST_SPAN:g} K",
            )
        elif "run" in cls.needs and (channels.run is None or not channels.run.any()):
            others[cls] = (
                "not_available",
                "one run shows one bias: record several sessions, switched off and on between",
            )
        elif "run" in cls.needs and channels.run.max() >= cls.bounds["runs"][1]:
            others[cls] = ("not_available", f"more runs than {cls.bounds['runs'][1]}")
        else:
            available[cls] = tuple(cls.shapes(channels))
    return available, others


@dataclass(frozen=True)
class Step:
    """A fit, and what every other candidate would add to it.

    Attributes
    ----------
    solution : Solution
        The fit to the poses that were kept.
    linear : Linear
        Residuals of all poses about it, held-out ones too.
    seen : ndarray of bool, shape (N,)
        The residuals of the fit.
    limits : callable
        Gives the covariance of the residuals of the fit with the slow noise that the rests were too
        short to exclude; None without.
    """

    solution: object
    linear: Linear
    seen: np.ndarray
    limits: object

    @cached_property
    def white(self):
        """The residuals of the fit, whitened."""
        return White.of(self.linear, self.seen, self.solution.covariance)

    @cached_property
    def spread(self):
        """The same with their excess as variance too; None at the floor."""
        covariance = self.solution.covariance
        more = excess(self.linear, self.seen, covariance)
        return White.of(self.linear, self.seen, covariance + np.diag(more)) if more.any() else None

    @cached_property
    def slow(self):
        """The same with slow noise at its limits; None without."""
        covariance = self.limits()
        return None if covariance is None else White.of(self.linear, self.seen, covariance)

    @cached_property
    def _tried(self):
        return try_shapes(self.white, self.linear.shapes, self.doubts)

    @property
    def trials(self):
        """The trial of each candidate, by type; effects of the fit left out."""
        return self._tried[0]

    @property
    def reasons(self):
        """Why there is no trial of the others, by type."""
        return self._tried[1]

    @property
    def doubts(self):
        """The weights, beside the noise model's, that an effect has to pass with."""
        return tuple(white for white in (self.spread, self.slow) if white)


@dataclass(frozen=True)
class Search:
    """A search that sees some poses only, and predicts the others.

    Attributes
    ----------
    model : AccelerometerPoses or GyroscopePoses
        How the sensor is fitted.
    recording : Recording
        All poses and rotations.
    keep : ndarray of bool, shape (n,)
        The poses that the search sees, and with them the rotations between two of them.
    available : dict of type to tuple of Effect
        Effects to choose from, in their shapes.
    settings : DiagnoseSettings
        Settings.
    tests : int
        Number of tests of the family, these candidates among them.
    whole : Search, optional
        Of all poses: this one's fits start from its fit, and what an effect adds is taken about
        that, as the residuals are straight in it.
    start : ndarray, optional
        Parameters without effects next to the fit's.
    """

    model: object
    recording: object
    keep: np.ndarray
    available: dict[type, tuple]
    settings: DiagnoseSettings
    tests: int
    whole: "Search | None" = None
    start: np.ndarray | None = None
    _steps: dict = field(default_factory=dict)

    def step(self, effects=()):
        """Return the fit with some effects, and the trials of all others."""
        if effects not in self._steps:
            self._steps[effects] = self._step(effects)
        return self._steps[effects]

    def _step(self, effects):
        fewer = self._steps.get(effects[:-1]) if effects else self.whole and self.whole.step()
        used = set(map(type, effects))
        shapes = [s for cls, all_ in self.available.items() if cls not in used for s in all_]
        found, start = None, fewer.solution.fit.x if fewer else self.start
        if start is not None:
            found = self.model.refit(self.recording, self.keep, effects, start)
        if found and self.whole:
            solution, fit = found
            known = self.whole.step().linear
            columns = dict(zip(known.shapes, known.columns, strict=True))
            linear = Linear(
                fit.values,
                fit.jacobian,
                tuple(shapes),
                tuple(columns[s] for s in shapes),
                *self.model.kinds(self.recording),
            )
        else:
            solution = (
                found[0] if found else self.model.fit(self.recording.select(self.keep), effects)
            )
            linear = self.model.linearise(solution, self.recording, shapes)
        seen = linear.rows(lambda poses: np.all(self.keep[poses], axis=1))
        limits = self.model.at_limits()

        def at_limits():
            return limits and limits.covariance(solution, self.recording.select(self.keep))

        return Step(solution, linear, seen, at_limits)

    def lost(self, effects=()):
        """Return why the fit with some effects is none, or None if it is one."""
        try:
            step = self.step(effects)
            # each of its weights is a covariance, which rounding may leave indefinite
            step.trials  # noqa: B018
        except LinAlgError:
            return (
                "the residuals cannot be weighted: their covariance is not positive definite; is "
                "the noise of a channel far larger than that of the others?"
            )
        return self.model.lost(step.solution)

    def threshold(self, effects):
        """Return the largest p-value that passes beside some effects: Holm's steps."""
        return self.settings.significance / max(1, self.tests - len(effects))

    def best(self, effects, banned=()):
        """Return the trial that passes with the smallest p-value beside some effects, or None."""
        trials = [
            t
            for cls, t in self.step(effects).trials.items()
            if cls not in banned and not t.impossible
        ]
        passing = [t for t in trials if t.log_p < np.log(self.threshold(effects))]
        return min(passing, key=lambda t: (t.log_p, -t.drop), default=None)

    def greedy(self):
        """Return the effects to add, the best first, and those that passed the test alone.

        An effect is added if it passes the test, lowers the error of poses that are held out of the
        ones seen here, each part predicted by the others, and the fit with it is one.

        Returns
        -------
        tuple of Effect
            Added, each in its best shape.
        dict of type to list of float
            Interval of the ratio of held-out errors of those that were not.
        """
        effects, failed = (), {}
        while best := self.best(effects, failed) or self.best_pair(effects, failed):
            ratio = self.gate(effects, best)
            if ratio[1] < 1 and not self.lost(effects + best.effects):
                effects += best.effects
            else:
                classes = tuple(map(type, best.effects))
                failed[classes if len(classes) > 1 else classes[0]] = ratio
        return effects, failed

    def best_pair(self, effects, banned):
        """Return the pair of effects that passes where no single one does, or None.

        Only looked for where the residual is above its floor.
        """
        step = self.step(effects)
        if chdtrc(step.solution.fit.dof, step.solution.fit.chi2) >= self.settings.significance:
            return None
        log_threshold = np.log(self.threshold(effects))
        return best_pair(step.white, step.doubts, step.linear.shapes, banned, log_threshold)

    def gate(self, effects, tried):
        """Return the interval of held-out error with what was tried over that without.

        In the kind of residual where it shows most; the residuals are taken as linear in all
        parameters, which are estimated again without each of the parts that follow in time.

        Parameters
        ----------
        effects : tuple of Effect
            Effects of the model.
        tried : Trial or Pair
            What is to be added.
        """
        step = self.step(effects)
        linear, kind = step.linear, self.kind(effects, tried)
        base = linear.jacobian
        wide = np.column_stack([base, *(linear.columns[c] for c in tried.columns)])
        kept = np.flatnonzero(self.keep)
        part = np.full(len(self.keep), -1)
        count = min(self.settings.folds, len(kept))
        part[kept] = np.arange(len(kept)) * count // len(kept)
        place = np.cumsum(step.seen) - 1
        before, after = [], []
        for k in range(count):
            training = step.seen & linear.rows(lambda poses, k=k: np.all(part[poses] != k, axis=1))
            held = step.seen & linear.rows(lambda poses, k=k: part[poses[:, 0]] == k)
            covariance = step.solution.covariance[np.ix_(place[training], place[training])]
            root = cholesky(covariance, lower=True)
            for errors, jacobian in ((before, base), (after, wide)):
                values = np.full(len(held), np.nan)
                values[held] = _predicted(root, linear.values, jacobian, training)[held]
                v = linear.split(values)[kind]
                errors.append({kind: v[np.isfinite(v[:, 0])]})
        return ratio_interval(held_out(before, after)[kind], self.settings)

    def kind(self, effects, tried):
        """Return the kind of residual in which a Trial or Pair shows most."""
        step = self.step(effects)
        signal = np.zeros(len(step.seen))
        signal[step.seen] = tried.pattern @ tried.values
        parts = step.linear.split(signal)
        return max(parts, key=lambda kind: (parts[kind] ** 2).sum())

    def shaped(self, classes):
        """Return given effects in the shapes that are best here; those that cannot be are left."""
        effects = ()
        for cls in classes:
            trial = self.step(effects).trials.get(cls)
            if trial and not self.lost((*effects, trial.effect)):
                effects += (trial.effect,)
        return effects

    def errors(self, effects=()):
        """Return the residuals of the poses that were not seen, by kind, shape (n, k)."""
        linear = self.step(effects).linear
        return self._held(linear, linear.values)

    def errors_alone(self, cls):
        """Return the same with one candidate added, every parameter refitted in one step."""
        step = self.step()
        trial = step.trials.get(cls)
        values = step.linear.values
        if trial:
            column = step.linear.columns[trial.column]
            values = values + step.linear.jacobian @ trial.step + column @ trial.values
        return self._held(step.linear, values)

    def _held(self, linear, values):
        return {
            kind: v[~self.keep[linear.kinds[kind][:, 0]]]
            for kind, v in linear.split(values).items()
        }


def _predicted(root, values, jacobian, training):
    """Return residuals of all rows with the parameters refitted to the training rows."""
    size = np.linalg.norm(jacobian[training], axis=0)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    white = solve_triangular(root, np.column_stack([values, scaled])[training], lower=True)
    return values - scaled @ np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=1e-9)[0]


@dataclass(frozen=True)
class HeldOut:
    """Held-out errors of one kind of residual, in the order of the data.

    Attributes
    ----------
    fold : ndarray of int, shape (n,)
        Which part each residual was held out with.
    before, after : ndarray, shape (n, k)
        Errors of models that never saw that part: with fewer effects, and with more.
    """

    fold: np.ndarray
    before: np.ndarray
    after: np.ndarray


def folds(models, recording, available, settings, tests, whole=None):
    """Return one search for each part of the poses that is held out, with a model of its own.

    Each part is every so-manieth pose, so that a part is predicted by poses before and after it.
    Model and choice of effects see only the other poses and the rotations between them; a rotation
    belongs to the part of the pose that it starts from.
    None where the other parts alone do not determine a calibration. `whole` is the search of all
    poses that theirs start from.
    """
    part = np.arange(len(recording.poses)) % len(models)
    keeps = [part != k for k in range(len(models))]
    if any(models[0].undetermined(recording, keeps)):
        return None
    searches = [
        Search(model, recording, keep, available, settings, tests, whole)
        for model, keep in zip(models, keeps, strict=True)
    ]
    return None if any(search.lost() for search in searches) else searches


def held_out(before, after):
    """Return the HeldOut of each kind from lists, one entry a fold, of errors by kind."""
    return {
        kind: HeldOut(
            np.concatenate([np.full(len(e[kind]), k) for k, e in enumerate(before)]),
            *(np.concatenate([e[kind] for e in errors]) for errors in (before, after)),
        )
        for kind in before[0]
    }


def floor_variance(whole, searches):
    """Return the variance, by kind, (n, k), that the noise alone gives the errors before.

    Parameters
    ----------
    whole : Step
        Fit of all poses without effects: its covariance and derivative.
    searches : list of Search
        The folds.
    """
    parts = []
    for search in searches:
        held = whole.linear.rows(lambda poses, s=search: ~s.keep[poses[:, 0]])
        seen = whole.linear.rows(lambda poses, s=search: np.all(s.keep[poses], axis=1))
        variance = np.full(len(held), np.nan)
        variance[held] = held_out_variance(
            whole.solution.covariance, whole.solution.fit.jacobian, seen, held
        )
        split = whole.linear.split(variance)
        parts.append({kind: v[np.isfinite(v[:, 0])] for kind, v in split.items()})
    return {kind: np.concatenate([p[kind] for p in parts]) for kind in parts[0]}


def ratio_interval(held, settings):
    """Return the 95 % interval of held-out error after over before, whole parts drawn again."""
    parts = np.unique(held.fold)
    sums = np.array(
        [[(e[held.fold == k] ** 2).sum() for e in (held.before, held.after)] for k in parts]
    )
    draws = np.random.default_rng(settings.seed).integers(
        len(parts), size=(settings.draws, len(parts))
    )
    before, after = sums[draws].sum(axis=1).T
    return [float(q) for q in np.quantile(np.sqrt(after / before), [0.025, 0.975])]
