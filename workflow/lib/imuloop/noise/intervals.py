"""Coefficients with intervals, and upper limits of those that are not supported."""

from functools import cache, reduce
from math import copysign, exp, log, sqrt

import numpy as np
from scipy.optimize import brentq

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkovTerm
from imuloop.noise.selection import ORDER, correlation_times, plus, variances, without

# ends of an interval of 95 %, and limits of 95 % to one and to either side, in standard errors
LOW, HIGH, LIMIT, EITHER = -1.959964, 1.959964, 1.644854, 1.959964
# share to which an end of an interval is known
CLOSE = 1e-5
# steps of the logarithm of a coefficient in which an end is searched for
STEPS = 0.1 * 4.0 ** np.arange(5)
# shift of the logarithm of a correlation time by which a derivative is taken
SHIFT = 1e-3
# least coefficient at which a profile begins: share of the amplitude spectrum where it is lowest
SMALL = 1e-3


def coefficients_with_intervals(selection, terms, wider=1.0):
    """Return the AxisNoise of supported terms: values with intervals, limits of the others.

    Values are estimated with the supported terms alone, so that together they describe the
    spectrum. Another term may be too weak to pass its test, or may be true in place of a supported
    one. So intervals and limits come from a wider model, which also holds white noise, flicker,
    walk and ramp. For Q, N, B, K and R they are ends of the profile likelihood. For Gauss-Markov
    processes they follow from the information matrix.

    If there is a filter, N depends on its corner: the interval of N is `wider` times as long on a
    logarithmic scale.
    """
    wide = reduce(plus, [name for name in selection.candidates if name != "Q"], terms)
    fit, coefficients = selection.fit(terms), {}
    theta = dict(zip(variances(terms), fit.theta, strict=True))
    for name in ORDER:
        deviate, start = _profile(selection, plus(wide, name), name)
        if name not in terms:
            # the sign of a ramp is not known
            limit = _crossing(deviate, start, EITHER if name == "R" else LIMIT)
            coefficients[name] = Coefficient(None, None, limit, False)
            continue
        value = float(abs(fit.ramp) if name == "R" else np.sqrt(theta[name]))
        start = log(value) if value else start
        low, high, upper = (_crossing(deviate, start, wanted) for wanted in (LOW, HIGH, LIMIT))
        if name == "N" and value:
            low, high, upper = (value * (end / value) ** wider for end in (low, high, upper))
        ends = min(low, value), max(high, value)
        coefficients[name] = Coefficient(value, ends, max(upper, value), True)
    processes = [_process(selection, terms, wide, tc) for tc in correlation_times(terms)]
    return AxisNoise(**coefficients, gauss_markov=tuple(processes))


def _profile(selection, model, name):
    """Return the profile likelihood of a coefficient in a model that holds it.

    Returns a function and where to begin on its scale: at the likeliest coefficient, or at its
    standard error if that is larger. The function takes the logarithm of the coefficient in SI. It
    returns the root of twice the log-likelihood lost against the maximum: standard errors above
    the likeliest coefficient, negative below it.
    """
    rest, likelihood, fit = without(model, name), selection.likelihood, selection.fit(model)
    units, expected = selection.units(rest), selection.units(model) @ fit.theta
    if name == "R":
        unit, start, top = 0.0, fit.theta, likelihood.fit(units, fit.ramp).value
        best, error = abs(fit.ramp), 1 / sqrt(likelihood.ramp(expected)[1])
    else:
        unit, place, top = selection.unit(name), variances(model).index(name), fit.restricted
        best = max(sqrt(fit.theta[place]), SMALL * sqrt(np.min(expected / unit)))
        start = np.delete(fit.theta, place)
        error = likelihood.covariance(unit[:, None], expected)[0, 0] ** 0.25

    @cache
    def deviate(u):
        x, free = exp(u), None if "R" in rest else 0.0
        ramp = copysign(x, fit.ramp) if name == "R" else free
        value = likelihood.fit(units, ramp, x**2 * unit, start).restricted
        return copysign(sqrt(2 * max(top - value, 0.0)), x - best)

    return deviate, log(max(best, error))


def _crossing(deviate, u, wanted):
    """Return the coefficient, SI, at which a profile has a wanted value, or 0.

    Takes the two results of `_profile`. The result is 0 if the profile never has that value.
    """
    rising = deviate(u) <= wanted
    for step in STEPS:
        beyond = u + (step if rising else -step)
        if (deviate(beyond) <= wanted) != rising:
            return exp(brentq(lambda u: deviate(u) - wanted, u, beyond, xtol=CLOSE))
        u = beyond
    return 0.0


def _process(selection, terms, wide, tc):
    """Return the GaussMarkovTerm of a correlation time, s, with intervals in a wider model."""
    fit = selection.fit(terms)
    variance, times = fit.theta[variances(terms).index(tc)], selection.modes.correlation_times
    unit = variance * selection.unit(tc)
    change = (variance * selection.unit(tc * exp(SHIFT)) - unit) / SHIFT
    # derivatives by the logarithms of q and tc; the variance is q^2 tc/2
    columns = np.column_stack([2 * unit, unit + change, selection.units(without(wide, tc))])
    errors = selection.likelihood.covariance(columns, selection.units(terms) @ fit.theta)
    q, q_error, tc_error = sqrt(2 * variance / tc), sqrt(errors[0, 0]), sqrt(errors[1, 1])
    ends = tc * np.exp(tc_error * np.array([LOW, HIGH, LIMIT]))
    low, high, upper = np.clip(ends, times[0], times[-1]).tolist()
    time = Coefficient(tc, (low, high), upper, True)
    return GaussMarkovTerm(Coefficient.of(q, q * q_error), time)
