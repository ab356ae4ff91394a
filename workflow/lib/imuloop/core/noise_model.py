"""Noise coefficients of a device, and the covariance of means that follows from them."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from imuloop.core.files import read_json
from imuloop.core.low_pass import DEGREES, HALF_POWER, LowPass
from imuloop.core.samples import CHANNELS

# version of the JSON file
FORMAT = 1
# of a correlation matrix that is inverted: far above rounding, far below noise beside a slow walk
_LEAST_EIGENVALUE = 1e-11


@dataclass(frozen=True)
class Coefficient:
    """One coefficient with its uncertainty."""

    value: float | None = None  # estimate, SI; None where the data do not support the term
    ci95: tuple[float, float] | None = None  # 95 % interval of `value`
    upper95: float | None = None  # one-sided 95 % upper limit; given also where `value` is None
    identifiable: bool = False  # whether the data support the term

    @property
    def square(self):
        """Return the square of the value, 0 where not identifiable."""
        return 0.0 if self.value is None else self.value**2

    @property
    def size(self):
        """Return the value, or the upper limit of a term that was not seen; None without both."""
        return self.upper95 if self.value is None else self.value

    @classmethod
    def of(cls, value, error):
        """Return a coefficient that the data support, of its value and standard error."""
        low, high = max(value - 1.96 * error, 0.0), value + 1.96 * error
        return cls(float(value), (float(low), float(high)), float(value + 1.645 * error), True)

    @classmethod
    def from_dict(cls, content):
        """Return the coefficient from its JSON form."""
        return cls(**content | {"ci95": content["ci95"] and tuple(content["ci95"])})


@dataclass(frozen=True)
class GaussMarkovTerm:
    """First-order Gauss-Markov process: density `q` of the drive, correlation time `tc` in s."""

    q: Coefficient
    tc: Coefficient


@dataclass(frozen=True)
class SinusoidTerm:
    """Line of `amplitude` (SI of the axis) and `frequency` in Hz, phase unknown."""

    amplitude: Coefficient
    frequency: Coefficient
    origin: str | None = None  # what the line is likely to be, e.g. an alias of mains


@dataclass(frozen=True)
class LowPassTerm:
    """Filter in front of the output, of the random processes all but quantisation pass it.

    `kind` is one of `core.low_pass.GAINS`; `corner`, Hz, is where the power has fallen to a half;
    `floor` is the share of the white noise that enters behind it.
    """

    kind: str
    corner: Coefficient
    floor: float = 0.0

    @property
    def interval_hz(self):
        """Rate, Hz, of a sensor whose values were held, interpolated or averaged, else None."""
        half = HALF_POWER.get(DEGREES.get(self.kind))
        return self.corner.value / half if half else None

    def gain(self, f, rate):
        """Return the power gain at frequencies in Hz of an output sampled at `rate`, Hz."""
        return LowPass(self.kind, self.corner.value / rate, self.floor).gain(f / rate)


@dataclass(frozen=True)
class AxisNoise:
    r"""Processes of one axis; independent, so that their Allan variances add.

    .. math::
        \sigma^2(\tau) = 3 Q^2/\tau^2 + N^2/\tau + (2 \ln 2/\pi) B^2 + K^2 \tau/3 + R^2 \tau^2/2
        + (q^2 T^2/\tau) [1 - (T/2\tau)(3 - 4 e^{-\tau/T} + e^{-2\tau/T})]
        + \Omega^2 [\sin^2(\pi f \tau)/(\pi f \tau)]^2

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
    # filter behind all terms but Q; all of them are those in front of it
    low_pass: LowPassTerm | None = None

    @classmethod
    def from_dict(cls, content):
        """Return the processes from their JSON form."""
        read, humps, lines = Coefficient.from_dict, content["gauss_markov"], content["sinusoid"]
        found = [
            SinusoidTerm(read(line["amplitude"]), read(line["frequency"]), line.get("origin"))
            for line in lines
        ]
        processes = tuple(GaussMarkovTerm(read(p["q"]), read(p["tc"])) for p in humps)
        if low_pass := content.get("low_pass"):
            low_pass = LowPassTerm(**low_pass | {"corner": read(low_pass["corner"])})
        terms = (read(content[name]) for name in "QNBKR")
        return cls(*terms, processes, tuple(found), low_pass)

    def allan_variance(self, tau):
        """Return the Allan variance, unit of the axis squared, at `tau` in s (array_like)."""
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
            one_less = -np.expm1(-u)
            bracket = 1 - one_less * (2 + one_less) / (2 * u)
            variance = variance + process.q.square * process.tc.value / u * bracket
        for line in self.sinusoid:
            u = np.pi * line.frequency.value * tau
            variance = variance + line.amplitude.square * (np.sin(u) ** 2 / u) ** 2
        return variance

    def density(self, f, rate):
        r"""Return the one-sided power spectral density of the output sampled at r = `rate`, Hz.

        .. math::
            S(f) = 8 Q^2 r \sin^2(\pi f/r) + 2 N^2 + B^2/(\pi f) + 2 K^2/(2 \pi f)^2
            + 2 q^2/(1/T^2 + (2 \pi f)^2)

        all but the first term times the gain of the low-pass, if there is one.

        Sinusoids have no density: each has the power :math:`\Omega^2/2` at its frequency. The ramp
        is deterministic and adds nothing. Frequencies, Hz, are above 0 and up to half the rate, on
        which only quantisation depends.

        References
        ----------
        IEEE Std 952-1997 (R2008), annex C, which gives the two-sided densities.
        """
        f = np.asarray(f, float)
        omega = 2 * np.pi * f
        density = 2 * self.N.square + self.B.square / (np.pi * f) + 2 * self.K.square / omega**2
        for process in self.gauss_markov:
            density = density + 2 * process.q.square / (process.tc.value**-2 + omega**2)
        if self.low_pass:
            density = density * self.low_pass.gain(f, rate)
        return density + 8 * self.Q.square * rate * np.sin(np.pi * f / rate) ** 2

    def kernel(self, t, span, shared=None):
        r"""Return the covariance of the integral X of the output between all pairs of times.

        Only up to terms that vanish in increments of X. For a lag d the processes give

        - quantisation: :math:`Q^2` at d = 0;
        - white: :math:`-N^2 |d|/2`;
        - flicker: :math:`(B^2/2\pi)\, d^2 \ln(|d|/e^{3/2}\,\mathrm{span})`, that is an output of
          covariance :math:`(B^2/\pi) \ln(\mathrm{span}/|d|)`;
        - Gauss-Markov: :math:`-(q^2 T^3/2)(d/T - 1 + e^{-d/T})`;
        - sinusoid: :math:`\Omega^2 \cos(\omega d)/2\omega^2`;
        - walk from t = 0 on: :math:`K^2 (s^2 t/2 - s^3/6)`, s the earlier time.

        The ramp is deterministic and adds nothing.

        Takes m times, s, from the start of the walk, a length, s, that holds them all and that the
        flicker's level refers to, and `lags` of both, where several axes have them.
        """
        d, d2, logarithm, early2, late = shared or lags(t, span)
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
        """Return the covariance of the mean output over windows of time, shape (n, n), SI.

        The levels of flicker and walk, common to all windows of a power cycle, are the smallest
        natural ones (see `kernel`, walk from the first window on): they are what a fitted bias
        absorbs. Means of different power cycles are independent. Coefficients that are not
        identifiable count as 0; the ramp is no random process and is not part of the covariance.

        Takes start and end of each window, s, (n, 2), in any order; they may touch or overlap; and
        their `edges`, where several axes have them or they lie in several power cycles.
        """
        covariance = np.zeros((len(windows),) * 2)
        for own, times, start, end, common in edges(windows) if shared is None else shared:
            k = self.kernel(times, times[-1], common)
            k = k[end] - k[start]
            k = k[:, end] - k[:, start]
            length = windows[own, 1] - windows[own, 0]
            covariance[np.ix_(own, own)] = (k + k.T) / (2 * length[:, None] * length)
        return covariance

    def wander(self, interval, length):
        """Return the standard deviation of the difference of two means of the output, SI.

        By flicker, walk and Gauss-Markov processes as far as they were seen: what a bias that was
        measured without other noise moves by. Takes the time from the one to the other, and the
        time that each is taken over, s.
        """
        slow = AxisNoise(B=self.B, K=self.K, gauss_markov=self.gauss_markov)
        covariance = slow.mean_covariance(np.add.outer([0.0, interval], [0.0, length]))
        return float(np.sqrt(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1]))


