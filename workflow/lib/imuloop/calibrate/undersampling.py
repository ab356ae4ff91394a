"""Undersampling: the error of a rotation by frequencies above half the sampling rate of the log.

No integration scheme removes this error, because components at the sampling rate and its multiples
look like a bias. Their power is predicted from the spectrum below half the sampling rate, which is
extrapolated as a power law of frequency.
"""

from math import ceil

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
    r"""Return the variance that undersampling gives m rotations of a log, rad², and its parts.

    Undersampling is the part of the motion at frequencies above half the sampling rate. Let W(f) be
    the spectrum of the angular rate on fixed axes, C w, where C is the attitude. Samples at steps
    Δt = 1/f_s, k = 0, 1, …, give the rotation vector with the error

    .. math:: Δt Σ_k C w(t_k) - ∫ C w \, dt = Σ_{n≠0} W(n f_s),

    the sum of the spectrum at multiples n of the sampling rate f_s, whose phases are unknown. That
    rotations do not commute changes the error by a hundredth only. The energy of each axis is taken
    as |W|² = a f⁻ᵖ, a power law of the frequency f. So the error has the variance 2 a f_s⁻ᵖ ζ(p) on
    each axis, where ζ is Riemann's zeta function. The spectrum below half the sampling rate gives
    p, which is the same for all rotations, and a of each rotation. The sensor is taken to sample at
    instants. A sensor that gives the mean rate over each step would have no such error. A low-pass
    filter in the sensor makes p larger, and so the error smaller.

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
        Variance of the rotation vector on each axis, rad². It is zero if the sum over all rotations
        is below `NEGLIGIBLE` of the variance by white noise.
    fall : ndarray, shape (m,)
        The exponent p, the same for all rotations.
    covariance : ndarray, shape (m, PARTS, 3, 3)
        Covariance of the error that arises in each of `PARTS` equal parts of a rotation, on body
        axes, rad². The traces of all parts add up to three times the variance.
    """
    if not len(begin):
        return np.zeros(0), np.zeros(0), np.zeros((0, PARTS, 3, 3))
    steps = np.diff(t)
    usual = np.median(steps)
    turns = [w[i : j + 1] - rest for i, j, rest in zip(begin, last, bias, strict=True)]
    # number of each sample in its rotation, in which dropped samples count
    lost = lost_samples(steps, usual)
    numbers = [np.append(0, np.cumsum(1 + lost[i:j])) for i, j in zip(begin, last, strict=True)]
    n = np.array([number[-1] + 1 for number in numbers])
    # energies are of sums of samples, without the factor Δt²
    energy = _band_energies(turns, numbers, n.max())
    noise = n[:, None] * (np.median(variance.mean(axis=1)) + EXACT)
    p, size = _fit_power_law(energy, noise, n)
    aliased = 2 * size * zeta(p)
    # a tremor or a line near half the sampling rate cannot be extrapolated by a power law
    valid = aliased.sum() > NEGLIGIBLE * noise.sum() and p > FALLS[0] + FLAT
    aliased *= usual**2 * valid
    shares = np.array([_shares_of_parts(turn) for turn in turns])
    return aliased, np.full(len(n), p), shares * aliased[:, None, None, None]


