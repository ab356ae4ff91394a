"""Quantiles of the distributions of noise at rest, without the 0.2 s that scipy takes to import."""

from functools import cache
from math import exp, fabs, inf, lgamma, log, log1p, sqrt

# relative size of a last term of a sum, and of a last step to a root
_LEAST, _EXACT = 1e-15, 1e-12
# in place of zero, as a denominator or for its logarithm
_TINY = 1e-300


@cache
def chi_squared(p, k):
    """Return the `p` quantile of χ² with `k` degrees of freedom, not always whole."""
    return _root(lambda x: log(max(chi_squared_below(x, k), _TINY)) - log(p), start=k)


def chi_squared_below(x, k):
    """Return the probability that χ² with `k` degrees of freedom is below x.

    The series ``xᵃ e⁻ˣ Σ xⁿ / (a (a+1) … (a+n)) / Γ(a)`` of ``P(a, x)`` at a = k/2 and x/2.
    """
    a, x = k / 2, x / 2
    term = total = 1 / a
    n = a
    while term > _LEAST * total:
        n += 1
        term *= x / n
        total += term
    return min(total * exp(a * log(x) - x - lgamma(a)), 1.0)


def f_beyond(p, k, m):
    """Return what F with `k` and `m` degrees of freedom is beyond with the probability `p`."""
    return _root(lambda x: log(p) - log(max(_beta(m / 2, k / 2, k * x / m), _TINY)))


def t_beyond(p, m):
    """Return what Student's t with `m` degrees of freedom is beyond with the probability `p`."""
    return sqrt(f_beyond(2 * p, 1, m))


def _beta(a, b, ratio):
    """Return the regularised incomplete beta function I_z(a, b) at ``z = 1/(1 + ratio)``.

    By its continued fraction, which is quick for z below the mean, that is for small
    probabilities beyond; above the mean by that of the complement.

    References
    ----------
    Press, Teukolsky, Vetterling, Flannery, "Numerical recipes", 3rd ed. 2007, section 6.4.
    """
    z = 1 / (1 + ratio)
    if z > (a + 1) / (a + b + 2):
        return 1 - _beta(b, a, 1 / ratio)
    front = -(a + b) * log1p(ratio) + b * log(ratio) + lgamma(a + b) - lgamma(a) - lgamma(b)
    c, d = 1.0, 1 / (1 - (a + b) * z / (a + 1))
    value, n, change = d, 0, inf
    while fabs(change - 1) > _LEAST:
        n += 1
        for numerator in (
            n * (b - n) * z / ((a + 2 * n - 1) * (a + 2 * n)),
            -(a + n) * (a + b + n) * z / ((a + 2 * n) * (a + 2 * n + 1)),
        ):
            d = 1 / (1 + numerator * d or _TINY)
            c = 1 + numerator / c or _TINY
            change = c * d
            value *= change
    return exp(front) * value / a


def _root(rising, start=1.0):
    """Return where a function that rises with x > 0 is zero: by secants that keep a bracket."""
    low = high = start
    at_low = at_high = rising(start)
    while at_low > 0:
        high, at_high, low = low, at_low, low / 1.5
        at_low = rising(low)
    while at_high < 0:
        low, at_low, high = high, at_high, high * 1.5
        at_high = rising(high)
    x, last = low, inf
    while low < high and fabs(x - last) > _EXACT * x:
        last, x = x, high - at_high * (high - low) / (at_high - at_low)
        y = rising(x)
        # an end that stays counts half (the Illinois rule), or the bracket closes from one side
        if y < 0:
            low, at_low, at_high = x, y, at_high / 2
        else:
            high, at_high, at_low = x, y, at_low / 2
    return x
