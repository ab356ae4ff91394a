"""Noise coefficients of a device, and the covariance that they give to means of the output."""

from dataclasses import asdict, dataclass, fields, replace

import numpy as np

from imuloop.core.files import read_json
from imuloop.core.samples import CHANNELS

# version of the JSON file
FORMAT = 1
# degree of the B-spline that is the autocorrelation of white noise, by kind of resampling
DEGREES = {"held or averaged": 1, "interpolated": 3, "averaged three times": 5}
# frequency at which the power is a half, share of the sensor's rate, by degree
HALF_POWER = {1: 0.442946, 3: 0.318917, 5: 0.261938}
# least eigenvalue of a correlation matrix that is inverted: far above rounding, far below the
# least eigenvalue of white noise next to a slow random walk
_LEAST_EIGENVALUE = 1e-11


@dataclass(frozen=True)
class Coefficient:
    """One noise coefficient with its uncertainty."""

    value: float | None = None  # estimate, SI; None where the data do not support the term
    ci95: tuple[float, float] | None = None  # 95 % interval of `value`
    upper95: float | None = None  # one-sided 95 % upper limit; given also where `value` is None
    identifiable: bool = False  # whether the data support the term

    @property
    def square(self):
        """Square of the coefficient, SI squared; 0 if the data do not support its term."""
        return 0.0 if self.value is None else self.value**2

    @property
    def size(self):
        """The value, SI; without one the 95 % upper limit; None if there is no limit either."""
        return self.upper95 if self.value is None else self.value

    @classmethod
    def of(cls, value, error):
        """Return the Coefficient with this `value` and the standard error `error`, both SI.

        It counts as supported by the data. Its 95 % interval and its one-sided 95 % upper limit are
        those of a normal distribution; the lower end of the interval is cut off at zero.
        """
        low, high = max(value - 1.96 * error, 0.0), value + 1.96 * error
        return cls(float(value), (float(low), float(high)), float(value + 1.645 * error), True)


@dataclass(frozen=True)
class GaussMarkovTerm:
    """First-order Gauss-Markov process, a noise with a memory of limited duration.

    It is driven by white noise `q`, SI, and has the correlation time `tc`, s.
    """

    q: Coefficient
    tc: Coefficient


@dataclass(frozen=True)
class SinusoidTerm:
    """A line: a sinusoid of `amplitude`, SI, and `frequency`, Hz, whose phase is not known."""

    amplitude: Coefficient
    frequency: Coefficient
    origin: str | None = None  # likely source of the line, e.g. an alias of mains


@dataclass(frozen=True)
class LowPassTerm:
    """Low-pass filter before the output, through which all noise but quantisation passes."""

    kind: str  # key of `noise.gains.GAINS`
    corner: Coefficient  # frequency at which the power is a half, Hz
    floor: float = 0.0  # share of the power of white noise that enters behind the filter

    @property
    def interval_hz(self):
        """Sampling rate of the sensor, Hz, if its values were resampled for the log; else None.

        The kind of the filter shows the resampling: values that were held, interpolated or
        averaged.
        """
        half = HALF_POWER.get(DEGREES.get(self.kind))
        return self.corner.value / half if half else None


# the terms of an axis that are not a single Coefficient
_TERMS = {"gauss_markov": GaussMarkovTerm, "sinusoid": SinusoidTerm, "low_pass": LowPassTerm}


def _read(content, name=""):
    """Return the object for a value in noise.json: a Coefficient, a term, a tuple, or the value.

    The result is a field of an AxisNoise or of one of its terms. `content` is the value. `name` is
    its key in the file, by default empty. A dict becomes a term if `name` is the name of a term,
    such as ``sinusoid``, else a Coefficient. A list or a tuple becomes a tuple, whose items are
    converted in the same way. Any other value stays as it is.
    """
    if isinstance(content, (list, tuple)):
        return tuple(_read(value, name) for value in content)
    if not isinstance(content, dict):
        return content
    values = {key: _read(value, key) for key, value in content.items()}
    return _TERMS.get(name, Coefficient)(**values)


