"""The choice of the noise terms that a record supports.

The terms of a model are a tuple. It has the letters of Q, N, B, K in this order, 'R' for a ramp,
and the correlation time, s, of each Gauss-Markov process.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import erfc, sqrt

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkovTerm
from imuloop.noise.gains import LowPass
from imuloop.noise.likelihood import Likelihood, likeliest
from imuloop.noise.modes import Modes
from imuloop.noise.processes import NAMES

# shortest correlation time that is tried, in samples: a low-pass filter has the same spectrum as a
# process with a shorter one
SHORTEST = 10.0
# longest correlation time, as a share of the usual time between two disturbances: a process with a
# longer one looks like a walk
LONGEST = 1 / 8
# independent tests per decade of correlation times
TESTS = 2.5
# largest number of Gauss-Markov processes
MOST = 3
# a smaller gain in log-likelihood counts as none: each fit ends within this distance of the maximum
NOTHING = 1e-4
# least share of a session between two disturbances with which walk and ramp are told from flicker:
# shorter rests, each with its own mean, show little of the change between them
LASTING = 1 / 8
ORDER = (*NAMES, "R")


def without(terms, term):
    """Return the tuple `terms` of noise terms without one of them, `term`."""
    return tuple(t for t in terms if t != term)


def plus(terms, term):
    """Return the tuple of noise terms `terms` and one more, `term`, in the usual order.

    Letters come first, ordered as in `ORDER`, then correlation times, s, of Gauss-Markov processes.
    """
    extended = (*terms, term)
    return (*(t for t in ORDER if t in extended), *correlation_times(extended))


def variances(terms):
    """Return the noise terms among `terms` that have a variance, a tuple: all but a ramp."""
    return without(terms, "R")


def correlation_times(terms):
    """Return the correlation times, s, among the noise terms `terms`, a tuple.

    Each stands for a Gauss-Markov process. The other terms are letters.
    """
    return tuple(t for t in terms if not isinstance(t, str))


@dataclass(frozen=True)
class Selection:
    """The likelihood of one axis as a function of its noise terms, and the choice of the terms."""

    modes: Modes
    likelihood: Likelihood
    level: float  # probability that an absent term counts as supported
    low_pass: LowPass | None = None  # filter behind all terms but quantisation
    _fits: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    def weighted(self, weight):
        """Return this Selection with the weight of each of r rows multiplied by `weight`, (r,).

        A row is a slow mode or a bin of fast modes (`Modes`).
        """
        count = self.likelihood.count * weight
        return replace(self, likelihood=replace(self.likelihood, count=count))

    def unit(self, term):
        """Return the expected mean square of each of r rows for a noise term of size 1, (r,), SI.

        A row is a slow mode or a bin of fast modes (`Modes`). If there is a low-pass filter, the
        mean square is that behind the filter, except for Q: quantisation arises there. `term` is a
        letter of Q, N, B, K, whose coefficient is then 1, or the correlation time, s, of a
        Gauss-Markov process of variance 1.
        """
        unit = self.modes.unit(term)
        return unit * self.modes.gain(self.low_pass) if self.low_pass and term != "Q" else unit

    def units(self, terms):
        """Return the expected mean squares of r rows for each of p noise terms of size 1, (r, p).

        A row is a slow mode or a bin of fast modes (`Modes`). `terms` are the p terms, and possibly
        a ramp, which is left out as it has no variance.
        """
        return np.column_stack([self.unit(term) for term in variances(terms)])

    def fit(self, terms, start=None):
        """Return the MaximumLikelihood of the model with the given noise terms.

        `terms` is a tuple of letters and correlation times, s. `start`, (p,), may be variances near
        the maximum, from which the fit begins, for the p terms other than a ramp. The fit of a
        model is made once and kept, so a later `start` for the same terms has no effect.
        """
        if terms not in self._fits:
            ramp = None if "R" in terms else 0.0
            self._fits[terms] = self.likelihood.fit(self.units(terms), ramp, start=start)
        return self._fits[terms]

    def noise(self, terms):
        """Return the AxisNoise with the fitted coefficients of noise terms, without intervals.

        `terms` is a tuple of letters and correlation times, s. A ramp among them is left out.
        """
        values = dict(zip(variances(terms), np.sqrt(self.fit(terms).theta), strict=True))
        letters = {name: Coefficient(values[name]) for name in values if name in NAMES}
        drives = {t: np.sqrt(2 / t) * values[t] for t in correlation_times(terms)}
        processes = [GaussMarkovTerm(Coefficient(q), Coefficient(t)) for t, q in drives.items()]
        return AxisNoise(**letters, gauss_markov=tuple(processes))

    def p_value(self, term, terms):
        """Return the p-value of a noise term: the chance that an absent term gains as much.

        The gain is in log-likelihood: the model of all `terms`, `term` among them, is compared with
        the model without `term`. For a ramp, twice the gain is a chi-square variable of one degree
        of freedom. The variance of another term cannot be negative, so if the term is absent, the
        fitted variance is 0 in half of all cases and gains nothing: the p-value is half as large.
        For a Gauss-Markov process, the p-value allows for all the correlation times that were
        tried.
        """
        gain = self.fit(terms).value - self.fit(without(terms, term)).value
        chance = erfc(sqrt(gain)) if gain > NOTHING else 1.0
        if isinstance(term, str):
            return chance if term == "R" else chance / 2
        return min(1.0, chance / 2 * (1 + TESTS * np.log10(self.times[-1] / self.times[0])))

    @property
    def times(self):
        """Correlation times that are tried for a Gauss-Markov process, s, (k,), ascending."""
        times = self.modes.correlation_times
        longest = LONGEST * self.modes.usual_level
        return times[(times >= SHORTEST * self.modes.dt) & (times <= longest)]

    @property
    def candidates(self):
        """Letters of the noise terms that the record can tell from each other, a tuple.

        A level is a stretch between two disturbances. Random walk and ramp are left out if every
        level is shorter than the share `LASTING` of the longest power cycle, because flicker then
        looks the same.
        """
        lasting = self.modes.longest_level >= LASTING * self.modes.span
        return ORDER if lasting else without(NAMES, "K")

    @cached_property
    def supported(self):
        """The noise terms that the record supports, a tuple of letters and correlation times, s.

        The search starts from all candidates but a ramp. A term passes its test if its p-value is
        at most `level`. First, terms that fail are removed, the worst first. Then the absent term
        that passes its test best is added; this is a Gauss-Markov process only if no other absent
        term passes. Both steps are repeated until nothing changes.
        """
        terms, seen = variances(self.candidates), []
        while terms not in seen:
            seen.append(terms)
            terms = self._with_best_absent(self._without_failed(terms))
        return self._without_failed(terms)

    def _without_failed(self, terms):
        """Return the noise terms `terms`, a tuple, without those that fail their test.

        A term fails if its p-value in the model of the remaining terms is above `level`. Failed
        terms are removed one by one, the one with the largest p-value first, but white noise last.
        At least one term with a variance stays.
        """
        while True:
            p = {t: self.p_value(t, terms) for t in terms if variances(without(terms, t))}
            failed = [t for t in p if p[t] > self.level]
            if not failed:
                return terms
            # no sensor is without white noise: of the terms that fail, it is removed last
            worst = max([t for t in failed if t != "N"] or failed, key=p.get)
            terms = without(terms, worst)

    def _with_best_absent(self, terms):
        """Return the noise terms `terms`, a tuple, with the absent term that passes its test best.

        A term passes if its p-value in the model with it is at most `level`. A Gauss-Markov process
        is added only if no other absent term passes. If none passes, the result is `terms`.
        """
        p = {t: self.p_value(t, plus(terms, t)) for t in self.candidates if t not in terms}
        best = min(p, key=p.get, default=None)
        if best is not None and p[best] <= self.level:
            return plus(terms, best)
        if len(correlation_times(terms)) == MOST or not len(self.times):
            return terms
        start = np.append(self.fit(terms).theta, 0.0)
        tc = max(self.times.tolist(), key=lambda tc: self.fit(plus(terms, tc), start).value)
        if self.p_value(tc, plus(terms, tc)) > self.level:
            return terms
        # the most likely correlation time near the best of those that were tried
        step = self.modes.correlation_times[1] / self.modes.correlation_times[0]
        ends = tc / step**1.5, min(tc * step**1.5, LONGEST * self.modes.usual_level)
        return plus(terms, likeliest(lambda tc: self.fit(plus(terms, tc)).value, *ends))
