"""Undersampling: the error of a rotation by frequencies above half the sampling rate of the log.

No integration scheme removes this error, because components at the sampling rate and its multiples
look like a bias. Their power is predicted from the spectrum below half the sampling rate, which is
extrapolated as a power law of frequency.
"""

import numpy as np
from scipy.fft import rfft
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.special import zeta

from imuloop.core.gaps import lost_samples

# number of bands of the spectrum between a quarter and half the sampling rate
BANDS = 32
# limits of the exponent p of the power law: steps, such as knocks, have p = 2; with p = 8 the error
# by undersampling is next to nothing
FALLS = 2.0, 8.0
# distance of p from the lower limit below which the spectrum does not fall
FLAT = 0.01
# share of the variance by white noise of the rotations below which undersampling is neglected
NEGLIGIBLE = 0.01
# number of parts of a rotation, each with an error
PARTS = 16
# share of the variance of an error that is the same in all directions
ANY_WAY = 0.5
# variance by the number format of a log without noise, (rad/s)²
EXACT = 1e-20


def aliased_turns(t, w, begin, last, bias, variance):
    r"""Return the variance of m rotations by frequencies above half the sampling rate of a log.

    Let W(f) be the spectrum of the angular rate on fixed axes, C w, with the attitude C. Samples at
    steps Δt = 1/f_s give the rotation vector with the error

    .. math:: Δt Σ C w(t_k) - ∫ C w \, dt = Σ_{k≠0} W(k f_s),

    the sum of the spectrum at multiples of the sampling rate f_s, whose phases are unknown.
    Rotations do not commute, but this changes the error by a hundredth only. The energy of each
    axis is taken as |W|² = a f⁻ᵖ. In n samples with white noise σ², it appears with its aliases at
    the frequencies x f_s:

    .. math:: |W_s(x f_s)|² = a f_s^{-p} (ζ(p, x) + ζ(p, 1 - x)) + n Δt² σ², \quad 1/4 < x < 1/2,

    where ζ is the Hurwitz zeta function. The maximum of Whittle's likelihood gives one p for all
    rotations and one a for each. The variance of the error is 2 a f_s⁻ᵖ ζ(p) on each axis. This
    holds for samples at instants. Means over each step would be free of the error, and a low-pass
    filter in the sensor shows as a larger p.

    Parameters
    ----------
    t, w : ndarray, shape (N,), (N, 3)
        Time, s, and angular rate, rad/s, of the whole log.
    begin, last : ndarray of int, shape (m,)
        Index of the first and of the last sample of each rotation.
    bias, variance : ndarray, shape (m, 3)
        Mean, rad/s, and sample variance, (rad/s)², of the angular rate at rest.

    Returns
    -------
    variance : ndarray, shape (m,)
        Variance of the rotation vector on each axis, rad², zero if it is negligible.
    fall : ndarray, shape (m,)
        The exponent p, the same for all rotations.
    covariance : ndarray, shape (m, PARTS, 3, 3)
        Covariance of the error that arises in each of `PARTS` equal parts of a rotation, on body
        axes, rad². The traces of all parts add up to three times the variance.

    References
    ----------
    Whittle, "Estimation and information in stationary time series", Arkiv för Matematik 2 (1953).
    """
    if not len(begin):
        return np.zeros(0), np.zeros(0), np.zeros((0, PARTS, 3, 3))
    steps = np.diff(t)
    usual = np.median(steps)
    # index of each sample in its rotation, dropped samples counted
    lost = lost_samples(steps, usual)
    numbers = [np.append(0, np.cumsum(1 + lost[i:j])) for i, j in zip(begin, last, strict=True)]
    n = np.array([number[-1] + 1 for number in numbers])
    # length of the transform, a multiple of the bands; spectra; and shares of each part and axis
    length, energy, shares = 4 * BANDS * -(-n.max() // (4 * BANDS)), [], []
    for i, j, number, rest in zip(begin, last, numbers, bias, strict=True):
        turn = w[i : j + 1] - rest
        # the rate at even steps, dropped samples interpolated
        even = CubicSpline(number, turn.T, axis=1)(np.arange(number[-1] + 1))
        power = np.abs(rfft(even, length)[:, length // 4 : length // 2]) ** 2
        energy.append(power.mean(axis=0).reshape(BANDS, -1).mean(axis=1))
        # the error arises where the rate bends most: second differences give its share by part
        squares = sum_parts(outer_products(np.diff(turn, 2, axis=0)))
        squares /= max(np.trace(squares.sum(axis=0)), np.finfo(float).tiny)
        traces = np.trace(squares, axis1=1, axis2=2)[:, None, None]
        shares.append(ANY_WAY * traces * np.eye(3) + 3 * (1 - ANY_WAY) * squares)
    energy, noise = np.array(energy), n[:, None] * (np.median(variance.mean(axis=1)) + EXACT)
    # frequency at the middle of each band over the sampling rate
    x = 0.25 + (np.arange(BANDS) + 0.5) / (4 * BANDS)

    def fit_energy(p):
        """Return the best a f_s⁻ᵖ of each rotation, (m, 1), and the negative log-likelihood."""
        spectrum = zeta(p, x) + zeta(p, 1 - x)
        size = np.zeros((len(n), 1))
        # weighted least squares, with weights by the result of the step before
        for _ in range(20):
            weight = (spectrum / np.maximum(size * spectrum, noise)) ** 2
            size = np.average((energy - noise) / spectrum, axis=1, weights=weight)[:, None]
            size = np.maximum(size, 0.0)
        expected = size * spectrum + noise
        return size, n @ (np.log(expected) + energy / expected).sum(axis=1)

    p = minimize_scalar(lambda p: fit_energy(p)[1], bounds=FALLS, method="bounded").x
    aliased = 2 * fit_energy(p)[0][:, 0] * zeta(p)
    # a tremor or a line near half the sampling rate cannot be extrapolated by a power law
    valid = aliased.sum() > NEGLIGIBLE * noise.sum() and p > FALLS[0] + FLAT
    aliased *= usual**2 * valid
    return aliased, np.full(len(n), p), np.array(shares) * aliased[:, None, None, None]


def outer_products(vectors):
    """Return the matrices v vᵀ, (n, 3, 3), of vectors v, (n, 3)."""
    return vectors[:, :, None] * vectors[:, None, :]


def sum_parts(matrices):
    """Return the sums of n matrices, (n, 3, 3), over `PARTS` equal consecutive parts.

    The result has the shape (PARTS, 3, 3).
    """
    n, sums = len(matrices), np.zeros((PARTS, 3, 3))
    np.add.at(sums, np.arange(n) * PARTS // max(n, 1), matrices)
    return sums


def middle_steps(count):
    """Return the index of the time step in the middle of each part of m rotations, (m, PARTS).

    The index is counted from the start of the rotation. `count`, (m,), is the number of samples of
    each rotation, which is cut into `PARTS` equal parts.
    """
    return (2 * np.arange(PARTS) + 1) * (count[:, None] - 2) // (2 * PARTS)