@dataclass(frozen=True)
class AxisNoise:
    r"""Noise of one axis: a sum of independent processes, whose Allan variances add.

    .. math::
        \sigma^2(\tau) = 3 Q^2/\tau^2 + N^2/\tau + (2 \ln 2/\pi) B^2 + K^2 \tau/3 + R^2 \tau^2/2
        + (q^2 T^2/\tau) [1 - (T/2\tau)(3 - 4 e^{-\tau/T} + e^{-2\tau/T})]
        + \Omega^2 [\sin^2(\pi f \tau)/(\pi f \tau)]^2

    :math:`\tau` is the averaging time, s. The other symbols are named at the fields.

    References
    ----------
    IEEE Std 952-1997 (R2008), annex C.
    """

    Q: Coefficient = Coefficient()  # quantisation, m/s or rad
    N: Coefficient = Coefficient()  # white noise, m/s^2/sqrt(Hz) or rad/s/sqrt(Hz)
    B: Coefficient = Coefficient()  # flicker noise (bias instability), m/s^2 or rad/s
    K: Coefficient = Coefficient()  # random walk, m/s^3/sqrt(Hz) or rad/s^2/sqrt(Hz)
    R: Coefficient = Coefficient()  # ramp, m/s^3 or rad/s^2
    gauss_markov: tuple[GaussMarkovTerm, ...] = ()  # q in the unit of K, T = tc in s
    sinusoid: tuple[SinusoidTerm, ...] = ()  # Omega = amplitude, f = frequency in Hz
    # filter that all terms but Q pass; the coefficients are those before the filter
    low_pass: LowPassTerm | None = None

    @classmethod
    def from_dict(cls, content):
        """Return the AxisNoise of one axis from `content`, its entry in noise.json, a dict."""
        # an axis without a filter may lack the key
        content = {"low_pass": None} | content
        names = [field.name for field in fields(cls)]
        return cls(**{name: _read(content[name], name) for name in names})

    def allan_variance(self, tau):
        """Return the Allan variance of all processes together, SI squared, in the shape of `tau`.

        `tau` is an averaging time or an array of them, s.
        """
        tau = np.asarray(tau, float)
        variance = (
            3 * self.Q.square / tau**2
            + self.N.square / tau
            + 2 * np.log(2) / np.pi * self.B.square
            + self.K.square * tau / 3
            + self.R.square * tau**2 / 2
        )
        for process in self.gauss_markov:
            u = tau / process.tc.value
            # 3 - 4 exp(-u) + exp(-2 u) without cancellation where the process is slow
            rise = -np.expm1(-u)
            bracket = 1 - rise * (2 + rise) / (2 * u)
            variance = variance + process.q.square * process.tc.value / u * bracket
        for line in self.sinusoid:
            u = np.pi * line.frequency.value * tau
            variance = variance + line.amplitude.square * (np.sin(u) ** 2 / u) ** 2
        return variance

    def kernel(self, lags):
        r"""Return the covariance of the integral X of the noise, over time, at m times, (m, m).

        The kernel is right only for increments of X from one time to another: terms that cancel in
        increments are left out. For each two times, d is their lag, s the earlier and t the later
        time. L is the last of all times. The processes give

        - quantisation: :math:`Q^2` at d = 0;
        - white: :math:`-N^2 |d|/2`;
        - flicker: :math:`(B^2/2\pi)\, d^2 \ln(|d|/e^{3/2} L)`, that is an output of covariance
          :math:`(B^2/\pi) \ln(L/|d|)`;
        - Gauss-Markov: :math:`-(q^2 T^3/2)(d/T - 1 + e^{-d/T})`;
        - sinusoid: :math:`\Omega^2 \cos(\omega d)/2\omega^2`;
        - walk from time 0 on: :math:`K^2 (s^2 t/2 - s^3/6)`.

        The ramp is deterministic and adds nothing. `lags` is the result of the function `lags` for
        the times: d, d², ln(d/L) - 3/2, s², and t/2 - s/6, (m, m) each.
        """
        d, d2, logarithm, early2, late = lags
        total = (
            self.Q.square * (d == 0)
            - self.N.square * d / 2
            + self.B.square / (2 * np.pi) * d2 * logarithm
            + self.K.square * early2 * late
        )
        for process in self.gauss_markov:
            u = d / process.tc.value
            total = total - process.q.square * process.tc.value**3 / 2 * (u + np.expm1(-u))
        for line in self.sinusoid:
            omega = 2 * np.pi * line.frequency.value
            total = total + line.amplitude.square * np.cos(omega * d) / (2 * omega**2)
        return total

    def mean_covariance(self, windows, shared=None):
        """Return the covariance of the mean noise in n windows of time, (n, n), SI squared.

        Flicker and random walk add a constant that all windows of a power cycle, the time between
        two switch-offs, have in common. A fitted bias absorbs this constant, so the variance of the
        constant does not matter. It is made small: the walk starts from zero at the first window.
        Means of different power cycles are independent. Coefficients that are not identifiable
        count as 0. The ramp is not random and adds nothing.

        Parameters
        ----------
        windows : ndarray, shape (n, 2)
            Start and end of each window, s, in any order; windows may overlap.
        shared : list, optional
            The result of `edges(windows, power_cycle)`, which is the same for all axes; by default
            it is computed here, for windows of one power cycle.
        """
        covariance = np.zeros((len(windows),) * 2)
        for index, start, end, functions_of_lags in edges(windows) if shared is None else shared:
            # a mean is the increment of the integral over the window, divided by its length
            integral = self.kernel(functions_of_lags)
            increment = integral[end] - integral[start]
            increment = increment[:, end] - increment[:, start]
            length = windows[index, 1] - windows[index, 0]
            # the mean with the transpose removes the asymmetry by rounding
            symmetric = (increment + increment.T) / 2
            covariance[np.ix_(index, index)] = symmetric / (length[:, None] * length)
        return covariance