def _band_energies(turns, numbers, longest):
    """Return the energy of each of m rotations in bands of frequency, (m, BANDS).

    The energy of a band is the mean over the three axes and over the frequencies of the band. The
    bands divide the frequencies from a quarter to half the sampling rate. `turns` has for each
    rotation the angular rate less the bias, rad/s, (k, 3), at its k samples. `numbers` has for each
    rotation the position of each sample, (k,), in the sequence 0, 1, … that would have been logged
    without drops. The rate at dropped samples is interpolated. `longest` is the number of samples
    of the longest rotation, dropped ones included.
    """
    # the length of the transform is a multiple of 4 BANDS, so that all bands have as many
    # frequencies
    length, energy = 4 * BANDS * ceil(longest / (4 * BANDS)), []
    for turn, number in zip(turns, numbers, strict=True):
        even = CubicSpline(number, turn.T, axis=1)(np.arange(number[-1] + 1))
        square = np.abs(rfft(even, length)[:, length // 4 : length // 2]) ** 2
        energy.append(square.mean(axis=0).reshape(BANDS, -1).mean(axis=1))
    return np.array(energy)


def _fit_power_law(energy, noise, n):
    r"""Return the exponent p of a power law for m rotations, and its size a f_s⁻ᵖ for each, (m,).

    If the energy of the motion is a f⁻ᵖ, the samples show the energy

    .. math:: E(x f_s) = a f_s^{-p} (ζ(p, x) + ζ(p, 1 - x)) + noise, \quad 1/4 < x < 1/2,

    at the frequency x f_s. f_s is the sampling rate, and ζ, the Hurwitz zeta function, sums the
    aliases. p maximises Whittle's likelihood, in which `energy` is exponentially distributed with
    the mean E.

    Parameters
    ----------
    energy : ndarray, shape (m, BANDS)
        Energy spectrum of each rotation between a quarter and half the sampling rate.
    noise : ndarray, shape (m, 1)
        Energy of white noise.
    n : ndarray of int, shape (m,)
        Number of samples of each rotation, its weight in the likelihood.

    References
    ----------
    Whittle, "Estimation and information in stationary time series", Arkiv för Matematik 2 (1953).
    """
    # frequency at the middle of each band over the sampling rate
    x = 0.25 + (np.arange(BANDS) + 0.5) / (4 * BANDS)

    def fit_sizes(p):
        """Return the best sizes a f_s⁻ᵖ at an exponent `p`, (m, 1), and the misfit.

        The misfit is minus the logarithm of the likelihood; the best p makes it smallest.
        """
        spectrum = zeta(p, x) + zeta(p, 1 - x)
        size = np.zeros((len(n), 1))
        # weighted least squares, with weights by the result of the step before
        for _ in range(20):
            weight = (spectrum / np.maximum(size * spectrum, noise)) ** 2
            size = np.average((energy - noise) / spectrum, axis=1, weights=weight)[:, None]
            size = np.maximum(size, 0.0)
        expected = size * spectrum + noise
        return size, n @ (np.log(expected) + energy / expected).sum(axis=1)

    p = minimize_scalar(lambda p: fit_sizes(p)[1], bounds=FALLS, method="bounded").x
    size, _ = fit_sizes(p)
    return p, size[:, 0]


def _shares_of_parts(turn):
    """Return the shares of the undersampling error that arise in equal parts of a rotation.

    A share is a covariance matrix; the result, (PARTS, 3, 3), is in units of the variance of the
    whole error on an axis, so that the sum of all traces is three. The error arises where the
    angular rate bends most. So the trace of a part is proportional to the sum of the squared second
    differences of `turn`, the angular rate, (k, 3), over the samples in it. The fraction `ANY_WAY`
    of the covariance is the same in all directions; the rest has the direction of the second
    differences.
    """
    squares = sum_parts(outer_products(np.diff(turn, 2, axis=0)))
    squares /= max(np.trace(squares.sum(axis=0)), np.finfo(float).tiny)
    traces = np.trace(squares, axis1=1, axis2=2)[:, None, None]
    return ANY_WAY * traces * np.eye(3) + 3 * (1 - ANY_WAY) * squares


def outer_products(vectors):
    """Return the matrices v vᵀ, (n, 3, 3), of the vectors v, `vectors`, (n, 3)."""
    return vectors[:, :, None] * vectors[:, None, :]


def sum_parts(matrices):
    """Return the sums of the matrices in each of `PARTS` equal parts of a sequence, (PARTS, 3, 3).

    `matrices` has the n matrices of the sequence in order of time, (n, 3, 3).
    """
    n, sums = len(matrices), np.zeros((PARTS, 3, 3))
    np.add.at(sums, np.arange(n) * PARTS // max(n, 1), matrices)
    return sums


def middle_steps(count):
    """Return the index of the time step in the middle of each part of m rotations, (m, PARTS).

    Each rotation is cut into `PARTS` equal parts. The index is counted from the start of the
    rotation. `count`, (m,), is the number of samples of each rotation.
    """
    return (2 * np.arange(PARTS) + 1) * (count[:, None] - 2) // (2 * PARTS)
