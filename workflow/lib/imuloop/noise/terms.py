"""Which noise terms a record supports: tests, intervals, limits."""

from dataclasses import dataclass, replace
from functools import cache
from itertools import compress

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import ndtr, ndtri
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
# terms that may stand in for each other: intervals are averaged over models with and without them,
# but for models of less weight than this share
FREE, NEGLIGIBLE = ("B", "K", "R"), 1e-3
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

    def fit(self, terms, restricted=False):
        """Return the Fit of these terms."""
        return self.likelihood.fit(self.units(terms), terms.ramp, restricted=restricted)

    def p_value(self, term, gain):
        """Return the probability of such a gain of log-likelihood by a term that is not there.

        Half a chi-square of one degree for a variance, which cannot be negative; a ramp can.
        """
        one = chi2.sf(2 * max(gain, 0.0), 1)
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
            p = {t: self._chance(t, terms, terms.without(t)) / self._level(t) for t in terms}
            worst = max(p, key=p.get)
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
        value = self.fit(terms).value
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
        r"""Return the AxisNoise of supported terms: values with intervals, limits of the others.

        Values are those of the supported terms alone, so that together they are the spectrum that
        was found. An interval has to allow for terms that are too weak to pass and for one that
        stands where another is true: it ends where the tail areas of all models m with or without
        flicker, walk and ramp,

        .. math:: \sum_m w_m \Phi\left(\pm\sqrt{2 (\ell_m - \ell_m(x))}\right),
            \quad w_m \propto e^{\ell_m - k_m},

        reach 2.5 %. :math:`\ell_m(x)` is the profile likelihood of the coefficient, and weights of
        models of k terms are Akaike's.

        References
        ----------
        D. Fletcher and D. Turek, J. Agric. Biol. Environ. Stat. 17 (2012) 38.
        """
        fit = self.fit(terms, True)
        values = dict(zip(terms.names, np.sqrt(fit.theta), strict=False))
        if terms.ramp:
            values["R"] = abs(fit.ramp)
        coefficients = {}
        for name in (*NAMES, "R"):
            profiles = [self._profile(name, model) for model in self._models(terms, name)]
            if name in values:
                coefficients[name] = _coefficient(profiles, values[name])
            else:
                # a ramp has either sign, so that the limit of the likelier one is a two-sided one
                coefficients[name] = _limit(profiles, 2 if name == "R" else 1)
        wide = terms.plus("N").plus("B").plus("K")
        top = self.fit(wide, True)
        processes = tuple(self._process(wide, top, i) for i in range(len(terms.times)))
        return AxisNoise(**coefficients, gauss_markov=processes)

    def _models(self, terms, name):
        """Return the models that hold a term: with and without each of those that may stand in.

        One in which such a term comes out as zero is the model without it.
        """
        free = [t for t in FREE if t in self.candidates and t != name]
        base = terms.plus("N").plus(name)
        for t in free:
            base = base.without(t)
        models = [base]
        for t in free:
            models += [model.plus(t) for model in models]
        return [m for m in models if all(self._there(t, m) for t in free if t in m.names)]

    def _there(self, name, model):
        return self.fit(model).theta[model.names.index(name)] > 0

    def _profile(self, name, model):
        """Return the profile likelihood of a coefficient in a model."""
        rest = model.without(name)
        units = self.units(rest)
        if name == "R":
            likeliest = self.fit(model)
            sign, best = np.copysign(1.0, likeliest.ramp), abs(likeliest.ramp)

            def value(x):
                return self.likelihood.fit(units, sign * x, start=likeliest.theta).value

        else:
            unit = self.modes.units[:, NAMES.index(name)]
            likeliest = self.fit(model, True)
            place = model.names.index(name)
            best, start = np.sqrt(likeliest.theta[place]), np.delete(likeliest.theta, place)

            def value(x):
                return self.likelihood.fit(units, rest.ramp, x**2 * unit, start, True).value

            # where another term takes its place: small beside what is there
            best = max(best, 1e-3 * np.sqrt(np.min(self.units(model) @ likeliest.theta / unit)))
        weight = self.fit(model).value - len(model)
        return _Profile(weight, best, likeliest.value, value)

    def _process(self, terms, fit, place):
        """Return a Gauss-Markov process, q and tc profiled over each other."""
        tc, rest = terms.times[place], terms.without(terms.times[place])
        q = np.sqrt(2 * fit.theta[len(terms.names) + place] / tc)
        units = self.units(rest)

        def value(q, tc):
            fixed = q**2 * tc / 2 * self.modes.gauss_markov(tc)
            return self.likelihood.fit(units, rest.ramp, fixed, restricted=True).value

        def of_q(x):
            around = np.log(tc) + np.array([-3.0, 3.0])
            found = minimize_scalar(lambda u: -value(x, np.exp(u)), bounds=around, method="bounded")
            return max(-found.fun, value(x, tc))

        def of_tc(x):
            return self.fit(_replaced(terms, place, x), True).value

        return GaussMarkov(_between(of_q, q, fit.value), _between(of_tc, tc, fit.value))


def _replaced(terms, place, tc):
    """Return the terms with another correlation time."""
    return replace(terms, times=(*terms.times[:place], tc, *terms.times[place + 1 :]))


@dataclass(frozen=True)
class _Profile:
    """Profile likelihood of a coefficient in one model: `value` at x, at most `top` at `best`."""

    weight: float
    best: float
    top: float
    value: object

    def below(self, x):
        """Return the tail area below x."""
        root = np.sqrt(2 * max(self.top - self.value(x), 0.0))
        return ndtr(np.copysign(root, x - self.best))


def _averaged(profiles):
    """Return the tail area below x, averaged over models, and the heaviest model's best value."""
    weight = np.exp(np.array([p.weight for p in profiles]) - max(p.weight for p in profiles))
    used = weight > NEGLIGIBLE * weight.sum()
    weight, profiles = weight[used], list(compress(profiles, used))
    weight /= weight.sum()

    @cache
    def below(x):
        return sum(w * p.below(x) for w, p in zip(weight, profiles, strict=True))

    return below, profiles[int(weight.argmax())].best


def _coefficient(profiles, value):
    """Return a supported coefficient."""
    value = float(value)
    below, _ = _averaged(profiles)
    low, high, upper = (_crossing(below, value, p) for p in (0.025, 0.975, 0.95))
    return Coefficient(value, (min(low, value), max(high, value)), max(upper, value), True)


def _limit(profiles, sides):
    """Return the upper limit of a coefficient that is not supported."""
    below, best = _averaged(profiles)
    return Coefficient(None, None, _crossing(below, best, 1 - 0.05 / sides), False)


def _crossing(below, near, area):
    """Return where a tail area that grows reaches a value, 0 where it is larger everywhere."""

    def excess(u):
        # as normal deviates, in which a tail area is nearly straight
        return ndtri(np.clip(below(float(np.exp(u))), 1e-12, 1 - 1e-12)) - ndtri(area)

    near, step = np.log(near), 0.02
    side = -1 if excess(near) > 0 else 1
    while step < 80:
        far = near + side * step
        if excess(far) * side > 0:
            return float(np.exp(brentq(excess, near, far, xtol=1e-5)))
        near, step = far, 3 * step
    return 0.0


def _between(profile, value, top):
    """Return a parameter of a process: where its profile likelihood falls, to both sides."""
    low, high = (_fall(profile, value, top, TWO_SIDED, side) for side in (-1, 1))
    return Coefficient(float(value), (low, high), _fall(profile, value, top, ONE_SIDED, 1), True)


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
