"""The likelihood of the noise terms of one axis, and its maximum."""

from dataclasses import dataclass
from functools import cached_property
from math import exp

import numpy as np
from scipy.optimize import fminbound, nnls

# a fit ends when a round raises the log-likelihood by less than CLOSE, or after ROUNDS rounds
CLOSE, ROUNDS = 1e-6, 100
# shares of a step that are tried until the likelihood grows
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)
# smallest expected square as a share of the largest measured one: the transform rounds the rest
ROUNDING = 1e-13


def weighted_nnls(units, target, weight):
    """Return the x, (p,), of weighted non-negative least squares: it minimises ``Σ w (y - U x)²``.

    `units` is the matrix U, (r, p), whose columns may differ much in magnitude. `target` is y,
    (r,), and `weight` is w, (r,). The sum is over the r rows. No element of x is negative.
    """
    root = np.sqrt(weight)
    columns, size = _normalised(units * root[:, None])
    return nnls(columns, root * target)[0] / size


def _normalised(columns):
    """Return a matrix with each column divided by its Euclidean norm, and the norms, (p,).

    So columns of different units lose no digits in a later solution. `columns` is the matrix, (r,
    p), of r rows and p columns. A column of zeros stays as it is; its norm is given as 1.
    """
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    return columns / size, size


def likeliest(log_likelihood, low, high, close=1e-5):
    """Return the positive number at which a log-likelihood is largest, a float.

    `log_likelihood` is a function of one number. The number is sought from `low` to `high`, both
    positive. `close` is the largest relative error of the result.
    """
    ends = np.log([low, high])
    return exp(fminbound(lambda u: -log_likelihood(exp(u)), *ends, xtol=close))


@dataclass(frozen=True)
class MaximumLikelihood:
    """The likeliest variances of p noise terms, the likeliest ramp, and the log-likelihood."""

    theta: np.ndarray  # variances, (p,): factors of the unit spectra, none negative
    ramp: float  # SI/s; 0 if no ramp was fitted
    value: float  # log-likelihood, without its constant
    restricted: float  # the restricted log-likelihood where a ramp was fitted, else `value`


