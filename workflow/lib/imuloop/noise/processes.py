"""The noise processes: covariances of their means over several samples."""

import numpy as np
from scipy.special import sici, xlogy

# names of the coefficients whose squares are the variances of the noise processes
NAMES = ("Q", "N", "B", "K")
# the covariance of means of fewer than SHORT samples, less than NEAR of their lengths apart, is
# computed by sums, not integrals
SHORT, NEAR = 64, 32


def covariances(d, m, dt, correlation_times=()):
    r"""Yield the covariance of two means over m samples, SI^2, for each noise process.

    Each covariance is an array in the shape of `d`. The first four are for quantisation, white
    noise, flicker and random walk, whose coefficients Q, N, B and K are 1. The others are for
    Gauss-Markov processes of variance 1, one for each of the `correlation_times`, s.

    `d`, an array, has distances, in samples, from the start of one mean to the start of the other.
    A distance is 0 or at least `m`, the number of samples of a mean. `dt` = Δt is the interval of
    the samples, s. For single samples, that is m = 1, the covariance is as follows, with the
    correlation time T and 0 where no value is given:

    - quantisation: :math:`2/\Delta t^2` at d = 0, :math:`-1/\Delta t^2` at d = 1;
    - white: :math:`1/\Delta t` at d = 0;
    - flicker up to half the rate: :math:`-\mathrm{Cin}(\pi d)/\pi`, with
      :math:`\mathrm{Cin}(x) = \int_0^x (1 - \cos u)/u\,du`;
    - walk with steps of :math:`K\sqrt{\Delta t}` a sample: :math:`-|d| \Delta t/2`;
    - Gauss-Markov: :math:`e^{-d \Delta t/T}`.

    The covariances of flicker and walk are generalised: they hold only for contrasts, which are
    weighted sums whose weights add up to zero.

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
    """Return the generalised covariance of two samples of flicker noise with coefficient B = 1.

    It holds only for weighted sums whose weights add up to zero. `d` is an array of distances
    between the two samples, in sampling intervals; the result has its shape.
    """
    x = np.pi * np.maximum(d, 1)
    return np.where(d > 0, sici(x)[1] - np.euler_gamma - np.log(x), 0.0) / np.pi


def _flicker_means(d, m):
    r"""Return the generalised covariance of two means over m samples of flicker noise with B = 1.

    It holds only for weighted sums whose weights add up to zero. `d` is an array of distances
    between the starts of both means, in samples; the result has its shape. If the means are far
    apart or long, sums over their samples are replaced by integrals. The covariance is then a
    constant plus :math:`-\Delta^2 [x^2 \ln|x|]/2\pi` with x = d/m and the second difference
    :math:`\Delta^2`. Otherwise the covariance is the average over all pairs of samples, one from
    each mean.
    """

    def k(x):
        """Return ``x² ln x/2π`` for an array `x` of positive numbers; 0 at x = 0."""
        return xlogy(x**2, x) / (2 * np.pi)

    x = d / m
    far = 2 * k(x) - k(x + 1) - k(np.abs(x - 1))
    if m >= SHORT:
        return far
    far += (1.5 - np.euler_gamma - np.log(np.pi * m)) / np.pi
    lags = _flicker_samples(np.abs(np.arange(1 - m, (NEAR + 1) * m)))
    near = np.convolve(lags, (m - np.abs(np.arange(1 - m, m))) / m**2, "valid")
    return np.where(d < len(near), near[np.minimum(d, len(near) - 1)], far)
