"""Coefficients with intervals, and upper limits of those that are not supported."""

from functools import cache
from math import exp, log, sqrt

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkovTerm
from imuloop.noise.selection import NOTHING, ORDER, correlation_times, plus, variances, without

# share to which an end of an interval is known
CLOSE = 1e-5
# steps of the logarithm of a coefficient in which an end is looked for
STEPS = 0.1 * 4.0 ** np.arange(5)
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

    Where there is a filter, N depends on its corner: its interval is `wider`
    times as long on a logarithmic scale. Those of Gauss-Markov processes
    are by the information matrix beside white noise, flicker and walk.

    References
    ----------
    D. Fletcher and D. Turek, J. Agric. Biol. Environ. Stat. 17 (2012) 38.
    """
    fit = selection.fit(terms)
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

    A model in which such a term is estimated as zero is left out: it is the model without it.
    """
    free = tuple(t for t in FREE if t in selection.candidates and t != name)
    models = [plus(plus(tuple(t for t in terms if t not in free), "N"), name)]
    for t in free:
        models += [plus(model, t) for model in models]

    def gain(t, model):
        return selection.fit(model).restricted - selection.fit(without(model, t)).restricted

    tested = variances(free)
    return [m for m in models if all(gain(t, m) > NOTHING for t in tested if t in m)]


def _profile(selection, name, model):
    """Return the profile likelihood of a coefficient in a model.

    Returns the logarithm of the model's weight; where to look for ends, the likeliest value or the
    standard error where that is larger, SI; and a function. The function takes a value of the
    coefficient, SI, and returns the signed root of twice the log-likelihood that it costs.
    """
    rest, likelihood, fit = without(model, name), selection.likelihood, selection.fit(model)
    units, expected = selection.units(rest), selection.units(model) @ fit.theta
    if name == "R":
        unit, start, top = 0.0, fit.theta, likelihood.fit(units, fit.ramp).value
        best, size = abs(fit.ramp), 1 / sqrt(likelihood.information(expected))
    else:
        unit, place, top = selection.unit(name), model.index(name), fit.restricted
        # small beside what is there, where another takes its place
        best = max(sqrt(fit.theta[place]), SMALL * sqrt(np.min(expected / unit)))
        start = np.delete(fit.theta, place)
        size = likelihood.covariance(unit[:, None], expected)[0, 0] ** 0.25
    known = {best: start}

    def deviate(x):
        ramp = np.copysign(x, fit.ramp) if name == "R" else None if "R" in rest else 0.0
        # from the nearest value at which the likelihood is known
        nearest = known[min(known, key=lambda other: abs(other - x))]
        found = likelihood.fit(units, ramp, x**2 * unit, nearest)
        known[x] = found.theta
        return np.copysign(sqrt(2 * max(top - found.restricted, 0.0)), x - best)

    return fit.value - len(model), max(best, size), deviate


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

    Takes the results of `_profile` for each model. The area is a function of the logarithm of the
    coefficient. It is a normal deviate, which is nearly straight. Where to look is a value of the
    coefficient, that of the heaviest model.
    """
    weights, values, deviates = zip(*profiles, strict=True)
    weight = np.exp(np.array(weights) - max(weights))
    weight[weight <= NEGLIGIBLE * weight.sum()] = 0.0
    weight /= weight.sum()

    @cache
    def deviate(u):
        roots = [each(exp(u)) if w else 0.0 for each, w in zip(deviates, weight, strict=True)]
        below, above = (max(weight @ ndtr(sign * np.array(roots)), TINY) for sign in (1, -1))
        return float(ndtri(below) if below < above else -ndtri(above))

    return deviate, values[weight.argmax()]


def _crossing(deviate, near, area):
    """Return the value of a coefficient at which the tail area is `area`; 0 if there is none.

    Takes the results of `_tail`.
    """
    wanted, u = float(ndtri(area)), log(near)
    rising = deviate(u) <= wanted
    for step in STEPS:
        beyond = u + (step if rising else -step)
        if (deviate(beyond) <= wanted) != rising:
            return exp(brentq(lambda u: deviate(u) - wanted, u, beyond, xtol=CLOSE))
        u = beyond
    return 0.0
