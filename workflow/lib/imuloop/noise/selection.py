"""Which noise terms a record supports.

The terms of a model are a tuple: of Q, N, B, K in this order, 'R' for a ramp, and the correlation
times of Gauss-Markov processes in s.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import erfc, sqrt

import numpy as np
from scipy.optimize import minimize_scalar

from imuloop.noise.likelihood import Likelihood
from imuloop.noise.modes import Modes
from imuloop.noise.processes import NAMES

# correlation times from so many samples, below which a filter does the same, to such a share of
# the usual time without a new level: over less a process is a walk, which short rests cannot tell
SHORTEST, LONGEST = 10.0, 1 / 8
# independent tests per decade of correlation times
TESTS = 2.5
# processes at most
MOST = 3
# a term that raises the log-likelihood by less raises it by nothing: fits end so near the maximum
NOTHING = 1e-4
# share of a session over which one level has to last before walk or ramp is told from flicker:
# from short rests, each at its own level, it would be carried on over all that lies between
LASTING = 1 / 8
ORDER = (*NAMES, "R")


def without(terms, term):
    """Return the terms without one."""
    return tuple(t for t in terms if t != term)


def plus(terms, term):
    """Return the terms with one more, in order."""
    every = (*terms, term)
    return (*(t for t in ORDER if t in every), *correlation_times(every))


def variances(terms):
    """Return the terms that a spectrum is a sum of: all but a ramp."""
    return without(terms, "R")


def correlation_times(terms):
    """Return the correlation times of the Gauss-Markov processes, s."""
    return tuple(t for t in terms if not isinstance(t, str))


@dataclass(frozen=True)
class Selection:
    """The likelihood of one axis as a function of the terms, and the choice of these.

    `level` is that at which a term counts as supported; `gain`, shape (r,), is the power gain of
    the filter behind all terms but quantisation.
    """

    modes: Modes
    likelihood: Likelihood
    level: float
    gain: object = 1.0
    _fits: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    def weighted(self, count):
        """Return the same with other weights of the rows."""
        return replace(self, likelihood=replace(self.likelihood, count=count))

    def filtered(self, low_pass):
        """Return the same behind a LowPass, or without one (None)."""
        return replace(self, gain=1.0 if low_pass is None else self.modes.gain(low_pass))

    def unit(self, term):
        """Return `Modes.unit` of a term behind the filter, shape (r,)."""
        return self.modes.unit(term) * (1.0 if term == "Q" else self.gain)

    def units(self, terms):
        """Return the unit spectra of terms, ramp excepted, shape (r, p)."""
        none = np.empty((len(self.modes.frequency), 0))
        return np.column_stack([none, *map(self.unit, variances(terms))])

    def fit(self, terms, restricted=False):
        """Return the MaximumLikelihood of these terms."""
        ramp = "R" in terms
        key = terms, restricted and ramp
        if key not in self._fits:
            units = self.units(terms)
            self._fits[key] = self.likelihood.fit(units, ramp, restricted=restricted)
        return self._fits[key]

    def squares(self, terms):
        """Return the fitted variance of each term, ramp excepted, SI squared."""
        return dict(zip(variances(terms), self.fit(terms).theta, strict=True))

    def p_value(self, term, gain):
        """Return the probability that an absent term gains so much log-likelihood.

        Half a chi-square of one degree for a variance, which cannot be negative; a ramp can.
        """
        chance = erfc(sqrt(gain if gain > NOTHING else 0.0))
        if term == "R":
            return chance
        return min(1.0, chance / 2 * (1.0 if isinstance(term, str) else self.tests))

    @property
    def times(self):
        """Correlation times that are tried, s."""
        times = self.modes.correlation_times
        longest = LONGEST * self.modes.usual
        return times[(times >= SHORTEST * self.modes.dt) & (times <= longest)]

    @property
    def tests(self):
        """Effective number of independent tests of the correlation times."""
        times = self.times
        return 1.0 if len(times) < 2 else 1 + TESTS * np.log10(times[-1] / times[0])

    @property
    def candidates(self):
        """Terms that the record can tell from each other."""
        lasting = self.modes.level >= LASTING * self.modes.span
        return ORDER if lasting else without(NAMES, "K")

    @cached_property
    def supported(self):
        """The supported terms.

        Those of the non-negative fit, less what fails its test, worst first; then what passes
        beside them, best first, a Gauss-Markov process only where no other does; and again.
        """
        squares = self.squares(variances(self.candidates))
        terms, seen = tuple(name for name, square in squares.items() if square > 0), []
        while terms not in seen:
            seen.append(terms)
            terms = self._grown(self._shrunk(terms))
        return self._shrunk(terms)

    def _chance(self, term, terms, rest):
        """Return the p-value of a term in a model beside that without it."""
        return self.p_value(term, self.fit(terms).value - self.fit(rest).value)

    def _shrunk(self, terms):
        while len(terms) > 1:
            p = {t: self._chance(t, terms, without(terms, t)) for t in terms}
            failed = [t for t in p if p[t] > self.level]
            # no sensor is without white noise: it goes last of those that fail
            worst = max([t for t in failed if t != "N"] or failed, key=p.get, default=None)
            rest = without(terms, worst)
            if worst is None or not variances(rest):
                break
            terms = rest
        return terms

    def _grown(self, terms):
        absent = [t for t in self.candidates if t not in terms]
        p = {t: self._chance(t, plus(terms, t), terms) for t in absent}
        best = min(p, key=p.get, default=None)
        if best is not None and p[best] <= self.level:
            return plus(terms, best)
        if len(correlation_times(terms)) == MOST or not len(self.times):
            return terms
        base = self.fit(terms)
        start = np.append(base.theta, 0.0)
        gains = {
            tc: self.likelihood.fit(self.units(plus(terms, tc)), "R" in terms, start=start).value
            for tc in self.times.tolist()
        }
        tc = max(gains, key=gains.get)
        if self.p_value(tc, gains[tc] - base.value) > self.level:
            return terms
        terms = plus(terms, tc)
        places = range(len(terms) - len(correlation_times(terms)), len(terms))
        for place in [*places] * min(len(places), 2):
            terms = self._refined(terms, place)
        return terms

    def _refined(self, terms, place):
        """Return the terms with the most likely correlation time at a place."""
        step = np.log(self.times[1] / self.times[0]) if len(self.times) > 1 else 0.3

        def moved(x):
            return (*terms[:place], float(np.exp(x)), *terms[place + 1 :])

        around = np.log(terms[place]) + np.array([-1.5, 1.5]) * step
        around[1] = min(around[1], np.log(LONGEST * self.modes.usual))
        found = minimize_scalar(
            lambda x: -self.fit(moved(x)).value, bounds=around, method="bounded"
        )
        return moved(found.x)
