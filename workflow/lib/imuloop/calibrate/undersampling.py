"""Turns that were sampled too slowly: what a log lost between two samples, and cannot show.

No integration scheme gets it back: components at the rate of the log and its multiples look like a
bias. They are known by the spectrum below half that rate, continued as a power of frequency.
"""

import numpy as np
from scipy.fft import rfft
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.special import zeta

from imuloop.core.gaps import lost_samples

# bands of the upper half of the spectrum, between a quarter and half the rate
BANDS = 32
# power by which the spectrum falls: of steps, as knocks make them; of what adds nothing
FALLS = 2.0, 8.0
# this near to the least fall the spectrum is none that falls
FLAT = 0.01
# share of the white noise of the turns, in variance, below which it does not count
NEGLIGIBLE = 0.01
# parts of a turn that its errors are put in, and the share of them that has no direction
PARTS, ANY_WAY = 16, 0.5
# variance that rounding of numbers leaves of a log without noise, (rad/s)²
EXACT = 1e-20


def aliased_turns(t, w, begin, last, bias, variance):
    r"""Return what components above half the rate of a log add to its turns, and their fall.

    With the spectrum W(f) of the angular rate on fixed axes, C w, and steps of Δt = 1/f_s

    .. math:: Δt Σ C w(t_k) - ∫ C w \, dt = Σ_{k≠0} W(k f_s),

    of unknown phases. What does not commute adds a hundredth of it. The energy |W|² = a f⁻ᵖ of each
    axis is folded in the samples, beside their white noise σ²:

    .. math:: |W_s(x f_s)|² = a f_s^{-p} (ζ(p, x) + ζ(p, 1 - x)) + n Δt² σ², \quad 1/4 < x < 1/2,

    ζ Hurwitz' function. The likeliest p of all turns (Whittle), and a of each, give the variance
    2 a f_s⁻ᵖ ζ(p) of each axis. That is of samples at instants; means over each step would be free
    of it, and a filter within the sensor is seen as a faster fall. Arguments as of
    `errors_of_time.errors_of_time`.

    Returns
    -------
    variance, fall : ndarray, shape (m,)
        Of the rotation vector on each axis, rad², 0 where all is negligible; and p.
    at, covariance : ndarray, shape (m, PARTS) and (m, PARTS, 3, 3)
        Steps of each turn, and the parts of the covariance about them, on the axes of the body
        there, rad²; their trace is in all three times the variance.

    References
    ----------
    Whittle, "Estimation and information in stationary time series", Arkiv för Matematik 2 (1953).
    """
    if not len(begin):
        return np.zeros(0), np.zeros(0), np.zeros((0, PARTS), int), np.zeros((0, PARTS, 3, 3))
    steps = np.diff(t)
    usual = np.median(steps)
    # a sample's number in its turn, lost ones counted too
    lost = lost_samples(steps, usual)
    numbers = [np.append(0, np.cumsum(1 + lost[i:j])) for i, j in zip(begin, last, strict=True)]
    n = np.array([number[-1] + 1 for number in numbers])
    length, energy, places = 4 * BANDS * -(-n.max() // (4 * BANDS)), [], []
    for i, j, number, rest in zip(begin, last, numbers, bias, strict=True):
        turn = w[i : j + 1] - rest
        even = CubicSpline(number, turn.T, axis=1)(np.arange(number[-1] + 1))
        own = np.abs(rfft(even, length)[:, length // 4 : length // 2]) ** 2
        energy.append(own.mean(axis=0).reshape(BANDS, -1).mean(axis=1))
        at, squares = outer_products(np.diff(turn, 2, axis=0))
        squares /= max(np.trace(squares.sum(axis=0)), np.finfo(float).tiny)
        shares = np.trace(squares, axis1=1, axis2=2)[:, None, None]
        places.append((at, ANY_WAY * shares * np.eye(3) + 3 * (1 - ANY_WAY) * squares))
    energy, noise = np.array(energy), n[:, None] * (np.median(variance.mean(axis=1)) + EXACT)
    x = 0.25 + (np.arange(BANDS) + 0.5) / (4 * BANDS)

    def likeliest(p):
        """Return a f_s⁻ᵖ of each turn, (m, 1), and the logarithm of the likelihood, less."""
        shape = zeta(p, x) + zeta(p, 1 - x)
        size = np.zeros((len(n), 1))
        for _ in range(20):
            weight = (shape / np.maximum(size * shape, noise)) ** 2
            size = np.average((energy - noise) / shape, axis=1, weights=weight)[:, None]
            size = np.maximum(size, 0.0)
        expected = size * shape + noise
        return size, n @ (np.log(expected) + energy / expected).sum(axis=1)

    p = minimize_scalar(lambda p: likeliest(p)[1], bounds=FALLS, method="bounded").x
    found = 2 * likeliest(p)[0][:, 0] * zeta(p)
    # with a tremor or a line near half the rate a spectrum does not fall, and has no continuation
    counts = found.sum() > NEGLIGIBLE * noise.sum() and p > FALLS[0] + FLAT
    found *= usual**2 * counts
    at, shares = map(np.array, zip(*places, strict=True))
    return found, np.full(len(n), p), at, shares * found[:, None, None, None]


def outer_products(changes):
    """Return sums of v vᵀ over `PARTS` of a turn's changes v, (n, 3): their middles, and each.

    Shapes are (PARTS,) and (PARTS, 3, 3).
    """
    n, sums = len(changes), np.zeros((PARTS, 3, 3))
    products = changes[:, :, None] * changes[:, None, :]
    np.add.at(sums, np.arange(n) * PARTS // max(n, 1), products)
    return (2 * np.arange(PARTS) + 1) * n // (2 * PARTS), sums
