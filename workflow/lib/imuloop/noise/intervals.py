"""Coefficients with intervals, and limits of those that are not supported."""

from dataclasses import dataclass
from itertools import compress
from math import exp, inf, log, sqrt

import numpy as np
from scipy.special import ndtr, ndtri

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkov
from imuloop.noise.processes import NAMES
from imuloop.noise.terms import NOTHING

# an end of an interval is known to such a share, or its tail area to such a part of a deviate
CLOSE, ALIKE = 1e-5, 1e-4
# steps of the logarithm in which an end is looked for: the first, their growth, the last
FIRST, GROWTH, FARTHEST, ROUNDS = 0.1, 4.0, 80.0, 100
# areas below do not matter
TINY = 1e-300
# terms that may stand in for each other: intervals are averaged over models with and without them,
# but for models of less weight than this share
FREE, NEGLIGIBLE = ("B", "K", "R"), 1e-3
# share of the spectrum where it is lowest that a term which is not there may have, as a root
SMALL = 1e-3


def axis_noise(search, terms):
    r"""Return the AxisNoise of supported terms: values with intervals, limits of the others.

    Values are those of the supported terms alone, so that together they are the spectrum that
    was found. An interval has to allow for terms that are too weak to pass and for one that
    stands where another is true: it ends where the tail areas of all models m with or without
    flicker, walk and ramp,

    .. math:: \sum_m w_m \Phi\left(\pm\sqrt{2 (\ell_m - \ell_m(x))}\right),
        \quad w_m \propto e^{\ell_m - k_m},

    reach 2.5 %. :math:`\ell_m(x)` is the profile likelihood of the coefficient, and weights of
    models of k terms are Akaike's.

    Parameters
    ----------
    search : Search
        Of one axis.
    terms : Terms
        The supported ones.

    Returns
    -------
    AxisNoise

    References
    ----------
    D. Fletcher and D. Turek, J. Agric. Biol. Environ. Stat. 17 (2012) 38.
    """
    fit = search.fit(terms, True)
    values = dict(zip(terms.names, np.sqrt(fit.theta), strict=False))
    if terms.ramp:
        values["R"] = abs(fit.ramp)
    coefficients = {}
    for name in (*NAMES, "R"):
        profiles = [_profile(search, name, model) for model in _models(search, terms, name)]
        if name in values:
            coefficients[name] = _coefficient(profiles, values[name])
        else:
            # a ramp has either sign, so that the limit of the likelier one is a two-sided one
            coefficients[name] = _limit(profiles, 2 if name == "R" else 1)
    processes = tuple(_process(search, terms, fit, i) for i in range(len(terms.times)))
    return AxisNoise(**coefficients, gauss_markov=processes)


def _models(search, terms, name):
    """Return the models that hold a term: with and without each of those that may stand in.

    One in which such a term comes out as zero is the model without it.
    """
    free = [t for t in FREE if t in search.candidates and t != name]
    base = terms.plus("N").plus(name)
    for t in free:
        base = base.without(t)
    models = [base]
    for t in free:
        models += [model.plus(t) for model in models]
    return [m for m in models if all(_there(search, t, m) for t in free if t in m.names)]


def _there(search, name, model):
    return search.fit(model).value - search.fit(model.without(name)).value > NOTHING


def _profile(search, name, model):
    """Return the profile likelihood of a coefficient in a model."""
    rest = model.without(name)
    units = search.units(rest)
    if name == "R":
        likeliest = search.fit(model)
        sign, best, start = np.copysign(1.0, likeliest.ramp), abs(likeliest.ramp), likeliest.theta
        size = search.likelihood.ramp_error(units @ start)

        def fit(x, start):
            return search.likelihood.fit(units, sign * x, start=start)

    else:
        unit = search.modes.units[:, NAMES.index(name)]
        likeliest = search.fit(model, True)
        place = model.names.index(name)
        best, start = np.sqrt(likeliest.theta[place]), np.delete(likeliest.theta, place)

        def fit(x, start):
            return search.likelihood.fit(units, rest.ramp, x**2 * unit, start, True)

        expected = search.units(model) @ likeliest.theta
        best = max(best, _small(unit, expected))
        size = np.sqrt(search.likelihood.error(unit, expected))
    weight = search.fit(model).value - len(model)
    known = {best: start}

    def value(x):
        # from the nearest one that is known
        found = fit(x, known[min(known, key=lambda other: abs(other - x))])
        known[x] = found.theta
        return found.value

    return _Profile(weight, best, max(best, size), likeliest.value, value)


