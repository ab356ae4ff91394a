"""The likelihood of the modes of one axis, and its maximum."""

from dataclasses import dataclass
from functools import cached_property
from math import exp

import numpy as np
from scipy.optimize import fminbound, nnls

# rise of the log-likelihood in a round at which a fit ends, by default, and most rounds
CLOSE, ROUNDS = 1e-6, 100
# shares of a step that are tried until the likelihood grows
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)
# smallest expected square, share of the largest measured one: rounding of the transform
ROUNDING = 1e-13


def weighted_nnls(units, target, weight):
    """Return x >= 0, (p,), that minimises ``Σ w (y - U x)²``.

    Takes the matrix U, (r, p), whose columns may have any size; y and the weight w, (r,).
    """
    root = np.sqrt(weight)
    columns, size = _normalised(units * root[:, None])
    return nnls(columns, root * target)[0] / size


def _normalised(columns):
    """Return columns, (r, p), over their norms, and the norms, (p,), with 1 for a zero column."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    return columns / size, size


def likeliest(log_likelihood, low, high, close=1e-5):
    """Return the number from `low` to `high`, both positive, at which a function is largest.

    The result has at most the relative error `close`.
    """
    ends = np.log([low, high])
    return exp(fminbound(lambda u: -log_likelihood(exp(u)), *ends, xtol=close))


@dataclass(frozen=True)
class MaximumLikelihood:
    """The most likely variances of the terms, and the log-likelihood there."""

    theta: np.ndarray  # variances, the factors of the unit spectra, (p,), none negative
    ramp: float  # SI/s; 0 if no ramp was fitted
    value: float  # log-likelihood, without its constant
    restricted: float  # the restricted log-likelihood where a ramp was fitted, else `value`


@dataclass(frozen=True)
class Likelihood:
    r"""Independent Gaussian modes with expected squares that are linear in the variances.

    .. math:: \ell = -\frac12 \sum_r w_r n_r (\ln s_r + p_r/s_r), \quad s = U \theta

    In row r, :math:`p_r` is the mean square of :math:`n_r` values, and :math:`s_r` the mean square
    that is expected for the unit spectra U and the variances :math:`\theta`. In the slow modes,
    :math:`p = (c - R \rho)^2` for amplitudes c and a ramp R. The weights w are 1 unless the model
    does not fit the spectrum (`noise.misfit`).

    Attributes
    ----------
    slow, rho : ndarray, shape (s,)
        Amplitudes c of the slow modes, SI, and those for a ramp of 1 SI/s.
    fast : ndarray, shape (r - s,)
        Mean squares of the fast modes, SI^2.
    count : ndarray, shape (r,)
        w n: the number of values in each row, times the weight of the row.
    digits : float
        Mean square that the rounding of the output may leave, SI^2.

    References
    ----------
    Sykulski et al., The debiased Whittle likelihood, Biometrika 106 (2019) 251.
    """

    slow: np.ndarray
    fast: np.ndarray
    count: np.ndarray
    rho: np.ndarray
    digits: float = 0.0

    def power(self, ramp=0.0):
        """Return the mean squares of all rows without a ramp in SI/s, shape (r,), SI^2."""
        return np.concatenate([(self.slow - ramp * self.rho) ** 2, self.fast])

    def fit(self, units, ramp=0.0, fixed=0.0, start=None, close=CLOSE):
        r"""Return the MaximumLikelihood of unit spectra.

        The method is Fisher's scoring. Each step is a non-negative least squares, shortened until
        the likelihood grows. A fitted ramp takes power from the slow modes. The restricted
        likelihood allows for that,

        .. math:: \ell_R = \ell - \frac12 \ln \sum_r \rho_r^2/s_r,
            \quad E p_r = s_r - \rho_r^2 / \sum_k \rho_k^2/s_k

        The restricted likelihood is maximised if a ramp is fitted, and two models with a ramp are
        compared by it. A model with a ramp and one without are compared by the plain likelihood
        :math:`\ell`.

        Parameters
        ----------
        units : ndarray, shape (r, p)
            Expected mean squares for unit variances.
        ramp : float or None
            Fixed ramp, SI/s; None to fit the ramp.
        fixed : ndarray, shape (r,), or float
            Fixed part of the expected mean squares, SI^2.
        start : ndarray, shape (p,), optional
            Variances near the maximum, from which to begin.
        close : float
            The fit ends when the log-likelihood grows by less than this.

        References
        ----------
        H. D. Patterson and R. Thompson, Biometrika 58 (1971) 545.
        """
        slope, power = ramp, self.power(ramp or 0.0)
        # mean weight of the slow modes, by their share of a ramp
        weight = self.count[: len(self.rho)] @ self.rho**2 / (self.rho @ self.rho)
        floor = max(self.floor, ROUNDING * np.max(fixed))

        def spectrum(theta):
            """Return the expected mean squares, (r,), for variances, (p,)."""
            return np.maximum(units @ theta + fixed, floor)

        def values(expected):
            """Return the plain and the restricted log-likelihood for expected squares, (r,)."""
            value = -(self.count @ (np.log(expected) + power / expected)) / 2
            lost = weight * np.log(self.ramp(expected)[1]) / 2 if ramp is None else 0.0
            return float(value), float(value - lost)

        theta = start
        if start is None:
            theta = weighted_nnls(units, power - fixed, self.count / np.maximum(power, floor) ** 2)
            if not theta.any():
                theta = power.mean() / units.max(axis=0)
        expected, last, growth = spectrum(theta), -np.inf, np.inf
        for _ in range(ROUNDS):
            taken = 0.0
            if ramp is None:
                # `taken` is the power that the fitted ramp takes from the slow modes
                slope, information = self.ramp(expected)
                power = self.power(slope)
                taken = np.zeros(len(power))
                taken[: len(self.rho)] = weight / information * self.rho**2
            value, restricted = values(expected)
            before, growth, last = growth, restricted - last, restricted
            # near the maximum each round gains a fixed share of the gain of the round before: the
            # sum of all later gains is small enough
            steady = start is not None and before < np.inf
            if growth < close or (steady and growth**2 < close / 10 * before):
                break
            change = weighted_nnls(units, power - fixed + taken, self.count / expected**2) - theta
            for share in SHARES:
                trial = spectrum(theta + share * change)
                if values(trial)[1] >= restricted:
                    theta, expected = theta + share * change, trial
                    break
        return MaximumLikelihood(theta, float(slope), value, restricted)

    def covariance(self, derivatives, expected):
        """Return the covariance of p parameters, (p, p), by the information matrix.

        Takes the derivatives of the expected mean squares by the parameters, (r, p), and the
        expected mean squares, (r,).
        """
        rows = derivatives * np.sqrt(self.count / 2)[:, None]
        rows, size = _normalised(rows / self.above_rounding(expected)[:, None])
        return np.linalg.pinv(rows.T @ rows, hermitian=True) / np.outer(size, size)

    def ramp(self, expected):
        """Return the likeliest ramp, SI/s, for expected squares, (r,), and its information, s²/SI².

        The information is the inverse of the variance of the ramp.
        """
        slow = len(self.rho)
        weight = self.count[:slow] * self.rho / self.above_rounding(expected[:slow])
        information = float(weight @ self.rho)
        return float(weight @ self.slow) / information, information

    @cached_property
    def floor(self):
        """Mean square below which only rounding is left, SI^2."""
        return max(ROUNDING * self.power().max(), self.digits) + np.finfo(float).tiny

    def above_rounding(self, squares):
        """Return mean squares, measured or expected, raised to the floor of rounding."""
        return np.maximum(squares, self.floor)