def edges(windows, power_cycle=None):
    """Return the edges of windows of time, and functions of their lags, for each power cycle.

    `AxisNoise.mean_covariance` needs them; they are the same for all axes. An edge is the time at
    which a window starts or ends.

    Parameters
    ----------
    windows : ndarray, shape (n, 2)
        Start and end of each window, s.
    power_cycle : ndarray of int, shape (n,), optional
        Number of the power cycle, the time between two switch-offs, of each window; by default all
        windows are in one.

    Returns
    -------
    list of tuple
        A tuple of four items for each power cycle. The first item has the indices of its k windows,
        (k,). The edges of these windows are m different times. The second item has the index of the
        start of each window among these times, (k,), and the third item the index of its end, (k,).
        The fourth item is the result of `lags` for the m times, five arrays (m, m).
    """
    if power_cycle is None:
        power_cycle = np.zeros(len(windows), dtype=int)
    shared = []
    for cycle in np.unique(power_cycle):
        index = np.flatnonzero(power_cycle == cycle)
        times, index_of_time = np.unique(windows[index], return_inverse=True)
        start, end = index_of_time.reshape(-1, 2).T
        shared.append((index, start, end, lags(times - times[0])))
    return shared


def lags(t):
    """Return five functions of the lag of each two of m times, (m, m) each, for `AxisNoise.kernel`.

    They are the lag d, d², ln(d/L) - 3/2, s² and t/2 - s/6. s is the earlier and t the later of the
    two times, and L the last time of all. The times `t`, (m,), increase from 0, s.
    """
    d = np.abs(t[:, None] - t)
    early, late = np.minimum(t[:, None], t), np.maximum(t[:, None], t)
    # any finite number will do at lag 0, where the factor d² removes the term
    logarithm = np.log(np.where(d > 0, d, t[-1]) / t[-1]) - 1.5
    return d, d**2, logarithm, early**2, late / 2 - early / 6