def _process(search, terms, fit, place):
    """Return a Gauss-Markov process, q and tc profiled over each other beside flicker and walk.

    Where one of these takes its place, the interval of q goes down to zero, and that of tc is all
    that can be tried.
    """
    # loads for a quarter of a second, and few records show such a process
    from scipy.optimize import minimize_scalar

    tc, rest = terms.times[place], terms.plus("N").without(terms.times[place])
    q = np.sqrt(2 * fit.theta[len(terms.names) + place] / tc)
    for name in ("B", "K"):
        rest = rest.plus(name) if name in search.candidates else rest
    units, times = search.units(rest), search.modes.correlation_times
    around = np.log(np.clip(tc * np.exp([-3.0, 3.0]), times[0], times[-1]))

    def highest(value):
        """Return the largest value over the correlation times, and where it is."""
        found = minimize_scalar(lambda u: -value(np.exp(u)), bounds=around, method="bounded")
        return max((value(x), float(x)) for x in (tc, np.exp(found.x)))

    def of_tc(x):
        return search.fit(rest.plus(x), True).value

    def of_q(x):
        def value(tc):
            fixed = x**2 * tc / 2 * search.modes.gauss_markov(tc)
            return search.likelihood.fit(units, rest.ramp, fixed, restricted=True).value

        return highest(value)[0]

    top, likeliest = highest(of_tc)
    wide = rest.plus(likeliest)
    theta, unit = search.fit(wide, True).theta, likeliest / 2 * search.modes.gauss_markov(likeliest)
    expected = search.units(wide) @ theta
    best = max(np.sqrt(2 * theta[-1] / likeliest), _small(unit, expected))
    near = max(best, np.sqrt(search.likelihood.error(unit, expected)))
    return GaussMarkov(
        _coefficient([_Profile(0.0, best, near, top, of_q)], q),
        _coefficient([_Profile(0.0, likeliest, tc, top, of_tc)], tc, times[0], times[-1]),
    )


def _small(unit, expected):
    """Return a coefficient that is small beside what is there, where another takes its place."""
    return SMALL * np.sqrt(np.min(expected / unit))


@dataclass(frozen=True)
class _Profile:
    """Profile likelihood of a coefficient in one model: `value` at x, at most `top` at `best`.

    `near` is where an end is looked for: best, or the standard error where that is larger.
    """

    weight: float
    best: float
    near: float
    top: float
    value: object

    def deviate(self, x):
        """Return the signed root of twice the loss of log-likelihood at x."""
        loss = sqrt(2 * max(self.top - self.value(x), 0.0))
        return loss if x > self.best else -loss


class _Tail:
    """Tail area below a coefficient, averaged over models; as a normal deviate nearly straight.

    Attributes
    ----------
    near : float
        Where to begin, by the heaviest model.
    ends : tuple of two floats
        Logarithms of the values between which it is known.
    points : list of (float, float)
        Logarithms of values and the deviates there, as far as they are known.
    """

    def __init__(self, profiles, low, high):
        weight = np.exp(np.array([p.weight for p in profiles]) - max(p.weight for p in profiles))
        used = weight > NEGLIGIBLE * weight.sum()
        self.profiles, self.weight = list(compress(profiles, used)), weight[used]
        self.weight /= self.weight.sum()
        self.near = self.profiles[int(self.weight.argmax())].near
        self.ends = (log(low) if low else -inf, log(high))
        self.points = []

    def at(self, u):
        """Return the deviate at e^u, and keep it."""
        roots = np.array([profile.deviate(exp(u)) for profile in self.profiles])
        below, above = (max(self.weight @ ndtr(sign * roots), TINY) for sign in (1, -1))
        deviate = float(ndtri(below) if below < above else -ndtri(above))
        self.points.append((u, deviate))
        return deviate

    def crossing(self, near, area):
        """Return where the tail area reaches a value, the end if nowhere, 0 where there is none."""
        wanted = float(ndtri(area))
        if not self.points:
            self.at(log(near))
        step = FIRST
        for _ in range(ROUNDS):
            lower = max((p for p in self.points if p[1] <= wanted), default=None)
            upper = min((p for p in self.points if p[1] > wanted), default=None)
            if lower and upper:
                u = self._between(lower, upper, wanted)
            else:
                u = lower[0] + step if lower else upper[0] - step
                u = min(max(u, self.ends[0]), self.ends[1])
                if step > FARTHEST or u in (lower or upper):
                    return exp(u) if u in self.ends else 0.0
                step *= GROWTH
            narrow = lower and upper and upper[0] - lower[0] < CLOSE
            if abs(self.at(u) - wanted) < ALIKE or narrow:
                break
        return exp(u)

    def _between(self, lower, upper, wanted):
        """Return where the nearest three points put a deviate, else half-way of the bracket."""
        near = sorted(self.points, key=lambda p: abs(p[1] - wanted))[:3]
        u = 0.0
        for x, z in near:
            for _, other in near:
                if other != z:
                    x *= (wanted - other) / (z - other)
            u += x
        inside = lower[0] < u < upper[0]
        return u if inside else (lower[0] + upper[0]) / 2


def _coefficient(profiles, value, low=0.0, high=inf):
    """Return a supported coefficient, its interval within `low` and `high`."""
    value, tail = float(value), _Tail(profiles, low, high)
    low, high, upper = (tail.crossing(value or tail.near, p) for p in (0.025, 0.975, 0.95))
    return Coefficient(value, (min(low, value), max(high, value)), max(upper, value), True)


def _limit(profiles, sides):
    """Return the upper limit of a coefficient that is not supported."""
    tail = _Tail(profiles, 0.0, inf)
    return Coefficient(None, None, tail.crossing(tail.near, 1 - 0.05 / sides), False)
