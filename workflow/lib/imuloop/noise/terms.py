"""Which noise terms a record supports: tests, intervals, limits."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import chi2

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkov
from imuloop.noise.processes import NAMES

# twice the fall of the log-likelihood at the ends of a 95 % interval, two-sided and one-sided
TWO_SIDED, ONE_SIDED = chi2.ppf(0.95, 1), chi2.ppf(0.90, 1)
# correlation times from so many samples, below which a filter does the same, to such a share of
# the longest session
SHORTEST, LONGEST = 10.0, 1 / 8
# independent tests a decade of correlation times
TESTS = 2.5
# processes at most
MOST = 3
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
    """

    modes: object
    likelihood: object
    level: float
    hump_level: float

    def units(self, terms):
        """Return the unit spectra of terms, ramp excepted, shape (r, p)."""
        columns = [self.modes.units[:, NAMES.index(name)] for name in terms.names]
        columns += [self.modes.gauss_markov(tc) for tc in terms.times]
        if not columns:
            return np.zeros((len(self.modes.frequency), 0))
        return np.column_stack(columns)

    def fit(self, terms):
        """Return the Fit of these terms."""
        return self.likelihood.fit(self.units(terms), terms.ramp)

    def p_value(self, term, gain):
        """Return the probability of such a gain of log-likelihood by a term that is not there.

        Half a chi-square of one degree for a variance, which cannot be negative; a ramp can.
        """
        one = chi2.sf(2 * max(gain, 0.0), 1)
        if term == "R":
            return one
        return min(1.0, one / 2 * (1.0 if isinstance(term, str) else self.tests))

    def _p_over_level(self, term, value, without):
        level = self.level if isinstance(term, str) else self.hump_level
        return self.p_value(term, value - self.fit(without).value) / level

    @property
    def times(self):
        """Correlation times that are tried, s."""
        times = self.modes.correlation_times
        longest = LONGEST * self.modes.span
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
        names = tuple(n for n in NAMES if n in self.candidates)
        full = self.fit(Terms(names))
        terms = Terms(tuple(n for n, v in zip(names, full.theta, strict=True) if v > 0))
        seen = []
        while terms not in seen:
            seen.append(terms)
            terms = self._grown(self._shrunk(terms))
        return self._shrunk(terms)

    def _shrunk(self, terms):
        while len(terms) > 1:
            value = self.fit(terms).value
            p = {t: self._p_over_level(t, value, terms.without(t)) for t in terms}
            worst = max(p, key=p.get)
            rest = terms.without(worst)
            if p[worst] <= 1 or not (rest.names or rest.times):
                break
            terms = rest
        return terms

    def _grown(self, terms):
        value = self.fit(terms).value
        absent = [t for t in self.candidates if t not in tuple(terms)]
        p = {t: self.p_value(t, self.fit(terms.plus(t)).value - value) for t in absent}
        best = min(p, key=p.get, default=None)
        if best is not None and p[best] <= self.level:
            return terms.plus(best)
        if len(terms.times) == MOST or not len(self.times):
            return terms
        values = [self.fit(terms.plus(tc)).value for tc in self.times]
        tc = self.times[int(np.argmax(values))]
        if self.p_value(tc, max(values) - value) > self.hump_level:
            return terms
        return self._refined(terms.plus(tc))

    def _refined(self, terms):
        """Return the terms with the most likely correlation times."""
        step = np.log(self.times[1] / self.times[0]) if len(self.times) > 1 else 0.3
        for _ in range(2 if len(terms.times) > 1 else 1):
            for place, tc in enumerate(terms.times):

                def cost(x, place=place, terms=terms):
                    return -self.fit(_replaced(terms, place, np.exp(x))).value

                around = np.log(tc) + np.array([-1.5, 1.5]) * step
                found = minimize_scalar(cost, bounds=around, method="bounded")
                terms = _replaced(terms, place, float(np.exp(found.x)))
        return terms

    def noise(self, terms):
        """Return the AxisNoise of supported terms: values with intervals, limits of the others.

        Values are those of the supported terms alone, so that together they are the spectrum that
        was found. In the intervals white noise, flicker and walk stay free whether supported or
        not: one that is too weak to pass must not make its neighbour look certain.
        """
        fit, wide = self.fit(terms), terms.plus("N").plus("B").plus("K")
        top = self.fit(wide)
        values = dict(zip(terms.names, np.sqrt(fit.theta), strict=False))
        likeliest = dict(zip(wide.names, np.sqrt(top.theta), strict=False))
        coefficients = {}
        for name in NAMES:
            unit, rest = self.modes.units[:, NAMES.index(name)], wide.without(name)
            units = self.units(rest)

            def value(x, rest=rest, unit=unit, units=units):
                return self.likelihood.fit(units, rest.ramp, fixed=x**2 * unit).value

            if name in terms.names:
                coefficients[name] = _coefficient(value, values[name], likeliest[name], top.value)
            else:
                small = 1e-3 * np.sqrt(np.min(self.units(wide) @ top.theta / unit))
                found = self.fit(wide.plus(name))
                best = dict(zip(wide.plus(name).names, np.sqrt(found.theta), strict=False))[name]
                coefficients[name] = _limit(value, best, small, found.value)
        coefficients["R"] = self._ramp(wide, fit.ramp, top)
        processes = tuple(self._process(wide, top, i) for i in range(len(terms.times)))
        return AxisNoise(**coefficients, gauss_markov=processes)

    def _ramp(self, terms, found, top):
        units = self.units(terms)
        slope = top.ramp if terms.ramp else self.likelihood.fit(units, True).ramp
        sign = np.copysign(1.0, slope)

        def value(x):
            return self.likelihood.fit(units, sign * x).value

        if terms.ramp:
            return _coefficient(value, abs(found), abs(slope), top.value)
        # either sign would do, so that the limit of the likelier one is a two-sided one
        return _limit(value, abs(slope), abs(slope), value(abs(slope)), TWO_SIDED)

    def _process(self, terms, fit, place):
        """Return a Gauss-Markov process, q and tc profiled over each other."""
        tc, rest = terms.times[place], terms.without(terms.times[place])
        q = np.sqrt(2 * fit.theta[len(terms.names) + place] / tc)
        units = self.units(rest)

        def value(q, tc):
            fixed = q**2 * tc / 2 * self.modes.gauss_markov(tc)
            return self.likelihood.fit(units, rest.ramp, fixed=fixed).value

        def of_q(x):
            around = np.log(tc) + np.array([-3.0, 3.0])
            found = minimize_scalar(lambda u: -value(x, np.exp(u)), bounds=around, method="bounded")
            return max(-found.fun, value(x, tc))

        def of_tc(x):
            return self.fit(_replaced(terms, place, x)).value

        return GaussMarkov(
            _coefficient(of_q, q, q, fit.value), _coefficient(of_tc, tc, tc, fit.value)
        )


