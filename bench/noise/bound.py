"""Cramér–Rao bound of noise coefficients, from dense covariances."""

import numpy as np
from scipy.fft import irfft, next_fast_len
from scipy.linalg import cho_factor, cho_solve, toeplitz

# samples of a block
BLOCK = 54


def relative_bound(scenario, n, rate, unknown, block=BLOCK):
    r"""Return the least relative standard deviation of each coefficient that is not zero.

    The record is a sum of Gaussian processes on an unknown level. Its distribution is that of

    - the differences of the means of consecutive blocks, and
    - the differences between consecutive samples inside each block,

    both stationary, with covariances :math:`\Sigma = \sum_p \theta_p \Sigma_p` in the squared
    coefficients. Each part adds the Fisher information
    :math:`I_{pq} = \frac12 \mathrm{tr}(\Sigma^{-1} \Sigma_p \Sigma^{-1} \Sigma_q)`, and the bound
    of a coefficient is :math:`\sqrt{(I^{-1})_{pp}} / 2\theta_p`. What is left out is the
    correlation between the two parts and between the insides of two blocks: none for white
    noise, and little for the others at frequencies above one in two blocks, where white noise
    dominates (0.5 % of the bound of K, tested against the closed form).

    Of a Scenario's Q, N, B and K in n samples, what exceeds whole blocks left out; `unknown` are
    the letters of the coefficients that are estimated together. The level always is.
    """
    count = n // block
    truth = np.array([scenario.terms.get(name, 0.0) ** 2 for name in unknown])
    information = np.zeros((len(unknown), len(unknown)))
    parts = (block, count - 1, 1), (1, block - 1, count)
    for samples, size, repeats in parts:
        lags = [difference_covariance(name, samples, size, n, rate) for name in unknown]
        matrices = [toeplitz(lag) for lag in lags]
        factor = cho_factor(sum(t * m for t, m in zip(truth, matrices, strict=True)))
        solved = [cho_solve(factor, m) for m in matrices]
        information += repeats / 2 * np.array([[np.sum(a * b.T) for a in solved] for b in solved])
    # scaled, as coefficients differ by orders of magnitude
    scale = np.sqrt(np.diag(information))
    variance = np.diag(np.linalg.inv(information / np.outer(scale, scale))) / scale**2
    return {
        name: float(np.sqrt(v) / (2 * t))
        for name, t, v in zip(unknown, truth, variance, strict=True)
        if t
    }


def difference_covariance(name, block, count, n, rate):
    """Return the covariance of differences of consecutive block means at lags 0 … count - 1.

    For a unit coefficient and the discrete processes of `imuloop.simulate.noise`.
    """
    lags = np.zeros(count + 1)
    if name == "K":
        # step variance 1/rate; twice the discrete Allan variance, and blocks drift by `block` steps
        lags[:2] = (2 * block**2 + 1) / (3 * block), (block**2 - 1) / (6 * block)
        return lags[:count] / rate
    if name == "N":
        lags[0] = rate / block
    elif name == "Q":
        lags[:2] = np.array([2.0, -1.0]) * (rate / block) ** 2
    elif name == "B":
        covariance = flicker_covariance(n, rate)
        shift = np.arange(1 - block, block)
        at = np.abs(block * np.arange(count + 1)[:, None] + shift)
        lags = covariance[at] @ (block - np.abs(shift)) / block**2
    else:
        raise ValueError(f"no stationary differences of {name}")
    # -c(l - 1) + 2 c(l) - c(l + 1)
    before = np.abs(np.arange(count) - 1)
    return 2 * lags[:count] - lags[before] - lags[1 : count + 1]


def flicker_covariance(n, rate):
    """Return the covariance of `imuloop.simulate.noise.flicker` for B = 1 at lags 0 … 2n - 1."""
    m = next_fast_len(2 * n, real=True)
    f = np.arange(1, m // 2 + 1) * rate / m
    return irfft(np.r_[0.0, rate / m / (np.pi * f)] * m / 2, m)[: 2 * n]
