"""The search in static records: test every shape, add the best that passes, refit."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.diagnose.static_model import Pattern, Sight
from imuloop.diagnose.static_noise import log_p_values
from imuloop.diagnose.static_scan import line_scan, step_scan
from imuloop.effects.sinusoid import Sinusoid
from imuloop.effects.steps import Steps, joined

AXES = range(3)
# the families of patterns that are scanned
SCANS = (Sinusoid, Steps)
# share of log p by which shapes may differ and count as equally telling
ALIKE = 0.05
# steps in one record or another; logarithm of a p-value at which a second is not looked for
MOST_STEPS, HOPELESS = 6, 6.0


@dataclass(frozen=True)
class StaticTrial:
    """One effect, in its best shape, tested beside others.

    Attributes
    ----------
    pattern : Pattern
        The shape.
    log_p : float
        Logarithm of its p-value, times the number of shapes.
    axis : int
        The axis on which it shows most.
    axes : int
        Number of axes that it was tested on.
    tries : float
        Logarithm of the number of shapes.
    impossible : bool
        Whether a parameter would be larger than physics allows, by more than its standard error.
    """

    pattern: Pattern
    log_p: float
    axis: int
    axes: int
    tries: float = 0.0
    impossible: bool = False

    @property
    def p_value(self):
        """Probability of such a pattern without the effect, at most 1."""
        return float(min(1.0, np.exp(self.log_p)))


def fisher(log_p):
    """Return the logarithm of Fisher's combined p-value of k independent ones.

    ``-2 Σ log p`` is χ² with 2k degrees of freedom, whose tail is ``exp(-L) Σ_{i<k} Lⁱ/i!`` at
    ``L = -Σ log p``.
    """
    total = -sum(log_p)
    term = series = total * 0 + 1.0
    for i in range(1, len(log_p)):
        term = term * total / i
        series = series + term
    return np.log(series) - total


@dataclass
class StaticSearch:
    """A search that sees some windows.

    Attributes
    ----------
    sight : Sight
        What is seen.
    shapes : dict of type to tuple of Pattern
        The effects whose shapes are listed.
    significance : float
        Probability of a false alarm of the family.
    tests : int
        Number of tests of the family.
    """

    sight: Sight
    shapes: dict
    significance: float
    tests: int
    _trials: dict = field(default_factory=dict)
    _following: dict = field(default_factory=dict)

    def threshold(self, count):
        """Return the logarithm of the largest p-value that passes beside `count` effects: Holm."""
        return np.log(self.significance / max(1, self.tests - count))

    def fit(self, base, axis):
        """Return the fit of an axis with patterns; None where they are not independent."""
        return self.sight.fit(tuple(c for p in base for c in p.columns[axis]), axis)

    def test(self, base, pattern):
        """Return the trial of one pattern beside others; None where an axis cannot show it.

        Each axis has its own parameters and its own noise; their p-values are combined by Fisher's
        method.
        """
        pairs = self._pairs(base, pattern)
        if not pairs:
            return None
        log_p = log_p_values(pairs.values())
        best = min(zip(log_p, pairs, strict=True))[1]
        return StaticTrial(pattern, float(fisher(log_p)), best, len(pairs))

    def _pairs(self, base, pattern):
        """Return the fits without and with a pattern by axis; None where one cannot show it."""
        pairs = {}
        for axis in AXES:
            if pattern.columns[axis]:
                fit = self.fit((*base, pattern), axis)
                if fit is None:
                    return None
                pairs[axis] = self.fit(base, axis), fit
        return pairs

    def trial(self, base, cls, hopeful=False):
        """Return the best trial of an effect beside others, or None.

        A scan is cheap, a test of what it found is not: `hopeful` leaves out what by the noise
        without the pattern is no more than chance.
        """
        if cls in [type(p.effect) for p in base]:
            return None
        key = base, cls, hopeful and cls in SCANS
        if key not in self._trials:
            self._trials[key] = self._trial(*key)
        return self._trials[key]

    def _trial(self, base, cls, hopeful):
        if cls in self.shapes:
            patterns = self.shapes[cls]
            return self._best(base, patterns, np.log(len(patterns)))
        return (self._line if cls is Sinusoid else self._steps)(base, hopeful)

    def _line(self, base, hopeful):
        """Return the best trial of a line."""
        found, count = line_scan(self.sight, base)
        tries = np.log(max(count, 1))
        effects = [e for log_p, e in found if not hopeful or log_p + np.log(3) + tries < 0]
        return self._best(base, self.sight.model.patterns(effects), tries)

    def _steps(self, base, hopeful):
        """Return the best trial of one step, or of several, each the best beside those before.

        One step of two may tell nothing: the other looks like a walk. So one more is always tried.
        """
        best, taken, tries, beside = None, (), 0.0, ()
        for number in range(1, MOST_STEPS + 1):
            found, count = step_scan(self.sight, base + beside, taken)
            if not found:
                break
            promise, step = found[0]
            tries += np.log(count / number)
            if hopeful and number == 1 and promise + np.log(3) + tries > HOPELESS:
                break
            taken = (*taken, step)
            beside = self.sight.model.patterns([joined(taken)])
            trial = self._best(base, beside, tries)
            if best is not None and (trial is None or trial.log_p >= best.log_p):
                break
            best = trial or best
        return best

    def _best(self, base, patterns, tries):
        """Return the best trial of patterns, `tries` the logarithm of how many were looked at."""
        best = self._shape(base, patterns)
        if best is None:
            return None
        best = replace(best, log_p=best.log_p + tries, tries=tries)
        return replace(best, impossible=self._impossible(base, best.pattern))

    def _shape(self, base, patterns):
        """Return the trial of the best of several shapes, or None.

        The smallest p-value; of those as telling but for a share `ALIKE`, the one that fits the
        levels best, as the parameters are estimated: without a walk.
        """
        tried = [t for p in patterns if (t := self.test(base, p))]
        least = min((t.log_p for t in tried), default=0.0)
        alike = [t for t in tried if t.log_p <= (1 - ALIKE) * least]
        if len(alike) < 2:
            return alike[0] if alike else None
        still = self.sight.model.grid[:, 1] == 0
        # shapes that say the same in these data differ by rounding alone: the first counts
        return min(alike, key=lambda t: round(self._log_p(base, t.pattern, still), 6))

    def _log_p(self, base, pattern, points):
        """Return the sum of log p over the axes, with the noise at some points of the grid."""
        return sum(log_p_values(self._pairs(base, pattern).values(), points))

    def _impossible(self, base, pattern):
        limit = type(pattern.effect).limit
        if not np.isfinite(limit):
            return False
        for axis in AXES:
            k = len(pattern.columns[axis])
            fit = self.fit((*base, pattern), axis)
            if k and fit is not None:
                scale = self.sight.model.scale(pattern, axis)
                values = fit.values[-k:] / scale
                std = np.sqrt(np.diag(fit.spread)[-k:]) / scale
                if np.any(np.abs(values) - std > limit):
                    return True
        return False

    def best(self, base, banned=()):
        """Return the trial that passes with the smallest p-value beside others, or None."""
        kinds = [cls for cls in (*self.shapes, *SCANS) if cls not in banned]
        trials = [self.trial(base, cls, hopeful=True) for cls in kinds]
        passing = [
            t for t in trials if t and not t.impossible and t.log_p < self.threshold(len(base))
        ]
        return min(passing, key=lambda t: round(t.log_p, 6), default=None)

    def reshaped(self, base):
        """Return the same effects, all but the last in the shape that is best beside the others."""
        for i, pattern in enumerate(base[:-1]):
            patterns = self.shapes.get(type(pattern.effect), ())
            if len(patterns) > 1:
                others = base[:i] + base[i + 1 :]
                best = self._shape(others, patterns)
                base = (*base[:i], best.pattern, *base[i + 1 :])
        return base

    def following(self, classes):
        """Return effects of given classes, one after the other in the shape that is best here."""
        if classes and classes not in self._following:
            base = self.following(classes[:-1])
            trial = self.trial(base, classes[-1])
            self._following[classes] = self.reshaped((*base, trial.pattern)) if trial else base
        return self._following.get(classes, ())