def _replaced(terms, place, tc):
    """Return the terms with another correlation time."""
    return replace(terms, times=(*terms.times[:place], tc, *terms.times[place + 1 :]))


def _coefficient(profile, value, likeliest, top):
    """Return a supported coefficient: where its profile likelihood falls, to both sides."""
    value = float(value)
    # another term may take its place altogether
    near = likeliest if likeliest > 0 else 1e-6 * value
    low, high = (_fall(profile, near, top, TWO_SIDED, side) for side in (-1, 1))
    upper = _fall(profile, near, top, ONE_SIDED, 1)
    return Coefficient(value, (min(low, value), max(high, value)), max(upper, value), True)


def _limit(profile, likeliest, small, top, fall=ONE_SIDED):
    """Return the upper limit of a coefficient that is not supported."""
    start = max(likeliest, small)
    while 2 * (top - profile(start)) > fall:
        start /= 2
    return Coefficient(None, None, _fall(profile, start, top, fall, 1), False)


def _fall(value, best, top, fall, side):
    """Return where twice the log-likelihood is lower by `fall` than at its top."""

    def excess(u):
        return 2 * (top - value(np.exp(u))) - fall

    near, step = np.log(best), 0.05
    while step < 40:
        far = np.log(best) + side * step
        if excess(far) > 0:
            return float(np.exp(brentq(excess, near, far, xtol=1e-5)))
        near, step = far, 2 * step
    return float(best if side > 0 else 0.0)
