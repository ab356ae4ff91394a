"""The likelihood of one axis' modes, and its maximum."""

from dataclasses import dataclass

import numpy as np

# the fit ends where the log-likelihood grows by less
CLOSE, ROUNDS = 1e-6, 100
# smallest expected square, share of the one found: rounding of the transform
ROUNDING = 1e-13


@dataclass(frozen=True)
class Fit:
    """Most likely variances.

    Attributes
    ----------
    theta : ndarray, shape (p,)
        Factors of the unit spectra, none negative.
    ramp : float
        Ramp, SI/s; 0 where it was not fitted.
    value : float
        Logarithm of the likelihood, without its constant.
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
    slow : ndarray, shape (s,)
        Amplitudes of the slow modes.
    fast : ndarray, shape (r - s,)
        Mean squares of the fast ones.
    count : ndarray, shape (r,)
        Values behind each row times weight.
    rho : ndarray, shape (s,)
        Amplitudes for a unit ramp.

    References
    ----------
    Sykulski et al., The debiased Whittle likelihood, Biometrika 106 (2019) 251.
    """

    slow: np.ndarray
    fast: np.ndarray
    count: np.ndarray
    rho: np.ndarray

    def power(self, ramp=0.0):
        """Return the mean squares of all rows once a ramp is taken out, shape (r,)."""
        return np.concatenate([(self.slow - ramp * self.rho) ** 2, self.fast])

    def fit(self, units, ramp=False, fixed=0.0, start=None, restricted=False):
        r"""Return the Fit of unit spectra.

        Fisher's scoring, each step a non-negative least squares, halved until the likelihood grows.
        A fitted ramp takes power from the modes that hold it. The restricted likelihood allows for
        that,

        .. math:: \ell_R = \ell - \frac12 \ln \sum_r \rho_r^2/s_r,
            \quad E p_r = s_r - \rho_r^2 / \sum_k \rho_k^2/s_k,

        and so is free of the ramp; it compares models with a ramp, not one with and one without.

        Parameters
        ----------
        units : ndarray, shape (r, p)
            Unit spectra; p may be 0.
        ramp : bool or float
            Whether a ramp is fitted; a number holds it there.
        fixed : ndarray, shape (r,), or 0
            Part of the spectrum that is held.
        start : ndarray, shape (p,), optional
            Where to begin.
        restricted : bool
            Whether a fitted ramp counts in the restricted likelihood.

        References
        ----------
        H. D. Patterson and R. Thompson, Biometrika 58 (1971) 545.
        """
        slope = 0.0 if isinstance(ramp, bool) else ramp
        restricted = restricted and ramp is True
        power = self.power(slope)
        floor = ROUNDING * max(power.max(), np.max(fixed)) + np.finfo(float).tiny
        size = units.max(axis=0) if units.size else np.ones(units.shape[1])
        units = units / size
        if start is None:
            theta = _solve(units, power - fixed, self.count / np.maximum(power, floor) ** 2)
            if not theta.any():
                theta = np.full(units.shape[1], power.mean())
        else:
            theta = start * size
        value = -np.inf
        for _ in range(ROUNDS):
            expected = np.maximum(units @ theta + fixed, floor)
            taken = 0.0
            if ramp is True:
                slope = self.slope(expected)
                power = self.power(slope)
                taken = self._taken(expected) if restricted else 0.0
            new = _solve(units, power + taken - fixed, self.count / expected**2)
            last, value = value, self.value(power, expected, restricted)
            if value - last < CLOSE:
                break
            theta = self._step(units, power, fixed, floor, theta, new, value, restricted)
        return Fit(theta / size, float(slope), value)

    def _step(self, units, power, fixed, floor, theta, new, value, restricted):
        for share in (1.0, 0.5, 0.25, 0.1, 0.03):
            trial = theta + share * (new - theta)
            if self.value(power, np.maximum(units @ trial + fixed, floor), restricted) >= value:
                return trial
        return theta

    def value(self, power, expected, restricted=False):
        """Return the log-likelihood of an expected spectrum, or the restricted one."""
        value = -(self.count @ (np.log(expected) + power / expected)) / 2
        if restricted:
            value -= self._weight * np.log(self._seen(expected).sum()) / 2
        return float(value)

    @property
    def _weight(self):
        """Weight of the modes that hold a ramp."""
        return self.count[: len(self.rho)] @ self.rho**2 / (self.rho @ self.rho)

    def _seen(self, expected):
        """Return what each slow mode tells of a ramp, 1/(SI/s)^2."""
        slow = len(self.rho)
        return self.count[:slow] * self.rho**2 / expected[:slow]

    def _taken(self, expected):
        """Return the mean squares that a fitted ramp takes from all rows."""
        taken = np.zeros(len(expected))
        taken[: len(self.rho)] = self._weight * self.rho**2 / self._seen(expected).sum()
        return taken

    def slope(self, expected):
        """Return the most likely ramp for a spectrum, SI/s."""
        slow = len(self.rho)
        weight = self.count[:slow] * self.rho / expected[:slow]
        return float(weight @ self.slow / (weight @ self.rho))


def _solve(units, power, weight):
    """Return the non-negative weighted least squares."""
    if not units.shape[1]:
        return np.zeros(0)
    root = np.sqrt(weight)
    # equal sizes, so that no column is lost to rounding
    columns = units * root[:, None]
    size = np.linalg.norm(columns, axis=0)
    # loads for a third of a second, and who only evaluates a likelihood has no need of it
    from scipy.optimize import nnls

    return nnls(columns / size, power * root)[0] / size