def edges(windows, power_cycle=None):
    """Return what covariances of means over windows share, of one power cycle after the other.

    Which windows lie in it; times at which they start or end, s, from the first on; the places of
    both among the times; and their `lags`. Takes windows, s, (n, 2), and the power cycle that each
    lies in, (n,); one by default.
    """
    if power_cycle is None:
        power_cycle = np.zeros(len(windows), dtype=int)
    shared = []
    for cycle in np.unique(power_cycle):
        own = np.flatnonzero(power_cycle == cycle)
        times = np.unique(windows[own])
        start, end = np.searchsorted(times, windows[own]).T
        times = times - times[0]
        shared.append((own, times, start, end, lags(times, times[-1])))
    return shared


def lags(t, span):
    """Return what the kernels of all axes share at times t: d, d², ln - 3/2, s² and t/2 - s/6."""
    t = np.asarray(t, float)
    d = np.abs(t[:, None] - t)
    early, late = np.minimum(t[:, None], t), np.maximum(t[:, None], t)
    # ln 1 at lag 0, where the factor d^2 removes the term
    logarithm = np.log(np.where(d > 0, d, span) / span) - 1.5
    return d, d**2, logarithm, early**2, late / 2 - early / 6


@dataclass(frozen=True)
class NoiseModel:
    """Noise of the six axes of a device."""

    device: str  # name
    axes: dict[str, AxisNoise]  # one entry for each of ax, ay, az, gx, gy, gz

    def known(self, axis, term):
        """Return size and standard deviation of an axis' flicker, 'B', or walk, 'K', as known.

        Of a term that was not seen the size is zero; it may have one, below its limit with a
        probability of 95 %.
        """
        c = getattr(self.axes[axis], term)
        if c.value is None:
            return 0.0, (c.upper95 or 0.0) / 1.96
        low, high = c.ci95 or (c.value, c.value)
        return c.value, (high - low) / 3.92

    def with_sizes(self, sizes):
        """Return the model with other values of flicker and walk, by axis and term."""
        axes = dict(self.axes)
        for (axis, term), value in sizes.items():
            coefficient = replace(getattr(axes[axis], term), value=value)
            axes[axis] = replace(axes[axis], **{term: coefficient})
        return replace(self, axes=axes)

    def mean_covariance(self, windows, power_cycle=None):
        """Return `AxisNoise.mean_covariance` of all axes, shape (6, n, n).

        In (m/s^2)^2 for ax, ay, az, then (rad/s)^2 for gx, gy, gz; zeros of a model without any
        coefficient. Takes windows, s, (n, 2), and the power cycle that each lies in, (n,); one by
        default. A ValueError if a window does not end after its start.
        """
        windows = np.asarray(windows, float)
        if windows.ndim != 2 or windows.shape[1] != 2 or np.any(windows[:, 1] <= windows[:, 0]):
            raise ValueError("windows: a start and a later end each needed, shape (n, 2)")
        shared = edges(windows, power_cycle)
        covariance = np.empty((len(CHANNELS), len(windows), len(windows)))
        # an axis at a time: a record of days has thousands of windows
        for total, axis in zip(covariance, CHANNELS, strict=True):
            total[:] = self.axes[axis].mean_covariance(windows, shared)
        return covariance

    def to_dict(self):
        """Return the content of noise.json, as far as the model goes."""
        return {
            "format": FORMAT,
            "device": self.device,
            "axes": {name: asdict(self.axes[name]) for name in CHANNELS},
        }

    @classmethod
    def from_dict(cls, content):
        """Return the model from the content of noise.json; what else is in it is not read."""
        axes = {name: AxisNoise.from_dict(content["axes"][name]) for name in CHANNELS}
        return cls(content["device"], axes)

    @classmethod
    def from_json(cls, path):
        """Return the model from noise.json."""
        return cls.from_dict(read_json(path))


def without_weight(covariance):
    """Return which covariances give no weight: zero variance, or lines without noise.

    Lines are as many patterns as there are lines: some sums of the values would have no error.
    Of covariances, shape (k, n, n), returned are those with a value of no variance, and those with
    a sum of none, shape (k,) each.
    """
    sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    silent = ~np.all(sigma > 0, axis=1)
    sigma = np.where(sigma > 0, sigma, 1.0)
    correlation = covariance / (sigma[:, :, None] * sigma[:, None])
    least = np.linalg.eigvalsh(correlation).min(axis=1, initial=1.0)
    return silent, ~silent & (least < _LEAST_EIGENVALUE)
