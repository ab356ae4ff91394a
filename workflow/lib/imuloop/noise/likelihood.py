"""The likelihood of one axis' modes, and its maximum."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import nnls

# the fit ends where the log-likelihood grows by less
CLOSE, ROUNDS = 1e-6, 100
# shares of a step that are tried until the likelihood grows
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)
# smallest expected square, share of the largest that was found: rounding of the transform
ROUNDING = 1e-13


def weighted_nnls(units, target, weight):
    """Return x >= 0 that minimises ``Σ w (y - U x)²``, for columns U of any size, shape (p,)."""
    if not units.shape[1]:
        # scipy's ends the process
        return np.zeros(0)
    root = np.sqrt(weight)
    columns = units * root[:, None]
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    return nnls(columns / size, root * target)[0] / size


@dataclass(frozen=True)
class MaximumLikelihood:
    """Most likely variances.

    `theta`, shape (p,), are factors of the unit spectra, none negative; `ramp` in SI/s is 0 where
    it was not fitted; `value` is the logarithm of the likelihood, without its constant.
    """

    theta: np.ndarray
    ramp: float
    value: float


@dataclass(frozen=True)
class Likelihood:
    r"""Independent Gaussian modes with expected squares linear in the variances.

    .. math:: \ell = -\frac12 \sum_r w_r n_r (\ln s_r + p_r/s_r), \quad s = U \theta

    with p the mean squares of n values and, in the slow modes, :math:`p = (c - R \rho)^2` for a
    ramp R. The weights w are 1 unless the spectrum leaves the model beyond chance.

    Attributes
    ----------
    slow, rho : ndarray, shape (s,)
        Amplitudes of the slow modes, and those for a unit ramp.
    fast : ndarray, shape (r - s,)
        Mean squares of the fast ones.
    count : ndarray, shape (r,)
        Values behind each row times weight.
    digits : float
        Mean square that the rounding of the output may leave.

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
        """Return the mean squares of all rows once a ramp is taken out, shape (r,)."""
        return np.concatenate([(self.slow - ramp * self.rho) ** 2, self.fast])

    def fit(self, units, ramp=False, fixed=0.0, start=None, restricted=False):
        r"""Return the MaximumLikelihood of unit spectra, shape (r, p); p may be 0.

        Fisher's scoring, each step a non-negative least squares, shortened until the likelihood
        grows. A fitted ramp takes power from the modes that hold it. The restricted likelihood
        allows for that,

        .. math:: \ell_R = \ell - \frac12 \ln \sum_r \rho_r^2/s_r,
            \quad E p_r = s_r - \rho_r^2 / \sum_k \rho_k^2/s_k,

        and so is free of the ramp; it compares models with a ramp, not one with and one without.

        A number for `ramp` holds it there; `fixed`, shape (r,), is a part of the spectrum that is
        held; `start`, (p,), is where to begin, near the maximum.

        References
        ----------
        H. D. Patterson and R. Thompson, Biometrika 58 (1971) 545.
        """
        free, slope = ramp is True, 0.0 if isinstance(ramp, bool) else ramp
        slow, restricted, power = len(self.rho), restricted and free, self.power(slope)
        floor = max(self.floor, ROUNDING * np.max(fixed))

        def spectrum(theta):
            return np.maximum(units @ theta + fixed, floor)

        theta = start
        if start is None:
            theta = weighted_nnls(units, power - fixed, self.count / np.maximum(power, floor) ** 2)
            if not theta.any():
                theta = power.mean() / units.max(axis=0)
        expected, last, growth = spectrum(theta), -np.inf, np.inf
        for _ in range(ROUNDS):
            if free:
                slope = self.slope(expected)
                power = self.power(slope)
            value = self.value(power, expected, restricted)
            before, growth, last = growth, value - last, value
            # near the maximum each step grows it by the same share of the one before
            steady = start is not None and before < np.inf
            if growth < CLOSE or (steady and growth**2 < CLOSE / 10 * before):
                break
            target = power - fixed
            if restricted:
                target[:slow] += self._weight / self._information(expected).sum() * self.rho**2
            change = weighted_nnls(units, target, self.count / expected**2) - theta
            for share in SHARES:
                trial = spectrum(theta + share * change)
                if self.value(power, trial, restricted) >= value:
                    theta, expected = theta + share * change, trial
                    break
        return MaximumLikelihood(theta, float(slope), value)

    def value(self, power, expected, restricted=False):
        """Return the log-likelihood of an expected spectrum, or the restricted one."""
        value = -(self.count @ (np.log(expected) + power / expected)) / 2
        if restricted:
            value -= self._weight * np.log(self._information(expected).sum()) / 2
        return float(value)

    def error(self, unit, expected):
        """Return the standard error of a variance, all else known, for a spectrum."""
        return np.sqrt(self.covariance(unit[:, None], expected)[0, 0])

    def covariance(self, derivatives, expected):
        """Return the covariance of parameters by the derivatives of a spectrum, shape (r, p)."""
        rows = derivatives * np.sqrt(self.count / 2)[:, None]
        rows /= self.above_rounding(expected)[:, None]
        size = np.linalg.norm(rows, axis=0)
        size[size == 0] = 1.0
        rows /= size
        return np.linalg.pinv(rows.T @ rows, hermitian=True) / np.outer(size, size)

    def ramp_error(self, expected):
        """Return the standard error of a ramp for a spectrum, SI/s."""
        return 1 / np.sqrt(self._information(self.above_rounding(expected)).sum())

    def slope(self, expected):
        """Return the most likely ramp for a spectrum, SI/s."""
        weight = self.count[: len(self.rho)] * self.rho / expected[: len(self.rho)]
        return float(weight @ self.slow / (weight @ self.rho))

    @cached_property
    def floor(self):
        """Mean square below which only rounding is left."""
        return max(ROUNDING * self.power().max(), self.digits) + np.finfo(float).tiny

    def above_rounding(self, squares):
        """Return mean squares, measured or expected, raised to that of rounding."""
        return np.maximum(squares, self.floor)

    @cached_property
    def _weight(self):
        """Weight of the modes that hold a ramp."""
        squares = self.rho**2
        return self.count[: len(squares)] @ squares / squares.sum()

    def _information(self, expected):
        """Return the information of each slow mode on a ramp, 1/(SI/s)^2."""
        slow = len(self.rho)
        return self.count[:slow] * self.rho**2 / expected[:slow]
