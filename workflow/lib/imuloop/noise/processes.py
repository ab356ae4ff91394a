"""The noise processes: covariance of samples and of block means."""

import numpy as np
from scipy.special import sici, xlogy

# the variances that a spectrum is a sum of: squares of Q, N, B, K
NAMES = ("Q", "N", "B", "K")
# means of fewer samples, less than so many of their lengths apart, are summed, not integrated
SHORT, NEAR = 64, 32


def sample_covariances(n, dt):
    r"""Return the covariance of samples at lags 0 to n - 1 for unit Q, N, B, K, shape (4, n), SI.

    At a lag of d samples of `dt` in s

    - quantisation: :math:`2/\Delta t^2` at d = 0, :math:`-1/\Delta t^2` at d = 1;
    - white: :math:`1/\Delta t` at d = 0;
    - flicker up to half the rate: :math:`-\mathrm{Cin}(\pi d)/\pi`, with
      :math:`\mathrm{Cin}(x) = \int_0^x (1 - \cos u)/u\,du`;
    - walk with steps of :math:`K\sqrt{\Delta t}` a sample: :math:`-|d| \Delta t/2`.

    Those of flicker and walk are generalised: they hold for contrasts, sums with weights that
    add up to zero.

    References
    ----------
    IEEE Std 952-1997, annex C; definition of B by the density B^2/(2 pi |f|).
    """
    d = np.arange(n)
    quantisation = (2.0 * (d == 0) - (d == 1)) / dt**2
    return np.stack([quantisation, (d == 0) / dt, _flicker_samples(d), -d * dt / 2])


def block_mean_covariances(d, m, dt):
    """Return the covariance of means over m samples for unit Q, N, B, K, shape (4, ...), SI.

    Of an even record, by the distance of the blocks, with a level that cancels in contrasts;
    `AxisNoise.mean_covariance` is that of any windows of time.

    The same processes as in `sample_covariances`; `d` is the distance of two blocks in samples, 0
    or m and more, `dt` the interval of the samples, s.
    """
    same = d == 0
    quantisation = (2.0 * same - (d == m)) / (m * dt) ** 2
    walk = np.where(same, -(m * m - 1) / (6 * m), -d / 2) * dt
    return np.stack([quantisation, same / (m * dt), _flicker_means(d, m), walk])


def gauss_markov_samples(n, dt, tc):
    """Return the covariance of n samples of Gauss-Markov processes of variance 1, (..., n).

    Lags from 0 for each of the correlation times `tc`, s.
    """
    return np.exp(-np.arange(n) * dt / np.asarray(tc)[..., None])


def gauss_markov_means(d, m, dt, tc):
    """Return the covariance of block means of a Gauss-Markov process of variance 1.

    For distances as `block_mean_covariances` takes them, for each of the correlation times `tc`, s.
    """
    tc = np.reshape(tc, np.shape(tc) + (1,) * d.ndim)
    # 1 - phi^n without cancellation where the process is slow
    phi, one_less, whole = np.exp(-dt / tc), -np.expm1(-dt / tc), -np.expm1(-m * dt / tc)
    same = (m * (1 + phi) / one_less - 2 * phi * whole / one_less**2) / m**2
    apart = np.exp(-np.maximum(d - m + 1, 0) * dt / tc) * (whole / one_less) ** 2 / m**2
    return np.where(d == 0, same, apart)


def _flicker_samples(d):
    """Return the generalised covariance of flicker at a lag of d samples."""
    x = np.pi * np.maximum(d, 1)
    return np.where(d > 0, sici(x)[1] - np.euler_gamma - np.log(x), 0.0) / np.pi


def _flicker_means(d, m):
    r"""Return the generalised covariance of means of m samples of flicker, d samples apart.

    Where sums are integrals it is :math:`-\Delta^2 [x^2 \ln|x|]/2\pi`, x = d/m, with
    :math:`\Delta^2` the second difference, and a constant; between near and short means the sum.
    """

    def k(x):
        return xlogy(x**2, x) / (2 * np.pi)

    x = d / m
    far = 2 * k(x) - k(x + 1) - k(np.abs(x - 1))
    if m >= SHORT:
        return far
    far += (1.5 - np.euler_gamma - np.log(np.pi * m)) / np.pi
    lags = _flicker_samples(np.abs(np.arange(1 - m, (NEAR + 1) * m)))
    near = np.convolve(lags, (m - np.abs(np.arange(1 - m, m))) / m**2, "valid")
    return np.where(d < len(near), near[np.minimum(d, len(near) - 1)], far)
