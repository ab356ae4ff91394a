"""Which noise terms a record supports.

The terms of a model are a tuple. It holds the letters of Q, N, B, K in this order, 'R' for a ramp,
and the correlation time of each Gauss-Markov process, s.
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

# correlation times that are tried: at least so many samples, below which a filter does the same;
# and at most this share of the usual time without a new level: longer processes look like a walk
SHORTEST, LONGEST = 10.0, 1 / 8
# independent tests per decade of correlation times
TESTS = 2.5
# processes at most
MOST = 3
# gain in log-likelihood below which a term gains nothing: fits end so near the maximum
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
    """The likelihood of one axis as a function of the terms, and the choice of these."""

    modes: Modes
    likelihood: Likelihood
    level: float  # chance at which a term that is absent counts as supported
    low_pass: LowPass | None = None  # filter behind all terms but quantisation
    _fits: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    def weighted(self, count):
        """Return the same with another `count` of the likelihood, (r,)."""
        return replace(self, likelihood=replace(self.likelihood, count=count))

    def filtered(self, low_pass):
        """Return the same behind a LowPass."""
        return replace(self, low_pass=low_pass)

    def unit(self, term):
        """Return the expected mean squares for a unit term behind the filter, shape (r,)."""
        unit = self.modes.unit(term)
        return unit * self.modes.gain(self.low_pass) if self.low_pass and term != "Q" else unit

    def units(self, terms):
        """Return the expected mean squares for unit terms, all but a ramp, shape (r, p)."""
        none = np.empty((len(self.modes.frequency), 0))
        return np.column_stack([none, *map(self.unit, variances(terms))])

    def fit(self, terms, start=None):
        """Return the MaximumLikelihood of terms; `start` as `Likelihood.fit` takes it."""
        if terms not in self._fits:
            ramp = None if "R" in terms else 0.0
            self._fits[terms] = self.likelihood.fit(self.units(terms), ramp, start=start)
        return self._fits[terms]

    def squares(self, terms):
        """Return the fitted variance of each term but a ramp, SI squared, a dict."""
        return dict(zip(variances(terms), self.fit(terms).theta, strict=True))

    def noise(self, terms):
        """Return the AxisNoise of terms but a ramp, with fitted values and without intervals."""
        values = {term: np.sqrt(square) for term, square in self.squares(terms).items()}
        letters = {t: Coefficient(value) for t, value in values.items() if isinstance(t, str)}
        drives = {t: np.sqrt(2 / t) * values[t] for t in correlation_times(terms)}
        processes = [GaussMarkovTerm(Coefficient(q), Coefficient(t)) for t, q in drives.items()]
        return AxisNoise(**letters, gauss_markov=tuple(processes))

    def p_value(self, term, gain):
        """Return the probability that an absent term gains so much log-likelihood.

        Twice the gain is a chi-square variable of one degree for a ramp. For a variance, which
        cannot be negative, it is 0 in half of all cases.
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

        They begin as those of the non-negative fit. The terms that fail their test go, worst first.
        Then the term enters that passes best, a Gauss-Markov process only where no other term does.
        Both are repeated until nothing changes.
        """
        squares = self.squares(variances(self.candidates))
        terms, seen = tuple(name for name, square in squares.items() if square > 0), []
        while terms not in seen:
            seen.append(terms)
            terms = self._with_best_absent(self._without_failed(terms))
        return self._without_failed(terms)

    def _chance(self, term, terms, rest):
        """Return the p-value of a term in a model beside that without it."""
        return self.p_value(term, self.fit(terms).value - self.fit(rest).value)

    def _without_failed(self, terms):
        """Return the terms without those that fail their test, the worst first."""
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

    def _with_best_absent(self, terms):
        """Return the terms with that absent one which passes its test best, if one does."""
        absent = [t for t in self.candidates if t not in terms]
        p = {t: self._chance(t, plus(terms, t), terms) for t in absent}
        best = min(p, key=p.get, default=None)
        if best is not None and p[best] <= self.level:
            return plus(terms, best)
        if len(correlation_times(terms)) == MOST or not len(self.times):
            return terms
        start = np.append(self.fit(terms).theta, 0.0)
        tc = max(self.times.tolist(), key=lambda tc: self.fit(plus(terms, tc), start).value)
        if self._chance(tc, plus(terms, tc), terms) > self.level:
            return terms
        terms = plus(terms, tc)
        places = range(len(terms) - len(correlation_times(terms)), len(terms))
        for place in [*places] * min(len(places), 2):
            terms = self._with_likeliest_time(terms, place)
        return terms

    def _with_likeliest_time(self, terms, place):
        """Return the terms with the most likely correlation time at an index."""

        def moved(u):
            return (*terms[:place], float(np.exp(u)), *terms[place + 1 :])

        step = np.log(self.modes.correlation_times[1] / self.modes.correlation_times[0])
        u, longest = np.log(terms[place]), np.log(LONGEST * self.modes.usual)
        low, high = u - 1.5 * step, min(u + 1.5 * step, longest)
        return moved(likeliest(lambda u: self.fit(moved(u)).value, low, high))
