"""Coefficients with intervals, and upper limits of those that are not supported."""

from functools import cache
from math import exp, inf, log, sqrt

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import ndtr, ndtri

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkovTerm
from imuloop.noise.selection import NOTHING, ORDER, correlation_times, plus, variances, without

# an end of an interval is known to such a share, or its tail area to such a part of a deviate
CLOSE, ALIKE = 1e-5, 1e-4
# steps of the logarithm in which an end is looked for: the first, their growth, the last
FIRST, GROWTH, FARTHEST = 0.1, 4.0, 80.0
# areas below do not matter
TINY = 1e-300
# terms that may stand in for each other: intervals are averaged over models with and without them,
# but for models of less weight than this share
FREE, NEGLIGIBLE = ("B", "K", "R"), 1e-3
# share of the spectrum where it is lowest that a term which is not there may have, as a root
SMALL = 1e-3


def coefficients_with_intervals(selection, terms, along=None):
    r"""Return the AxisNoise of supported terms: values with intervals, limits of the others.

    Values are those of the supported terms alone, so that together they are the spectrum that
    was found. An interval has to allow for terms that are too weak to pass and for one that
    stands where another is true: it ends where the tail areas of all models m with or without
    flicker, walk and ramp,

    .. math:: \sum_m w_m \Phi\left(\pm\sqrt{2 (\ell_m - \ell_m(x))}\right),
        \quad w_m \propto e^{\ell_m - k_m},

    reach 2.5 %. :math:`\ell_m(x)` is the profile likelihood of the coefficient, and weights of
    models of k terms are Akaike's.

    Where there is a filter, N depends on its corner: `along`, of `low_pass.likeliest_corner`, gives
    the selection for a ratio of N to its likeliest value.

    References
    ----------
    D. Fletcher and D. Turek, J. Agric. Biol. Environ. Stat. 17 (2012) 38.
    """
    fit = selection.fit(terms, True)
    theta = dict(zip(variances(terms), fit.theta, strict=True))
    coefficients = {}
    for name in ORDER:
        ridge = along if name == "N" else None
        models = _models(selection, terms, name)
        profiles = [_profile(selection, name, model, ridge) for model in models]
        if name in terms:
            value = abs(fit.ramp) if name == "R" else np.sqrt(theta[name])
            coefficients[name] = _coefficient(profiles, value)
        else:
            # a ramp has either sign, so that the limit of the likelier one is a two-sided one
            limit = _crossing(*_tail(profiles), 1 - 0.05 / (2 if name == "R" else 1))
            coefficients[name] = Coefficient(None, None, limit, False)
    processes = (_process(selection, terms, tc, theta[tc]) for tc in correlation_times(terms))
    return AxisNoise(**coefficients, gauss_markov=tuple(processes))


def _models(selection, terms, name):
    """Return the models that hold a term: with and without each of those that may stand in.

    One in which such a term comes out as zero is the model without it.
    """
    free = [t for t in FREE if t in selection.candidates and t != name]
    models = [plus(plus(tuple(t for t in terms if t not in free), "N"), name)]
    for t in free:
        models += [plus(model, t) for model in models]

    def there(t, model):
        return selection.fit(model).value - selection.fit(without(model, t)).value > NOTHING

    return [m for m in models if all(there(t, m) for t in free if t in m and t != "R")]


def _deviate(value, best, top):
    """Return the signed root of twice the loss of log-likelihood as a function of a coefficient.

    Of the profile likelihood `value` as one, at most `top` at `best`.
    """

    def deviate(x):
        loss = sqrt(2 * max(top - value(x), 0.0))
        return loss if x > best else -loss

    return deviate


def _profile(selection, name, model, along=None):
    """Return the log weight of a model, where to look for ends of a coefficient, and its deviate.

    The second is the likeliest value, or the standard error where that is larger.
    """
    rest, likelihood = without(model, name), selection.likelihood
    units, likeliest = selection.units(rest), selection.fit(model, restricted=name != "R")
    if name == "R":
        sign, best, start = np.copysign(1.0, likeliest.ramp), abs(likeliest.ramp), likeliest.theta
        size = likelihood.ramp_error(units @ start)

        def fixed(x):
            return {"ramp": sign * x}

    else:
        unit, place = selection.unit(name), model.index(name)
        expected = selection.units(model) @ likeliest.theta
        best = max(np.sqrt(likeliest.theta[place]), _small(unit, expected))
        start = np.delete(likeliest.theta, place)
        size = np.sqrt(likelihood.error(unit, expected))

        def fixed(x):
            return {"ramp": "R" in rest, "fixed": x**2 * unit, "restricted": True}

    known = {best: start}

    def value(x):
        # from the nearest one that is known
        nearest, columns, others = known[min(known, key=lambda other: abs(other - x))], units, {}
        if along:
            behind = along(x / best)
            columns, others = behind.units(rest), {"fixed": x**2 * behind.unit(name)}
        found = likelihood.fit(columns, start=nearest, **fixed(x) | others)
        known[x] = found.theta
        return found.value

    weight = selection.fit(model).value - len(model)
    return weight, max(best, size), _deviate(value, best, likeliest.value)