@dataclass(frozen=True)
class Likelihood:
    r"""The likelihood of the noise terms of one axis, given the modes of its signals (`Modes`).

    .. math:: \ell = -\frac12 \sum_r w_r n_r (\ln s_r + p_r/s_r), \quad s = U \theta

    Modes are amplitudes of the output in a basis where noise hardly correlates: slow modes are
    contrasts of the means of blocks of samples, fast modes the cosine coefficients of each block.
    They are taken as independent and Gaussian. A row r is one slow mode or a bin of fast modes of
    neighbouring frequencies. :math:`p_r` is the mean square of the :math:`n_r` values of the row,
    and :math:`s_r` its expected value. The expected values are linear in the variances
    :math:`\theta` of the terms, and U has them for terms of variance 1. A slow mode has :math:`p =
    (c - R \rho)^2`, with its amplitude c, the ramp R and the amplitude :math:`\rho` for a ramp of 1
    SI/s. The weights w are 1 unless the model does not fit the spectrum (`noise.misfit`).

    Attributes
    ----------
    slow, rho : ndarray, shape (s,)
        Amplitudes c of the s slow modes, SI, and their amplitudes for a ramp of 1 SI/s, s.
    fast : ndarray, shape (r - s,)
        Mean squares in the bins of fast modes, SI^2.
    count : ndarray, shape (r,)
        w n: the number of values in each row, times the weight of the row.
    digits : float
        Mean square that the rounding of the output may leave in a row, SI^2.

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
        """Return the measured mean squares of the r rows, (r,), SI^2, without a `ramp`, SI/s.

        A row is a slow mode or a bin of fast modes (`Modes`). The ramp is subtracted from the slow
        modes, as only they show one.
        """
        return np.concatenate([(self.slow - ramp * self.rho) ** 2, self.fast])

    def fit(self, units, ramp=0.0, fixed=0.0, start=None, close=CLOSE):
        r"""Return the MaximumLikelihood: the likeliest variances of p noise terms, and the ramp.

        The method is Fisher's scoring. Each step is a non-negative least-squares fit, shortened
        until the likelihood grows. A fitted ramp takes power from the slow modes. The restricted
        likelihood :math:`\ell_R` and the expected power :math:`E p_r` of a slow mode allow for
        that:

        .. math::
            \ell_R = \ell - \frac{\bar w}{2} \ln \sum_r w_r \rho_r^2/s_r, \quad
            E p_r = s_r - \bar w \rho_r^2 \Big/ \sum_k w_k \rho_k^2/s_k, \quad
            \bar w = \sum_r w_r \rho_r^2 \Big/ \sum_r \rho_r^2

        In slow mode r, :math:`\rho_r` is the amplitude of a ramp of 1 SI/s, :math:`s_r` the
        expected mean square and :math:`w_r` the weight. The mean weight :math:`\bar w` is 1 if all
        weights are 1.

        The restricted likelihood is maximised if a ramp is fitted, and two models with a ramp are
        compared by it. A model with a ramp and one without are compared by the plain likelihood
        :math:`\ell`.

        Parameters
        ----------
        units : ndarray, shape (r, p)
            Expected mean squares of the r rows for each of the p terms with variance 1.
        ramp : float or None
            Fixed ramp, SI/s; None to fit the ramp.
        fixed : ndarray, shape (r,), or float
            Part of the expected mean squares that is known and not fitted, SI^2.
        start : ndarray, shape (p,), optional
            Variances of the terms near the maximum, from which the fit begins; by default it begins
            from a least-squares solution.
        close : float
            The fit ends when the log-likelihood grows by less than this in a round.

        References
        ----------
        H. D. Patterson and R. Thompson, Biometrika 58 (1971) 545.
        """
        slope, power = ramp, self.power(ramp or 0.0)
        # mean weight of the slow modes, in which each counts by its share of the power of a ramp
        weight = self.count[: len(self.rho)] @ self.rho**2 / (self.rho @ self.rho)
        floor = max(self.floor, ROUNDING * np.max(fixed))

        def spectrum(theta):
            """Return the expected mean squares of all rows, (r,), for variances `theta`, (p,)."""
            return np.maximum(units @ theta + fixed, floor)

        def values(expected):
            """Return the plain and the restricted log-likelihood for mean squares, `expected`."""
            value = -(self.count @ (np.log(expected) + power / expected)) / 2
            # the second result of `ramp` is the information about the ramp, Σ w rho²/s
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
            # near the maximum each round gains a fixed share of the gain of the round before: so
            # two gains give the sum of all later ones, and the fit ends if this sum is small enough
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
        """Return the covariance of p fitted parameters, (p, p), by their information matrix.

        A row is a slow mode or a bin of fast modes (`Modes`). `expected`, (r,), are the expected
        mean squares s of the rows, and `derivatives`, (r, p), their derivatives with respect to the
        parameters. A mean square of n values has the variance ``2 s²/n``, so the information of a
        row about s is ``n/2s²``. With the weight w of the row, this information becomes ``w
        n/2s²``.
        """
        # rows whose products add up to the information matrix: root of w n/2, over s
        rows = derivatives * np.sqrt(self.count / 2)[:, None]
        rows, size = _normalised(rows / self.above_rounding(expected)[:, None])
        # columns of length one: parameters of different units would lose digits. The pseudo-inverse
        # is finite even if the rows cannot tell two parameters apart, or do not show one
        return np.linalg.pinv(rows.T @ rows, hermitian=True) / np.outer(size, size)

    def ramp(self, expected):
        """Return the likeliest ramp, SI/s, and the information about it, s²/SI².

        The information is the inverse of the variance of this estimate. It sums over the slow
        modes, each by its weight, as fast modes do not show a ramp. `expected`, (r,), are the
        expected mean squares of all rows, slow modes and then bins of fast modes, SI^2.
        """
        slow = len(self.rho)
        weight = self.count[:slow] * self.rho / self.above_rounding(expected[:slow])
        information = float(weight @ self.rho)
        return float(weight @ self.slow) / information, information

    @cached_property
    def floor(self):
        """Mean square, SI^2, that the rounding of numbers alone may leave in a row.

        A row is a slow mode or a bin of fast modes. A smaller mean square says nothing about noise.
        """
        return max(ROUNDING * self.power().max(), self.digits) + np.finfo(float).tiny

    def above_rounding(self, squares):
        """Return mean squares, SI^2, with those below the `floor` of rounding raised to it.

        `squares` is an array of mean squares, SI^2; the result has its shape.
        """
        return np.maximum(squares, self.floor)
