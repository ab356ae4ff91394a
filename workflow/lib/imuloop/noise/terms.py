"""Which noise terms a record supports."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import erfc, sqrt

import numpy as np

from imuloop.noise.processes import NAMES

# correlation times from so many samples, below which a filter does the same, to such a share of
# the longest time without a new level: over less a process is a walk, which short rests cannot tell
SHORTEST, LONGEST = 10.0, 1 / 8
# independent tests a decade of correlation times
TESTS = 2.5
# processes at most
MOST = 3
# a term that raises the log-likelihood by less raises it by nothing: fits end so near the maximum
NOTHING = 1e-4
# a fit gains less than so many times what its beginning lets expect
LEEWAY = 4.0
# share of a session over which one level has to last before walk or ramp is told from flicker:
# from short rests, each at a level of its own, it would be carried on over all that lies between
LASTING = 1 / 8


@dataclass(frozen=True)
class Terms:
    """Terms of a model.

    Attributes
    ----------
    names : tuple of str
        Of Q, N, B, K.
    ramp : bool
        Whether there is a ramp.
    times : tuple of float
        Correlation times of the Gauss-Markov processes, s.
    """

    names: tuple[str, ...] = ()
    ramp: bool = False
    times: tuple[float, ...] = ()

    def __len__(self):
        return len(self.names) + self.ramp + len(self.times)

    def without(self, term):
        """Return the terms without one: a name, 'R' or a correlation time."""
        if term == "R":
            return replace(self, ramp=False)
        return replace(
            self,
            names=tuple(n for n in self.names if n != term),
            times=tuple(t for t in self.times if t != term),
        )

    def plus(self, term):
        """Return the terms with one more."""
        if term == "R":
            return replace(self, ramp=True)
        if isinstance(term, str):
            return replace(self, names=tuple(n for n in NAMES if n in (*self.names, term)))
        return replace(self, times=(*self.times, term))

    def __iter__(self):
        yield from self.names
        if self.ramp:
            yield "R"
        yield from self.times


@dataclass(frozen=True)
class Search:
    """The likelihood of one axis as a function of the terms.

    Attributes
    ----------
    modes : Modes
        Of the record.
    likelihood : Likelihood
        Of the axis.
    level, hump_level : float
        Levels at which one of the five terms, and a Gauss-Markov process, counts as supported.
    start : ndarray, shape (4,), optional
        Squares of Q, N, B, K that the first fit begins with.
    """

    modes: object
    likelihood: object
    level: float
    hump_level: float
    start: np.ndarray | None = None
    _fits: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    def units(self, terms):
        """Return the unit spectra of terms, ramp excepted, shape (r, p)."""
        columns = [self.modes.units[:, NAMES.index(name)] for name in terms.names]
        columns += [self.modes.gauss_markov(tc) for tc in terms.times]
        if not columns:
            return np.zeros((len(self.modes.frequency), 0))
        return np.column_stack(columns)

    def fit(self, terms, restricted=False):
        """Return the Fit of these terms."""
        key = terms, restricted and terms.ramp
        if key not in self._fits:
            units = self.units(terms)
            self._fits[key] = self.likelihood.fit(units, terms.ramp, restricted=restricted)
        return self._fits[key]

    def p_value(self, term, gain):
        """Return the probability of such a gain of log-likelihood by a term that is not there.

        Half a chi-square of one degree for a variance, which cannot be negative; a ramp can.
        """
        one = erfc(sqrt(gain if gain > NOTHING else 0.0))
        if term == "R":
            return one
        return min(1.0, one / 2 * (1.0 if isinstance(term, str) else self.tests))

    def _chance(self, term, terms, without):
        """Return the p-value of a term in a model beside that without it."""
        return self.p_value(term, self.fit(terms).value - self.fit(without).value)

    def _level(self, term):
        return self.level if isinstance(term, str) else self.hump_level

    @property
    def times(self):
        """Correlation times that are tried, s."""
        times = self.modes.correlation_times
        longest = LONGEST * self.modes.level
        return times[(times >= SHORTEST * self.modes.dt) & (times <= longest)]

    @property
    def tests(self):
        """Independent tests that the correlation times amount to."""
        times = self.times
        return 1.0 if len(times) < 2 else 1 + TESTS * np.log10(times[-1] / times[0])

    @property
    def candidates(self):
        """Terms that the record can tell from each other."""
        lasting = self.modes.level >= LASTING * self.modes.span
        return (*NAMES, "R") if lasting else tuple(n for n in NAMES if n != "K")

    def select(self):
        """Return the supported terms.

        Those of the non-negative fit, less what fails its test, worst first; then what passes
        beside them, best first, a Gauss-Markov process only where no other does; and again.
        """
        return self._selected

    @cached_property
    def _selected(self):
        names = tuple(n for n in NAMES if n in self.candidates)
        start = None if self.start is None else self.start[[NAMES.index(n) for n in names]]
        full = self.likelihood.fit(self.units(Terms(names)), start=start)
        terms = Terms(tuple(n for n, v in zip(names, full.theta, strict=True) if v > 0))
        seen = []
        while terms not in seen:
            seen.append(terms)
            terms = self._grown(self._shrunk(terms))
        return self._shrunk(terms)

    def _shrunk(self, terms):
        while len(terms) > 1:
            p = {t: self._chance(t, terms, terms.without(t)) / self._level(t) for t in terms}
            # no sensor is without white noise: it goes last of those that fail
            failed = [t for t in p if p[t] > 1]
            worst = max([t for t in failed if t != "N"] or p, key=p.get)
            rest = terms.without(worst)
            if p[worst] <= 1 or not (rest.names or rest.times):
                break
            terms = rest
        return terms

    def _grown(self, terms):
        absent = [t for t in self.candidates if t not in tuple(terms)]
        p = {t: self._chance(t, terms.plus(t), terms) for t in absent}
        best = min(p, key=p.get, default=None)
        if best is not None and p[best] <= self.level:
            return terms.plus(best)
        if len(terms.times) == MOST or not len(self.times):
            return terms
        base = self.fit(terms)
        # most are not there: none of it is close to the best fit, and few are worth a fit
        start, expected = np.append(base.theta, 0.0), self._expected_gains(terms, base)
        highest = expected.max()
        if self.p_value(0.0, LEEWAY * highest) > self.hump_level:
            return terms
        times = self.times[LEEWAY * expected >= highest].tolist()
        values = [
            self.likelihood.fit(self.units(terms.plus(tc)), terms.ramp, start=start).value
            for tc in times
        ]
        tc = times[int(np.argmax(values))]
        if self.p_value(tc, max(values) - base.value) > self.hump_level:
            return terms
        return self._refined(terms.plus(tc))

    def _expected_gains(self, terms, fit):
        r"""Return the gain of log-likelihood by each process as its derivatives at zero tell.

        .. math:: u^2/2I, \quad u = \partial\ell/\partial v > 0, with I the information on the
            variance v that the other variances leave
        """
        units = self.units(terms)
        expected = self.likelihood.above_rounding(units @ fit.theta)
        root = np.sqrt(self.likelihood.count / 2) / expected
        basis = np.linalg.qr(root[:, None] * units)[0]
        rows = root * np.array([self.modes.gauss_markov(tc) for tc in self.times])
        left = rows - rows @ basis @ basis.T
        slope = rows @ (root * (self.likelihood.power(fit.ramp) - expected))
        return np.maximum(slope, 0.0) ** 2 / (2 * (left**2).sum(axis=1))

    def _refined(self, terms):
        """Return the terms with the most likely correlation times."""
        # loads for a quarter of a second, and few records show such a process
        from scipy.optimize import minimize_scalar

        step = np.log(self.times[1] / self.times[0]) if len(self.times) > 1 else 0.3
        for _ in range(2 if len(terms.times) > 1 else 1):
            for place, tc in enumerate(terms.times):

                def cost(x, place=place, terms=terms):
                    return -self.fit(replaced(terms, place, np.exp(x))).value

                around = np.log(tc) + np.array([-1.5, 1.5]) * step
                found = minimize_scalar(cost, bounds=around, method="bounded")
                terms = replaced(terms, place, float(np.exp(found.x)))
        return terms


def replaced(terms, place, tc):
    """Return the terms with another correlation time."""
    return replace(terms, times=(*terms.times[:place], tc, *terms.times[place + 1 :]))
