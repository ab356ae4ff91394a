"""The search: test every shape of every effect beside those found, on the training rows."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.fisher import fisher
from imuloop.estimate.likeness import ONE, share_on_axes
from imuloop.estimate.p_values import log_p_values
from imuloop.estimate.training_fit import combined_axes

# share of log p by which shapes may differ and count as equally significant
ALIKE = 0.05
# share of the logarithm of its p-value from which on the temperature goes before time
AS_CLEARLY = 0.5
# constants that lie between those of the shapes: moved by these factors, one after the other
FACTORS = (1.4, 1.2, 1.1, 1.05, 1.02)


def kinds_of(effects):
    """Return the kinds of effects, their shapes apart."""
    return tuple(effect.kind for effect in effects)


def _price(base, effect):
    """Return the price of a shape beside others: a device has one thermometer, and one lag."""
    if not effect.price:
        return 0.0
    paid = any(e.name == effect.name and e.constants == effect.constants for e in base)
    return 0.0 if paid else effect.price


def _of_temperature(effect):
    """Return whether an effect depends on the temperature itself."""
    return "temperature" in effect.needs and not effect.after_temperature


def _priced(base, trial):
    """Return a trial with the price of its shape in the p-value."""
    return replace(trial, log_p=trial.log_p + _price(base, trial.effect))


@dataclass(frozen=True)
class Trial:
    """An effect in its best shape, tested beside others."""

    effect: Effect
    log_p: float  # logarithm of the p-value, times the number of shapes
    axis: int  # on which it shows most
    axes: int  # that it was tested on
    tries: float = 0.0  # logarithm of the number of shapes
    # whether a parameter is larger than physics allows, by more than its standard error
    impossible: bool = False

    @property
    def p_value(self):
        """Probability of such a pattern without the effect, at most 1."""
        return float(min(1.0, np.exp(self.log_p)))


@dataclass
class Search:
    """A search of the data of a Problem that does not see the parts `held_out`."""

    problem: object
    held_out: frozenset
    _trials: dict = field(default_factory=dict)
    _following: dict = field(default_factory=dict)

    def threshold(self, count):
        """Return the logarithm of the largest p-value that passes beside `count` effects: Holm."""
        settings = self.problem.settings
        return np.log(settings.significance / max(1, self.problem.tests - count))

    def training_fit(self, base):
        """Return the TrainingFit, about the solution with some effects."""
        return self.problem.training_fit(base, self.held_out)

    def test(self, base, effect):
        """Return the Trial of one shape beside others; None where an axis cannot show it."""
        return self.tests(base, (effect,))[0]

    def tests(self, base, effects, hypotheses=slice(None)):
        """Return the Trial of each of several shapes beside others, None where it is not seen.

        Each axis has its own parameters and its own noise; their p-values are combined by Fisher's
        method. With `hypotheses`, a mask, by some about the noise alone.
        """
        training_fit = self.training_fit(base)
        patterns, axes = training_fit.evidence.patterns(effects), range(training_fit.evidence.axes)
        shown = [[axis for axis in axes if p.columns[axis]] for p in patterns]
        plain = [training_fit.fit(base, axis) for axis in axes]
        each = zip(*training_fit.fits(base, [(e,) for e in effects]), strict=True)
        pairs = [
            [(plain[axis], fits[axis]) for axis in own]
            for own, fits in zip(shown, each, strict=True)
        ]
        seen = [k for k, own in enumerate(pairs) if own and all(p and f for p, f in own)]
        log_p = iter(log_p_values([pair for k in seen for pair in pairs[k]], hypotheses))
        found = [None] * len(effects)
        for k in seen:
            own = {axis: next(log_p) for axis in shown[k]}
            joint = float(fisher(own.values()))
            found[k] = Trial(effects[k], joint, min(own, key=own.get), len(own))
        return found

    def trial(self, base, kind, hopeful=False):
        """Return the best trial of a kind of effect beside others, or None.

        `hopeful` leaves out what a scan, which is cheap, finds no more than chance: tests are not.
        """
        if kind in kinds_of(base):
            return None
        hopeful = hopeful and kind in self.problem.scans
        key = base, kind, hopeful
        if key not in self._trials:
            if kind in self.problem.scans:
                self._trials[key] = self.problem.scans[kind](self, base, hopeful)
            else:
                shapes = self.problem.shapes[kind]
                # one with a price is tried as if it were as many times less likely
                tries = np.log(sum(np.exp(-shape.price) for shape in shapes))
                self._trials[key] = self.shaped(base, shapes, tries)
        return self._trials[key]

    def shaped(self, base, shapes, tries):
        """Return the Trial of the best of several shapes, `tries` the log of how many, or None.

        The smallest p-value; of those as significant but for a share `ALIKE`, the one that fits
        best as the parameters are estimated.
        """
        tried = [_priced(base, t) for t in self.tests(base, shapes) if t]
        least = min((t.log_p for t in tried), default=0.0)
        alike = [t for t in tried if t.log_p <= (1 - ALIKE) * least]
        if not alike:
            return None
        best = alike[0]
        if len(alike) > 1:
            # shapes that say the same in these data differ by rounding alone: the first counts
            mask = self.training_fit(base).evidence.estimation_mask
            retried = self.tests(base, [t.effect for t in alike], mask)
            best = alike[int(np.argmin([round(_priced(base, t).log_p, 6) for t in retried]))]
        impossible, price = self._impossible(base, best.effect), _price(base, best.effect)
        return replace(best, log_p=best.log_p + tries, tries=tries + price, impossible=impossible)

    def _impossible(self, base, effect):
        """Return whether a parameter is beyond its limit by more than its error."""
        if not np.isfinite(effect.kind.limit):
            return False
        values, std, _ = self.beside(base, effect)
        return bool(np.any(np.abs(values) - std > effect.kind.limit))

    def beside(self, base, effect):
        """Return an effect's parameters beside others, and standard errors, (p,), and covariance.

        Averaged over the noise; zero on an axis that does not have them.
        """
        training_fit, count = self.training_fit(base), len(effect.parameters)
        (pattern,) = training_fit.evidence.patterns((effect,))
        estimates = []
        for axis, (own, at, scale) in enumerate(pattern.on_axes):
            fit = training_fit.fit((*base, effect), axis) if own else None
            if fit is not None:
                found, spread = fit.averaged(fit.weight)
                spread = spread[-len(own) :, -len(own) :] / np.outer(scale, scale)
                estimates.append((at, found[-len(own) :] / scale, spread))
        values, covariance = combined_axes(count, estimates)
        return values, np.sqrt(np.diag(covariance)), covariance

    @property
    def kinds(self):
        """All kinds of effects that can be tried."""
        return (*self.problem.shapes, *self.problem.scans)

    def significant(self, kinds):
        """Return the effects of some kinds that are significant, each beside those before it.

        The clearest comes first.
        """
        base = ()
        while best := self.best(base, kinds):
            base = self.reshaped((*base, best.effect))
        return base

    def best(self, base, kinds):
        """Return the trial of some kinds that passes with the smallest p-value, or None.

        What time or the past of a temperature explains the temperature itself explains first, where
        it does so at least half as clearly: it is a cause that is logged. Formulas come last.
        """
        named, formulas = ([k for k in kinds if k.is_formula == last] for last in (False, True))
        return self._best_of(base, named) or self._best_of(base, formulas)

    def _best_of(self, base, kinds):
        trials = [self.trial(base, kind, hopeful=True) for kind in kinds]
        passing = [
            t for t in trials if t and not t.impossible and t.log_p < self.threshold(len(base))
        ]
        best = min(passing, key=lambda t: round(t.log_p, 6), default=None)
        if best and best.effect.after_temperature:
            clear = AS_CLEARLY * best.log_p
            warm = [t for t in passing if t.log_p < clear and _of_temperature(t.effect)]
            passing = warm or passing
            best = min(passing, key=lambda t: round(t.log_p, 6))
        return self._first_alike(base, best, passing) if best else None

    def _first_alike(self, base, best, passing):
        """Return the first trial that does all that the best does: a bias in one attitude."""
        training_fit = self.training_fit(base)
        for trial in passing:
            patterns = training_fit.evidence.patterns((best.effect, trial.effect))
            # what has more columns does more
            alike, own = ([*map(len, pattern.columns)] for pattern in patterns)
            share = share_on_axes(training_fit, best.effect, trial.effect) if alike == own else 0.0
            if trial is best or share > ONE:
                return trial

    def reshaped(self, base):
        """Return the same effects, all but the last in the shape that is best beside the others."""
        for i, effect in enumerate(base[:-1]):
            shapes, others = self.problem.shapes.get(effect.kind, ()), base[:i] + base[i + 1 :]
            best = None
            if len(shapes) > 1:
                best = self.shaped(others, shapes, 0.0)
            elif effect.kind in self.problem.scans and self.problem.scans_again:
                best = self.trial(others, effect.kind)
            base = (*base[:i], best.effect, *base[i + 1 :]) if best else base
        return base

    def finer(self, base):
        """Return effects with the constants, between those of their shapes, that fit best."""
        for i, effect in enumerate(base):
            others = base[:i] + base[i + 1 :]
            # about one fit, and so by one noise, whatever the constants
            training_fit = self.training_fit(others)
            axes = range(training_fit.evidence.axes)
            fits = [training_fit.fit((*others, effect), axis) for axis in axes]
            if not all(fits) or effect.moved(2.0) == effect:
                continue
            hypotheses = [training_fit.hypothesis(fit) for fit in fits]
            for factor in FACTORS:
                near = [effect.moved(f) for f in (1.0, 1 / factor, factor)]
                each = ([training_fit.fit((*others, e), axis) for axis in axes] for e in near)
                each = [zip(own, hypotheses, strict=True) for own in each]
                spent = [sum(f.spent[h] if f else np.inf for f, h in own) for own in each]
                effect = near[int(np.argmin(np.round(spent, 6)))]
            base = (*base[:i], effect, *base[i + 1 :])
        return base

    def following(self, kinds):
        """Return effects of given kinds, one after the other in the shape that is best here."""
        if kinds and kinds not in self._following:
            base = self.following(kinds[:-1])
            trial = self.trial(base, kinds[-1])
            self._following[kinds] = self.reshaped((*base, trial.effect)) if trial else base
        return self._following.get(kinds, ())
