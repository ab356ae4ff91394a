"""The noise processes: covariance of samples and of block means."""

import numpy as np
from scipy.special import sici, xlogy

# the variances that a spectrum is a sum of: squares of Q, N, B, K
NAMES = ("Q", "N", "B", "K")
# the covariance of means of fewer than SHORT samples, less than NEAR of their lengths apart, is
# computed by sums, not integrals
SHORT, NEAR = 64, 32


def covariances(d, m, dt, correlation_times=()):
    r"""Yield the covariance of means over m samples for each process, SI, of the shape of `d`.

    The first four arrays are for the unit coefficients Q, N, B, K. The others are for Gauss-Markov
    processes of variance 1, one for each of the `correlation_times`, s. The record is evenly
    sampled, with the interval `dt` = Δt, s. `d` is the distance in samples from the start of one
    mean to the start of the other, 0 or at least m. For single samples, with m = 1 and the
    correlation time T, the covariance is:

    - quantisation: :math:`2/\Delta t^2` at d = 0, :math:`-1/\Delta t^2` at d = 1;
    - white: :math:`1/\Delta t` at d = 0;
    - flicker up to half the rate: :math:`-\mathrm{Cin}(\pi d)/\pi`, with
      :math:`\mathrm{Cin}(x) = \int_0^x (1 - \cos u)/u\,du`;
    - walk with steps of :math:`K\sqrt{\Delta t}` a sample: :math:`-|d| \Delta t/2`;
    - Gauss-Markov: :math:`e^{-d \Delta t/T}`.

    The covariances of flicker and walk are generalised: they hold for contrasts, sums with weights
    that add up to zero.

    References
    ----------
    IEEE Std 952-1997, annex C; definition of B by the density B^2/(2 pi |f|).
    """
    same = d == 0
    yield (2.0 * same - (d == m)) / (m * dt) ** 2
    yield same / (m * dt)
    yield _flicker_samples(d) if m == 1 else _flicker_means(d, m)
    yield np.where(same, -(m * m - 1) / (6 * m), -d / 2) * dt
    for tc in correlation_times:
        # phi is the correlation of neighbouring samples; 1 - phi and 1 - phi^m are computed without
        # cancellation for slow processes
        phi, one_less, whole = np.exp(-dt / tc), -np.expm1(-dt / tc), -np.expm1(-m * dt / tc)
        variance = (m * (1 + phi) / one_less - 2 * phi * whole / one_less**2) / m**2
        apart = np.exp(-np.maximum(d - m + 1, 0) * dt / tc) * (whole / one_less) ** 2 / m**2
        yield np.where(same, 1.0 if m == 1 else variance, apart)


def _flicker_samples(d):
    """Return the generalised covariance of flicker at a lag of d samples."""
    x = np.pi * np.maximum(d, 1)
    return np.where(d > 0, sici(x)[1] - np.euler_gamma - np.log(x), 0.0) / np.pi


def _flicker_means(d, m):
    r"""Return the generalised covariance of means of m samples of flicker, d samples apart.

    If sums may be taken as integrals, it is a constant plus :math:`-\Delta^2 [x^2 \ln|x|]/2\pi`
    with x = d/m and the second difference :math:`\Delta^2`. If the means are near each other and
    short, it is the mean over all pairs of samples.
    """

    def k(x):
        """Return ``x² ln x/2π``."""
        return xlogy(x**2, x) / (2 * np.pi)

    x = d / m
    far = 2 * k(x) - k(x + 1) - k(np.abs(x - 1))
    if m >= SHORT:
        return far
    far += (1.5 - np.euler_gamma - np.log(np.pi * m)) / np.pi
    lags = _flicker_samples(np.abs(np.arange(1 - m, (NEAR + 1) * m)))
    near = np.convolve(lags, (m - np.abs(np.arange(1 - m, m))) / m**2, "valid")
    return np.where(d < len(near), near[np.minimum(d, len(near) - 1)], far)
