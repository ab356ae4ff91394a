"""Coefficients with intervals, and upper limits of those that are not supported."""

from functools import cache
from math import exp, log, sqrt

import numpy as np
from scipy.optimize import brentq
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
# shift of the logarithm of a correlation time by which a derivative is taken
SHIFT = 1e-3
# share of the spectrum where it is lowest that a term which is not there may have, as a root
SMALL = 1e-3


def coefficients_with_intervals(selection, terms, wider=1.0):
    r"""Return the AxisNoise of supported terms: values with intervals, limits of the others.

    Values are those of the supported terms alone, so that together they are the spectrum that
    was found. An interval has to allow for terms that are too weak to pass and for one that
    stands where another is true: it ends where the tail areas of all models m with or without
    flicker, walk and ramp,

    .. math:: \sum_m w_m \Phi\left(\pm\sqrt{2 (\ell_m - \ell_m(x))}\right),
        \quad w_m \propto e^{\ell_m - k_m},

    reach 2.5 %. :math:`\ell_m(x)` is the profile likelihood of the coefficient, and weights of
    models of k terms are Akaike's.

    Where there is a filter, N depends on its corner: its interval is `wider`, of
    `low_pass.likeliest_corner`, by so much on a logarithmic scale. Those of Gauss-Markov processes
    are by the information matrix beside white noise, flicker and walk.

    References
    ----------
    D. Fletcher and D. Turek, J. Agric. Biol. Environ. Stat. 17 (2012) 38.
    """
    fit = selection.fit(terms, True)
    theta = dict(zip(variances(terms), fit.theta, strict=True))
    coefficients = {}
    for name in ORDER:
        models = _models(selection, terms, name)
        profiles = [_profile(selection, name, model) for model in models]
        if name in terms:
            value = float(abs(fit.ramp) if name == "R" else np.sqrt(theta[name]))
            deviate, near = _tail(profiles)
            ends = [_crossing(deviate, value or near, area) for area in (0.025, 0.975, 0.95)]
            if name == "N":
                ends = [value * (end / value) ** wider if value else end for end in ends]
            low, high, upper = min(ends[0], value), max(ends[1], value), max(ends[2], value)
            coefficients[name] = Coefficient(value, (low, high), upper, True)
        else:
            # a ramp has either sign, so that the limit of the likelier one is a two-sided one
            limit = _crossing(*_tail(profiles), 1 - 0.05 / (2 if name == "R" else 1))
            coefficients[name] = Coefficient(None, None, limit, False)
    processes = (_process(selection, terms, tc, fit) for tc in correlation_times(terms))
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


def _profile(selection, name, model):
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
        # small beside what is there, where another takes its place
        best = max(np.sqrt(likeliest.theta[place]), SMALL * np.sqrt(np.min(expected / unit)))
        start = np.delete(likeliest.theta, place)
        size = np.sqrt(likelihood.error(unit, expected))

        def fixed(x):
            return {"ramp": "R" in rest, "fixed": x**2 * unit, "restricted": True}

    known = {best: start}

    def deviate(x):
        # from the nearest one that is known
        nearest = known[min(known, key=lambda other: abs(other - x))]
        found = likelihood.fit(units, start=nearest, **fixed(x))
        known[x] = found.theta
        return np.copysign(sqrt(2 * max(likeliest.value - found.value, 0.0)), x - best)

    return selection.fit(model).value - len(model), max(best, size), deviate


def _process(selection, terms, tc, fit):
    """Return a Gauss-Markov process, its errors beside white noise, flicker, walk and others."""
    variance = fit.theta[variances(terms).index(tc)]
    wide, times = terms, selection.modes.correlation_times
    for name in ("N", "B", "K"):
        wide = plus(wide, name) if name in selection.candidates else wide
    unit = variance * selection.unit(tc)
    change = (variance * selection.unit(tc * exp(SHIFT)) - unit) / SHIFT
    columns = np.column_stack([unit, change, selection.units(without(wide, tc))])
    errors = selection.likelihood.covariance(columns, selection.units(terms) @ fit.theta)[:2, :2]
    # of the logarithms of q = sqrt(2 v/tc) and tc
    q_error, tc_error = (sqrt(w @ errors @ w) for w in (np.array([0.5, -0.5]), np.array([0, 1.0])))
    q, ends = sqrt(2 * variance / tc), tc * np.exp(tc_error * np.array([-1.96, 1.96, 1.645]))
    low, high, upper = np.clip(ends, times[0], times[-1]).tolist()
    return GaussMarkovTerm(
        Coefficient.of(q, q * q_error), Coefficient(tc, (low, high), upper, True)
    )


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


def _crossing(deviate, near, area):
    """Return where the tail area reaches a value, 0 if nowhere."""
    wanted, u, step = float(ndtri(area)), log(near), FIRST

    def excess(u):
        found = deviate(u) - wanted
        return found if abs(found) > ALIKE else 0.0

    rising = deviate(u) <= wanted
    while step <= FARTHEST:
        beyond = u + (step if rising else -step)
        if (deviate(beyond) <= wanted) != rising:
            return exp(brentq(excess, u, beyond, xtol=CLOSE))
        u, step = beyond, step * GROWTH
    return 0.0
