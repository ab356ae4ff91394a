"""Coefficients of noise terms with intervals, and upper limits of terms that are not supported.

A record supports a term if the term passes its significance test.
"""

from functools import cache, reduce
from math import copysign, exp, log, sqrt

import numpy as np
from scipy.optimize import brentq

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkovTerm
from imuloop.noise.selection import ORDER, correlation_times, plus, variances, without

# ends of an interval of 95 %, and limits of 95 % to one and to either side, in standard errors
LOW, HIGH, LIMIT, EITHER = -1.959964, 1.959964, 1.644854, 1.959964
# relative error of an end of an interval
CLOSE = 1e-5
# steps of the logarithm of a coefficient by which the search for an end moves on
STEPS = 0.1 * 4.0 ** np.arange(5)
# shift of the logarithm of a correlation time for a difference quotient
SHIFT = 1e-3
# in a profile, an estimate below this share of the largest coefficient that the spectrum allows is
# replaced by this share of it
SMALL = 1e-3


def coefficients_with_intervals(selection, terms, n_factor=1.0):
    """Return the AxisNoise of an axis: supported terms with intervals, others with upper limits.

    A term is a noise process or a ramp; it is supported if it passed its significance test. The
    values are estimated with the supported terms alone, so that together they describe the
    spectrum. Intervals and limits come from a wider model. This model also has white noise,
    flicker, random walk and ramp, as far as the record can tell them apart, because one of these
    may be present and too weak to pass its test. Intervals and limits of Q, N, B, K and R
    (quantisation, white noise, flicker, random walk, ramp) are ends of the profile likelihood.
    Intervals of Gauss-Markov processes follow from the information matrix.

    Parameters
    ----------
    selection : Selection
        The likelihood of the axis as a function of its noise terms.
    terms : tuple
        The supported terms: letters such as ``N``, and correlation times, s, of Gauss-Markov
        processes.
    n_factor : float
        Factor by which the interval of N is widened on a logarithmic scale, to allow for the error
        of the corner of a low-pass filter; 1 without a filter.
    """
    wide = reduce(plus, [name for name in selection.candidates if name != "Q"], terms)
    fit, coefficients = selection.fit(terms), {}
    theta = dict(zip(variances(terms), fit.theta, strict=True))
    for name in ORDER:
        deviate, start = _profile(selection, plus(wide, name), name)
        if name not in terms:
            # a ramp may have either sign, so its limit has two sides
            limit = _crossing(deviate, start, EITHER if name == "R" else LIMIT)
            coefficients[name] = Coefficient(upper95=limit)
            continue
        value = float(abs(fit.ramp) if name == "R" else np.sqrt(theta[name]))
        start = log(value) if value else start
        low, high, upper = (_crossing(deviate, start, wanted) for wanted in (LOW, HIGH, LIMIT))
        if name == "N" and value:
            low, high, upper = (value * (end / value) ** n_factor for end in (low, high, upper))
        ends = min(low, value), max(high, value)
        coefficients[name] = Coefficient(value, ends, upper95=max(upper, value), identifiable=True)
    processes = [_process(selection, terms, wide, tc) for tc in correlation_times(terms)]
    return AxisNoise(**coefficients, gauss_markov=tuple(processes))


def _profile(selection, model, name):
    """Return the profile likelihood of one noise coefficient, a function, and a start for searches.

    The first result is a function of the logarithm of the coefficient, SI. Its value is the signed
    root ``±√(2 (L_max - L))``. L is the log-likelihood with this coefficient fixed and all others
    fitted; L_max is the maximum of L. The sign is negative below the likeliest coefficient. So the
    value is, in a normal approximation, the distance from the likeliest coefficient in standard
    errors.

    The second result is the logarithm of the likeliest coefficient, or of its standard error if
    that is larger. A search for an end of an interval may begin there.

    `selection` is the Selection, the likelihood of the axis as a function of its terms. `model` is
    a tuple of terms, and `name` the letter of the term in it whose coefficient is varied.
    """
    others, likelihood, fit = without(model, name), selection.likelihood, selection.fit(model)
    units, expected = selection.units(others), selection.units(model) @ fit.theta
    if name == "R":
        unit, start, top = 0.0, fit.theta, likelihood.fit(units, fit.ramp).value
        best, error = abs(fit.ramp), 1 / sqrt(likelihood.ramp(expected)[1])
    else:
        unit, index, top = selection.unit(name), variances(model).index(name), fit.restricted
        best = max(sqrt(fit.theta[index]), SMALL * sqrt(np.min(expected / unit)))
        start = np.delete(fit.theta, index)
        error = likelihood.covariance(unit[:, None], expected)[0, 0] ** 0.25

    @cache
    def deviate(u):
        """Return the signed root of `_profile` at the logarithm `u` of the coefficient, a float."""
        # None makes the fit estimate the ramp, if a ramp is among the other terms
        x, free = exp(u), None if "R" in others else 0.0
        ramp = copysign(x, fit.ramp) if name == "R" else free
        value = likelihood.fit(units, ramp, x**2 * unit, start).restricted
        return copysign(sqrt(2 * max(top - value, 0.0)), x - best)

    return deviate, log(max(best, error))


def _crossing(deviate, u, wanted):
    """Return the noise coefficient, SI, at which a profile equals `wanted`; 0 if none is found.

    `deviate` is the function that `_profile` returns. It gives the distance from the likeliest
    coefficient, in standard errors, and rises with the logarithm of the coefficient. `wanted` is
    such a distance: `LOW` or `HIGH` for an end of a 95 % interval, `LIMIT` or `EITHER` for an upper
    limit. The search begins at the logarithm `u` of the coefficient.
    """
    rising = deviate(u) <= wanted
    for step in STEPS:
        beyond = u + (step if rising else -step)
        if (deviate(beyond) <= wanted) != rising:
            return exp(brentq(lambda u: deviate(u) - wanted, u, beyond, xtol=CLOSE))
        u = beyond
    return 0.0


def _process(selection, terms, wide, tc):
    """Return the GaussMarkovTerm of a Gauss-Markov process, whose correlation time is `tc`, s.

    The term has coefficient and correlation time with 95 % intervals. The values of both come from
    the fit of the supported `terms`, which include the process. The intervals come from the
    information matrix of `wide`, a tuple of these terms and of others that may be present.
    `selection` is the Selection, the likelihood of the axis as a function of its terms.
    """
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
    time = Coefficient(tc, (low, high), upper95=upper, identifiable=True)
    return GaussMarkovTerm(Coefficient.of(q, q * q_error), time)