def _process(selection, terms, tc, variance):
    """Return a Gauss-Markov process, q and tc profiled over each other beside flicker and walk.

    Where one of these takes its place, the interval of q goes down to zero, and that of tc is all
    that can be tried.
    """
    modes, likelihood = selection.modes, selection.likelihood
    rest = without(plus(terms, "N"), tc)
    for name in ("B", "K"):
        rest = plus(rest, name) if name in selection.candidates else rest
    units, times = selection.units(rest), modes.correlation_times
    around = np.log(np.clip(tc * np.exp([-3.0, 3.0]), times[0], times[-1]))

    def highest(value):
        """Return the largest value over the correlation times, and where it is."""
        found = minimize_scalar(lambda u: -value(np.exp(u)), bounds=around, method="bounded")
        return max((value(x), float(x)) for x in (tc, np.exp(found.x)))

    def of_tc(x):
        return selection.fit(plus(rest, x), True).value

    def of_q(x):
        def value(tc):
            fixed = x**2 * tc / 2 * selection.unit(tc)
            return likelihood.fit(units, "R" in rest, fixed, restricted=True).value

        return highest(value)[0]

    top, likeliest = highest(of_tc)
    wide = plus(rest, likeliest)
    theta, unit = selection.fit(wide, True).theta, likeliest / 2 * selection.unit(likeliest)
    expected = selection.units(wide) @ theta
    best = max(np.sqrt(2 * theta[-1] / likeliest), _small(unit, expected))
    near = max(best, np.sqrt(likelihood.error(unit, expected)))
    q, time = (0.0, near, _deviate(of_q, best, top)), (0.0, tc, _deviate(of_tc, likeliest, top))
    return GaussMarkovTerm(
        _coefficient([q], np.sqrt(2 * variance / tc)),
        _coefficient([time], tc, times[0], times[-1]),
    )


def _small(unit, expected):
    """Return a coefficient that is small beside what is there, where another takes its place."""
    return SMALL * np.sqrt(np.min(expected / unit))


def _tail(profiles):
    """Return the tail area below a coefficient, averaged over models, and where to look for ends.

    The first is a function of the coefficient's logarithm, the area as a normal deviate, which is
    nearly straight; the second is that of the heaviest model.
    """
    weight = np.array([weight for weight, *_ in profiles])
    weight = np.exp(weight - weight.max())
    weight[weight <= NEGLIGIBLE * weight.sum()] = 0.0
    weight /= weight.sum()
    deviates = [deviate for _, _, deviate in profiles]

    @cache
    def deviate(u):
        roots = [each(exp(u)) if w else 0.0 for each, w in zip(deviates, weight, strict=True)]
        below, above = (max(weight @ ndtr(sign * np.array(roots)), TINY) for sign in (1, -1))
        return float(ndtri(below) if below < above else -ndtri(above))

    return deviate, profiles[int(weight.argmax())][1]


def _crossing(deviate, near, area, low=0.0, high=inf):
    """Return where the tail area reaches a value, the end if nowhere, 0 where there is none."""
    wanted, ends = float(ndtri(area)), (log(low) if low else -inf, log(high))

    def excess(u):
        found = deviate(u) - wanted
        return found if abs(found) > ALIKE else 0.0

    u, step = log(near), FIRST
    rising = deviate(u) <= wanted
    while True:
        beyond = min(max(u + (step if rising else -step), ends[0]), ends[1])
        if step > FARTHEST or beyond == u:
            return exp(beyond) if beyond in ends else 0.0
        if (deviate(beyond) <= wanted) != rising:
            return exp(brentq(excess, u, beyond, xtol=CLOSE))
        u, step = beyond, step * GROWTH


def _coefficient(profiles, value, low=0.0, high=inf):
    """Return a supported coefficient, its interval within `low` and `high`."""
    value, (deviate, near) = float(value), _tail(profiles)
    ends = (_crossing(deviate, value or near, p, low, high) for p in (0.025, 0.975, 0.95))
    low, high, upper = ends
    return Coefficient(value, (min(low, value), max(high, value)), max(upper, value), True)