@dataclass(frozen=True)
class NoiseModel:
    """Noise coefficients of the six axes of a device."""

    device: str  # name
    axes: dict[str, AxisNoise]  # one entry for each of ax, ay, az, gx, gy, gz

    def value_and_std(self, axis, term):
        """Return the value and the standard deviation of one noise coefficient of an axis, SI.

        `axis` is the name of the axis, and `term` is ``B`` for flicker or ``K`` for random walk.
        The standard deviation is the width of the 95 % interval divided by 2 · 1.96, or 0 if there
        is no interval. If the data do not support the term, the value is 0 and the standard
        deviation is the 95 % upper limit divided by 1.96.
        """
        coefficient = getattr(self.axes[axis], term)
        if coefficient.value is None:
            # the size of a normal variable of mean zero has its 95 % quantile at 1.96 σ
            return 0.0, (coefficient.upper95 or 0.0) / 1.96
        low, high = coefficient.ci95 or (coefficient.value, coefficient.value)
        return coefficient.value, (high - low) / (2 * 1.96)

    def with_sizes(self, sizes):
        """Return the NoiseModel with other values of some coefficients.

        `sizes` is a dict of new values, SI, by (axis, term), such as ``("gx", "B")``; all other
        coefficients stay. All intervals and limits stay, too, also those of the coefficients with
        new values.
        """
        axes = dict(self.axes)
        for (axis, term), value in sizes.items():
            coefficient = replace(getattr(axes[axis], term), value=value)
            axes[axis] = replace(axes[axis], **{term: coefficient})
        return replace(self, axes=axes)

    def mean_covariance(self, windows, power_cycle=None):
        """Return the covariance of the mean noise of each axis in n windows of time, (6, n, n).

        The unit is (m/s^2)^2 for ax, ay, az and (rad/s)^2 for gx, gy, gz. An axis without
        coefficients has zeros. `windows`, (n, 2), has start and end of each window, s.
        `power_cycle`, (n,) of int, has the number of the power cycle, the time between two
        switch-offs, of each window; by default all windows are in one. Raises a ValueError if a
        window does not end after its start.
        """
        windows = np.asarray(windows, float)
        if windows.ndim != 2 or windows.shape[1] != 2 or np.any(windows[:, 1] <= windows[:, 0]):
            raise ValueError("windows: a start and a later end each needed, shape (n, 2)")
        shared = edges(windows, power_cycle)
        covariance = np.empty((len(CHANNELS), len(windows), len(windows)))
        # one axis at a time saves memory, as a record of days has thousands of windows
        for total, axis in zip(covariance, CHANNELS, strict=True):
            total[:] = self.axes[axis].mean_covariance(windows, shared)
        return covariance

    def to_dict(self):
        """Return the entries of noise.json that describe the model, a dict."""
        return {
            "format": FORMAT,
            "device": self.device,
            "axes": {name: asdict(self.axes[name]) for name in CHANNELS},
        }

    @classmethod
    def from_dict(cls, content):
        """Return the NoiseModel from `content`, the dict in noise.json; other keys are ignored."""
        axes = {name: AxisNoise.from_dict(content["axes"][name]) for name in CHANNELS}
        return cls(content["device"], axes)

    @classmethod
    def from_json(cls, path):
        """Return the NoiseModel from a file noise.json at `path`."""
        return cls.from_dict(read_json(path))


def without_weight(covariance):
    """Return two masks, (k,), of the covariances that cannot be inverted, out of k.

    A fit weighs values with the inverse of their covariance, so it cannot use values whose
    covariance has none. `covariance`, (k, n, n), has k covariance matrices of n values each. The
    first mask marks those in which a variance is zero. The second mask marks those without a zero
    variance whose correlation matrix has an eigenvalue below `_LEAST_EIGENVALUE`: some weighted sum
    of the n values then has almost no variance. An example is the covariance of a sinusoid without
    other noise, which is a sum of a cosine and a sine, and so has rank two.
    """
    sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    silent = ~np.all(sigma > 0, axis=1)
    sigma = np.where(sigma > 0, sigma, 1.0)
    correlation = covariance / (sigma[:, :, None] * sigma[:, None])
    least = np.linalg.eigvalsh(correlation).min(axis=1, initial=1.0)
    return silent, ~silent & (least < _LEAST_EIGENVALUE)
