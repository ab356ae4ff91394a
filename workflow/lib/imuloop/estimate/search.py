"""The search: test every variant of every effect, added to the model, on the training rows.

A variant is an effect with values of its constants, such as a time constant. A row is one scalar
residual; the training rows are those that cross-validation does not hold out. A noise hypothesis is
one covariance that the noise of the rows may have. The base has the effects that are in the model
already.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.core.fisher import fisher
from imuloop.estimate.axis_fit import combine_axes, log_p_values
from imuloop.estimate.held_out import ErrorChange
from imuloop.estimate.likeness import ONE, share_on_axes
from imuloop.model.effect import Effect

# two variants are equally significant if their log p differs by less than this share
ALIKE = 0.05
# a temperature effect goes before a time effect if its log p is at least this share of the other's
AS_CLEARLY = 0.5
# factors on the constants of a variant, tried one after the other, in `Search.refine`
FACTORS = (1.4, 1.2, 1.1, 1.05, 1.02)


def kinds_of(effects):
    """Return a tuple with the kind of each of some `effects`.

    A kind is the class of the effect; if the search is for both sensors, it is the class together
    with the sensor.
    """
    return tuple(effect.kind for effect in effects)


def _price(base, effect):
    """Return the price of an effect, a float that is added to its log p-value.

    An `effect` with a constant that is rarely needed, such as the lag of a thermometer, has a
    price: it must be more significant than an effect without this constant. All other effects have
    the price zero. Exception: the price is also zero if `base`, the effects in the model, has an
    effect of the same name with the same constants. A device has one thermometer with one lag, so
    the price is paid once.
    """
    if not effect.price:
        return 0.0
    paid = any(e.name == effect.name and e.constants == effect.constants for e in base)
    return 0.0 if paid else effect.price


def _of_temperature(effect):
    """Return whether an `effect` depends on the present temperature, a bool.

    It is False for all other effects, such as those of time and of past temperatures.
    """
    return "temperature" in effect.needs and not effect.after_temperature


@dataclass(frozen=True)
class Trial:
    """The significance test of one effect that is added to a model.

    An effect has variants, which differ in the values of its constants. Here the best variant is
    tested.
    """

    effect: Effect  # the best variant
    # logarithm of the product of the p-value and the number of variants that were tried
    log_p: float
    axis: int  # index of the axis with the smallest p-value
    axes: int  # number of axes that the test combines
    # logarithm of the number of variants that were tried, plus the price of the variant: `log_p` is
    # the log p-value of this variant alone plus this number
    log_tries: float = 0.0
    # whether a parameter is above its physical limit by more than its standard error
    impossible: bool = False
    change: ErrorChange | None = None  # change of the held-out errors, if it was computed

    @property
    def p_value(self):
        """P-value of the test times the number of variants that were tried; it is at most 1."""
        return float(min(1.0, np.exp(self.log_p)))


@dataclass
class Search:
    """A search for effects in the training rows of a problem.

    The `problem` has the rows (scalar residuals) of one kind of record, their folds for
    cross-validation, and the variants of effects to try, by kind. The search does not use the rows
    of the folds in `held_out`, a frozenset of int. In all methods `base` is a tuple of the effects
    that are in the model already.
    """

    problem: object
    held_out: frozenset
    _trials: dict = field(default_factory=dict)
    _by_kinds: dict = field(default_factory=dict)

    def threshold(self, count):
        """Return the logarithm of the largest p-value that passes the test, a float.

        By Holm's method for several tests, the significance is divided by the number of tests that
        have not passed yet. `count` is the number that have passed: the effects in the model.
        """
        settings = self.problem.settings
        return np.log(settings.significance / max(1, self.problem.tests - count))

    def training_fit(self, base):
        """Return the TrainingFit: least squares of the training rows, which are not held out.

        The rows are linearised about a fit that has the effects in `base`. The TrainingFit itself
        can then fit any further effects.
        """
        return self.problem.training_fit(base, self.held_out)

    def test(self, base, effect):
        """Return the Trial, the significance test, of an `effect` added to the effects in `base`.

        The effect has values of its constants, and `base` has the effects that are in the model
        already. The result is None if the training rows do not determine the parameters of the
        effect.
        """
        return self.tests(base, (effect,))[0]

    def tests(self, base, effects, hypotheses=slice(None)):
        """Return the tests of several effects, each added alone to the model, a list of Trial.

        Each axis has its own parameters and its own noise; Fisher's method combines the p-values of
        the axes.

        Parameters
        ----------
        base : tuple of Effect
            Effects that are in the model already.
        effects : sequence of Effect
            The effects to test, with values of their constants.
        hypotheses : ndarray, shape (h,) of bool, optional
            The noise hypotheses, covariances that the noise may have, over which the p-value is
            averaged; all by default.

        Returns
        -------
        list of Trial or None
            An entry for each effect. The entry is None if no axis depends on the effect, or if an
            axis that depends on it cannot estimate its parameters.
        """
        training_fit, testable = self.training_fit(base), {}
        axes = range(training_fit.evidence.axes)
        fits_without = [training_fit.fit(base, axis) for axis in axes]
        fits_with = training_fit.fits(base, [(e,) for e in effects])
        for k, pattern in enumerate(training_fit.evidence.patterns(effects)):
            # by axis that depends on the effect, the fits without and with it
            fits = {a: (fits_without[a], fits_with[a][k]) for a in axes if pattern.columns[a]}
            if fits and all(without and with_effect for without, with_effect in fits.values()):
                testable[k] = fits
        pairs = [pair for fits in testable.values() for pair in fits.values()]
        log_p, trials = iter(log_p_values(pairs, hypotheses)), [None] * len(effects)
        for k, fits in testable.items():
            by_axis = {axis: next(log_p) for axis in fits}
            trials[k] = Trial(
                effect=effects[k],
                log_p=float(fisher(by_axis.values())),
                axis=min(by_axis, key=by_axis.get),
                axes=len(by_axis),
            )
        return trials

    def trial(self, base, kind, may_give_up=False):
        """Return the Trial of the best variant of a kind of effect, added to `base`, or None.

        `base` has the effects that are in the model already, and `kind` is the kind to test. A
        variant is an effect with values of its constants. Most kinds have a list of variants. A
        kind with too many, such as steps at any time, has a scan, a function that finds the best
        one. The result is None if the base has the kind already, or if no variant can be estimated.
        To save time, `may_give_up` lets a scan stop early if its first step is not clearer than
        chance; the result is None then, too.
        """
        if kind in kinds_of(base):
            return None
        # only a scan can stop early: for a list of variants the stored result holds for both values
        may_give_up = may_give_up and kind in self.problem.scans
        key = base, kind, may_give_up
        if key not in self._trials:
            if kind in self.problem.scans:
                self._trials[key] = self.problem.scans[kind](self, base, may_give_up)
            else:
                variants = self.problem.variants[kind]
                # a variant with a price counts as a try with the weight exp(-price), because the
                # price is added to its log p as well
                log_tries = np.log(sum(np.exp(-variant.price) for variant in variants))
                self._trials[key] = self.best_variant(base, variants, log_tries)
        return self._trials[key]

    def best_variant(self, base, variants, log_tries):
        """Return the Trial of the best of several variants, or None if none can be estimated.

        The best variant has the smallest p-value. A close race is decided in another way: variants
        whose log p differs from the smallest by less than the share `ALIKE` are tested again, under
        only those noise hypotheses that estimates of parameters may use. The smallest of these
        p-values wins.

        Parameters
        ----------
        base : tuple of Effect
            Effects that are in the model already.
        variants : sequence of Effect
            Effects of one kind, with different values of their constants.
        log_tries : float
            Logarithm of the number of variants that were tried, which is added to log p.
        """
        trials = self._priced_tests(base, variants)
        smallest = min((t.log_p for t in trials), default=0.0)
        clearest = [t for t in trials if t.log_p <= (1 - ALIKE) * smallest]
        if not clearest:
            return None
        best = clearest[0]
        if len(clearest) > 1:
            # variants with equal patterns differ by rounding only: the first is taken
            mask = self.training_fit(base).evidence.estimation_mask
            again = self._priced_tests(base, [t.effect for t in clearest], mask)
            best = clearest[int(np.argmin([round(t.log_p, 6) for t in again]))]
        # most kinds have no physical limit, and their parameters need not be estimated
        impossible = False
        if np.isfinite(best.effect.kind.limit):
            values, std, _ = self.estimate(base, best.effect)
            impossible = bool(np.any(np.abs(values) - std > best.effect.kind.limit))
        # log p includes the price already
        log_p, log_tries = best.log_p + log_tries, log_tries + _price(base, best.effect)
        return replace(best, log_p=log_p, log_tries=log_tries, impossible=impossible)

    def _priced_tests(self, base, variants, hypotheses=slice(None)):
        """Return the tests of several variants of an effect, with their price, a list of Trial.

        `variants` are effects with values of their constants; each is added alone to the effects in
        `base`. Variants that cannot be estimated are left out. A variant with a constant that is
        rarely needed has a price, which is added to its log p. The p-values are averaged over the
        noise hypotheses in the mask `hypotheses`, (h,) of bool; by default over all.
        """
        trials = [t for t in self.tests(base, variants, hypotheses) if t]
        return [replace(t, log_p=t.log_p + _price(base, t.effect)) for t in trials]

    def estimate(self, base, effect):
        """Return the p parameters of an effect, their standard errors and their covariance, SI.

        The arrays have the shapes (p,), (p,) and (p, p). The fit has this `effect` and the effects
        in `base`, which are in the model already. Values and covariance are averaged over the noise
        hypotheses, the covariances that the noise may have, and combined from all axes. Parameters
        that no axis can estimate are zero.
        """
        training_fit, estimates = self.training_fit(base), []
        for axis in range(training_fit.evidence.axes):
            index, scale = training_fit.evidence.parameters_of((effect,), axis)
            fit = training_fit.fit((*base, effect), axis) if len(index) else None
            if fit is not None:
                # the last coefficients belong to the effect; each is a parameter times `scale`
                coefficients, covariance = (x[..., -len(index) :] for x in fit.average())
                covariance = covariance[-len(index) :] / np.outer(scale, scale)
                estimates.append((index, coefficients / scale, covariance))
        values, covariance = combine_axes(len(effect.parameters), estimates)
        return values, np.sqrt(np.diag(covariance)), covariance

    @property
    def kinds(self):
        """Kinds of effects that can be tried, a tuple.

        First come those with a list of variants, then those with a scan for the best variant.
        """
        return (*self.problem.variants, *self.problem.scans)

    def significant_effects(self, kinds):
        """Return the significant effects of the given `kinds`, a tuple, without cross-validation.

        Effects are added one by one, each time the effect with the smallest p-value, until none
        passes the test. After each addition the constants of the earlier effects are chosen again.
        """
        effects = ()
        while best := self.best_trial(effects, kinds):
            effects = self.with_best_variants((*effects, best.effect))
        return effects

    def best_trial(self, base, kinds):
        """Return the clearest Trial that passes the test, or None; `kinds` are the kinds to try.

        The clearest has the smallest p-value, with one exception. An effect of the present
        temperature goes before an effect of time or of the past temperature if the size of its log
        p is at least half (`AS_CLEARLY`) of the other's. The reason is that the temperature, the
        cause of such an effect, is measured. Formulas, effects without a known cause, are tried
        only if no other effect passes. `base` has the effects in the model.
        """
        named, formulas = ([k for k in kinds if k.is_formula == last] for last in (False, True))
        return self._best_of(base, named) or self._best_of(base, formulas)

    def _best_of(self, base, kinds):
        """Return the clearest Trial that passes the test, or None; `kinds` are the kinds to try.

        The clearest has the smallest p-value, with one exception. An effect of the present
        temperature goes before an effect of time or of the past temperature if the size of its log
        p is at least the share `AS_CLEARLY` of the other's. `base` has the effects in the model.
        """
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
        """Return the first Trial in a list whose effect these data cannot tell from the best one.

        Effects are alike if their patterns, the derivatives of the residuals by their parameters,
        are nearly the same in these data. In one attitude, for example, a change of scale factor is
        the same as a change of bias. So the order of the list decides. `base` has the effects in
        the model; `passing` is the list, and `best` is one of its Trials. If no other effect is
        like the best one, the result is `best`.
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

    def with_best_variants(self, effects):
        """Return the `effects` with their constants chosen again, a tuple.

        Each effect but the last, one after the other, gets the variant with the smallest p-value
        when it is added to all others. A variant is the effect with values of its constants. The
        last effect needs no new choice: it was chosen with the others in the model already. An
        effect without a list of variants, such as a step at any time, is searched again if the
        problem says so (`scans_again`); else it stays.
        """
        for i, effect in enumerate(effects[:-1]):
            variants, best = self.problem.variants.get(effect.kind, ()), None
            other_effects = effects[:i] + effects[i + 1 :]
            # only p-values of one kind are compared, so p-values are not corrected for the number
            # of variants: the logarithm of this number is taken as zero
            if len(variants) > 1:
                best = self.best_variant(other_effects, variants, log_tries=0.0)
            elif effect.kind in self.problem.scans and self.problem.scans_again:
                best = self.trial(other_effects, effect.kind)
            effects = (*effects[:i], best.effect, *effects[i + 1 :]) if best else effects
        return effects

    def refine(self, effects):
        """Return the `effects` with constants between the values of the grid, a tuple.

        The search takes the constants, such as a time constant, from a grid. Here the constants of
        one effect after the other are multiplied or divided by each of the `FACTORS` if this raises
        the likelihood.
        """
        for i, effect in enumerate(effects):
            other_effects = effects[:i] + effects[i + 1 :]
            # one linearisation, and so the same noise, for all constants
            training_fit = self.training_fit(other_effects)
            axes = range(training_fit.evidence.axes)
            fits = [training_fit.fit((*other_effects, effect), axis) for axis in axes]
            # an effect without such a constant is not changed by a factor
            if not all(fits) or effect.moved(2.0) == effect:
                continue
            hypotheses = [training_fit.hypothesis(fit) for fit in fits]
            for factor in FACTORS:
                variants = [effect.moved(f) for f in (1.0, 1 / factor, factor)]
                losses = []
                for variant in variants:
                    fits = [training_fit.fit((*other_effects, variant), axis) for axis in axes]
                    by_axis = zip(fits, hypotheses, strict=True)
                    losses.append(sum(fit.loss[h] if fit else np.inf for fit, h in by_axis))
                # equally likely to the sixth digit: the constant stays
                effect = variants[int(np.argmin(np.round(losses, 6)))]
            effects = (*effects[:i], effect, *effects[i + 1 :])
        return effects

    def effects_of_kinds(self, kinds):
        """Return a model with one effect of each of the given `kinds`, a tuple of Effect.

        The effects are added one after the other, significant or not. Their constants are those
        that fit the training rows best. A kind that cannot be estimated is left out.
        """
        # the model with all kinds but the last is stored, too, as later calls ask for it
        if kinds and kinds not in self._by_kinds:
            base = self.effects_of_kinds(kinds[:-1])
            trial = self.trial(base, kinds[-1])
            self._by_kinds[kinds] = (
                self.with_best_variants((*base, trial.effect)) if trial else base
            )
        return self._by_kinds.get(kinds, ())
