"""The search: test every shape of every effect, added to the model, on the training rows.

The package's docstring defines shape, row and noise hypothesis.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.core.fisher import fisher
from imuloop.estimate.error_ratio import ErrorChange
from imuloop.estimate.likeness import ONE, share_on_axes
from imuloop.estimate.p_values import log_p_values
from imuloop.estimate.training_fit import combined_axes
from imuloop.model.effect import Effect

# two shapes are equally significant if their log p differs by less than this share
ALIKE = 0.05
# a temperature effect goes before a time effect if its log p is at least this share of the other's
AS_CLEARLY = 0.5
# factors on the constants of a shape, tried one after the other, in `Search.refine`
FACTORS = (1.4, 1.2, 1.1, 1.05, 1.02)


def kinds_of(effects):
    """Return the kind of each effect, a tuple."""
    return tuple(effect.kind for effect in effects)


def _price(base, effect):
    """Return the price of a shape: the logarithm by which its constants make it less likely.

    It is zero if an effect of `base`, the effects in the model, has the same constants already: a
    device has one thermometer, and one lag.
    """
    if not effect.price:
        return 0.0
    paid = any(e.name == effect.name and e.constants == effect.constants for e in base)
    return 0.0 if paid else effect.price


def _of_temperature(effect):
    """Return whether an effect depends on the temperature itself."""
    return "temperature" in effect.needs and not effect.after_temperature


@dataclass(frozen=True)
class Trial:
    """The significance test of one effect, in its best shape, added to a model."""

    effect: Effect  # the shape
    log_p: float  # logarithm of the p-value times the number of shapes that were tried
    axis: int  # index of the axis with the smallest p-value
    axes: int  # number of axes that the test combines
    tries: float = 0.0  # logarithm of the number of shapes
    # whether a parameter is above its physical limit by more than its standard error
    impossible: bool = False
    change: ErrorChange | None = None  # change of the held-out errors, if it was computed

    @property
    def p_value(self):
        """Probability that data without the effect give so small a p, at most 1."""
        return float(min(1.0, np.exp(self.log_p)))


@dataclass
class Search:
    """A search for effects in the training rows of a problem.

    `Choices` describes the `problem`; `held_out` has the numbers of the folds that the search does
    not use. In all methods `base` is a tuple of the effects that are in the model already.
    """

    problem: object
    held_out: frozenset
    _trials: dict = field(default_factory=dict)
    _by_kinds: dict = field(default_factory=dict)

    def threshold(self, count):
        """Return the logarithm of the largest p-value that passes the test.

        It follows Holm's method for several tests; `count` is the number of effects that are in
        the model already.
        """
        settings = self.problem.settings
        return np.log(settings.significance / max(1, self.problem.tests - count))

    def training_fit(self, base):
        """Return the TrainingFit of the training rows, linearised with the base effects."""
        return self.problem.training_fit(base, self.held_out)

    def test(self, base, effect):
        """Return the Trial of one shape added to the base, or None if it cannot be estimated."""
        return self.tests(base, (effect,))[0]

    def tests(self, base, effects, hypotheses=slice(None)):
        """Test several shapes, each added to the base alone.

        Each axis has its own parameters and its own noise; Fisher's method combines the p-values
        of the axes.

        Parameters
        ----------
        base : tuple of Effect
            Effects that are in the model already.
        effects : sequence of Effect
            The shapes.
        hypotheses : ndarray, shape (h,) of bool, optional
            The noise hypotheses that the test averages over; all by default.

        Returns
        -------
        list of Trial or None
            An entry for each shape; None if an axis cannot estimate it.
        """
        training_fit, testable = self.training_fit(base), {}
        axes = range(training_fit.evidence.axes)
        fits_without = [training_fit.fit(base, axis) for axis in axes]
        fits_with = training_fit.fits(base, [(e,) for e in effects])
        for k, pattern in enumerate(training_fit.evidence.patterns(effects)):
            fits = {a: (fits_without[a], fits_with[a][k]) for a in axes if pattern.columns[a]}
            if fits and all(without and with_effect for without, with_effect in fits.values()):
                testable[k] = fits
        pairs = [pair for fits in testable.values() for pair in fits.values()]
        log_p, trials = iter(log_p_values(pairs, hypotheses)), [None] * len(effects)
        for k, fits in testable.items():
            by_axis = {axis: next(log_p) for axis in fits}
            joint = float(fisher(by_axis.values()))
            trials[k] = Trial(effects[k], joint, min(by_axis, key=by_axis.get), len(by_axis))
        return trials

    def trial(self, base, kind, may_give_up=False):
        """Return the Trial of the best shape of a kind, added to the base, or None.

        It is None if the base has the kind, or if no shape can be estimated. With `may_give_up` it
        is also None if a scan stops early, because its first step is no clearer than chance.
        """
        if kind in kinds_of(base):
            return None
        may_give_up = may_give_up and kind in self.problem.scans
        key = base, kind, may_give_up
        if key not in self._trials:
            if kind in self.problem.scans:
                self._trials[key] = self.problem.scans[kind](self, base, may_give_up)
            else:
                shapes = self.problem.shapes[kind]
                # a shape with a price counts as a fraction of a try
                tries = np.log(sum(np.exp(-shape.price) for shape in shapes))
                self._trials[key] = self.best_of_shapes(base, shapes, tries)
        return self._trials[key]

    def best_of_shapes(self, base, shapes, tries):
        """Return the Trial of the best of several shapes, or None if none can be estimated.

        The best shape has the smallest p-value. If several are equally significant, see `ALIKE`,
        it is the one with the smallest p-value under the noise hypotheses that estimates may use.
        `tries` is the logarithm of the number of shapes, and is added to log p.
        """
        trials = self._priced_tests(base, shapes)
        smallest = min((t.log_p for t in trials), default=0.0)
        clearest = [t for t in trials if t.log_p <= (1 - ALIKE) * smallest]
        if not clearest:
            return None
        best = clearest[0]
        if len(clearest) > 1:
            # shapes with equal patterns differ by rounding only: the first is taken
            mask = self.training_fit(base).evidence.estimation_mask
            again = self._priced_tests(base, [t.effect for t in clearest], mask)
            best = clearest[int(np.argmin([round(t.log_p, 6) for t in again]))]
        impossible = False
        if np.isfinite(best.effect.kind.limit):
            values, std, _ = self.estimate(base, best.effect)
            impossible = bool(np.any(np.abs(values) - std > best.effect.kind.limit))
        price = _price(base, best.effect)
        return replace(best, log_p=best.log_p + tries, tries=tries + price, impossible=impossible)

    def _priced_tests(self, base, shapes, hypotheses=slice(None)):
        """Return the Trials of the shapes that can be estimated, with their price added to log p.

        The arguments are those of `tests`.
        """
        trials = [t for t in self.tests(base, shapes, hypotheses) if t]
        return [replace(t, log_p=t.log_p + _price(base, t.effect)) for t in trials]

    def estimate(self, base, effect):
        """Return the parameters of an effect added to the base, with standard errors.

        The result is the values, (p,), the standard errors, (p,), and the covariance, (p, p), SI.
        They are averaged over the noise hypotheses and combined from all axes. Parameters that no
        axis can estimate are zero.
        """
        training_fit, estimates = self.training_fit(base), []
        (pattern,) = training_fit.evidence.patterns((effect,))
        for axis, columns in enumerate(pattern.columns):
            index, scale = pattern.parameters[axis], pattern.scale[axis]
            fit = training_fit.fit((*base, effect), axis) if columns else None
            if fit is not None:
                coefficients, covariance = fit.average()
                covariance = covariance[-len(columns) :, -len(columns) :] / np.outer(scale, scale)
                estimates.append((index, coefficients[-len(columns) :] / scale, covariance))
        values, covariance = combined_axes(len(effect.parameters), estimates)
        return values, np.sqrt(np.diag(covariance)), covariance

    @property
    def kinds(self):
        """All kinds of effects that can be tried."""
        return (*self.problem.shapes, *self.problem.scans)

    def significant_effects(self, kinds):
        """Return the significant effects of some kinds, a tuple, without cross-validation.

        They are added one by one, each time the one with the smallest p-value, until none passes
        the test.
        """
        effects = ()
        while best := self.best_trial(effects, kinds):
            effects = self.with_best_shapes((*effects, best.effect))
        return effects

    def best_trial(self, base, kinds):
        """Return the Trial of some kinds with the smallest p-value that passes the test, or None.

        An effect of the temperature itself goes before an effect of time or of the past temperature
        if it is at least half as clear, see `AS_CLEARLY`: the log shows its cause. Formulas are
        tried if no named effect passes.
        """
        named, formulas = ([k for k in kinds if k.is_formula == last] for last in (False, True))
        return self._best_of(base, named) or self._best_of(base, formulas)

    def _best_of(self, base, kinds):
        """Return the best Trial by the rules of `best_trial`, with named and formulas alike."""
        trials = [self.trial(base, kind, may_give_up=True) for kind in kinds]
        passing = [
            t for t in trials if t and not t.impossible and t.log_p < self.threshold(len(base))
        ]
        best = min(passing, key=lambda t: round(t.log_p, 6), default=None)
        if best and best.effect.after_temperature:
            limit = AS_CLEARLY * best.log_p
            of_temperature = [t for t in passing if t.log_p < limit and _of_temperature(t.effect)]
            passing = of_temperature or passing
            best = min(passing, key=lambda t: round(t.log_p, 6))
        return self._first_alike(base, best, passing) if best else None

    def _first_alike(self, base, best, passing):
        """Return the first Trial in the list `passing` that these data cannot tell from the best.

        In one attitude, for example, a change of scale factor is the same as a change of bias.
        """
        training_fit = self.training_fit(base)
        for trial in passing:
            patterns = training_fit.evidence.patterns((best.effect, trial.effect))
            # patterns with different numbers of columns are different
            numbers, best_numbers = ([len(c) for c in pattern.columns] for pattern in patterns)
            if trial is best or (
                numbers == best_numbers
                and share_on_axes(training_fit, best.effect, trial.effect) > ONE
            ):
                return trial

    def with_best_shapes(self, effects):
        """Return the effects, each but the last in the shape that fits best with the others."""
        for i, effect in enumerate(effects[:-1]):
            shapes, best = self.problem.shapes.get(effect.kind, ()), None
            other_effects = effects[:i] + effects[i + 1 :]
            if len(shapes) > 1:
                best = self.best_of_shapes(other_effects, shapes, 0.0)
            elif effect.kind in self.problem.scans and self.problem.scans_again:
                best = self.trial(other_effects, effect.kind)
            effects = (*effects[:i], best.effect, *effects[i + 1 :]) if best else effects
        return effects

    def refine(self, effects):
        """Return the effects with refined constants, which may lie between those of the shapes.

        The constants of one effect after the other are moved by the `FACTORS` while the likelihood
        rises.
        """
        for i, effect in enumerate(effects):
            other_effects = effects[:i] + effects[i + 1 :]
            # one linearisation, and so the same noise, for all constants
            training_fit = self.training_fit(other_effects)
            axes = range(training_fit.evidence.axes)
            fits = [training_fit.fit((*other_effects, effect), axis) for axis in axes]
            if not all(fits) or effect.moved(2.0) == effect:
                continue
            hypotheses = [training_fit.hypothesis(fit) for fit in fits]
            for factor in FACTORS:
                shapes = [effect.moved(f) for f in (1.0, 1 / factor, factor)]
                losses = []
                for shape in shapes:
                    fits = [training_fit.fit((*other_effects, shape), axis) for axis in axes]
                    by_axis = zip(fits, hypotheses, strict=True)
                    losses.append(sum(fit.loss[h] if fit else np.inf for fit, h in by_axis))
                effect = shapes[int(np.argmin(np.round(losses, 6)))]
            effects = (*effects[:i], effect, *effects[i + 1 :])
        return effects

    def effects_of_kinds(self, kinds):
        """Return one effect of each of the given kinds, in the best shape by the training rows.

        The effects are added one after the other. A kind without a trial is left out.
        """
        if kinds and kinds not in self._by_kinds:
            base = self.effects_of_kinds(kinds[:-1])
            trial = self.trial(base, kinds[-1])
            self._by_kinds[kinds] = self.with_best_shapes((*base, trial.effect)) if trial else base
        return self._by_kinds.get(kinds, ())
