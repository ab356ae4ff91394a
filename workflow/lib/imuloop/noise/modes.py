"""The modes of a record: amplitudes of its noise in a basis where they hardly correlate."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.fft import dct, next_fast_len, rfft
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag

from imuloop.noise.processes import NAMES, covariances

# about the number of blocks of a record, and one more than the largest number in a piece. The time
# grows with the cube of the number of blocks; fewer blocks would mix slow and fast noise
BLOCKS, LARGEST = 512, 577
# number of samples of a block above which it is rounded up to one that is fast to transform
LONG = 4096
# least share of the samples that lie in whole blocks
HELD = 0.9
# bins of the fast modes per decade, and correlation times per decade between which expected squares
# are interpolated
BINS, TIMES = 24, 8


def expected_squares(covariance):
    r"""Return the expected squares of the cosine coefficients 1 … n - 1 of noise, (..., n - 1).

    .. math:: E c_k^2 = \frac{1}{n} \left[ \sum_{|d|<n} \gamma_d (n - |d|) \cos \omega d
        - \frac{2}{\sin \omega} \sum_{d \ge 0} \gamma_d \sin \omega d \right],
        \quad \omega = \pi k/n, \quad k = 1 \dots n - 1

    :math:`c_k` are the coefficients of the orthonormal DCT-II of n values. :math:`\gamma_d` is the
    covariance of two values that lie d samples apart. `covariance`, (..., n), has it along the last
    axis, for all d from 0 to n - 1. Other axes, such as one of several noise processes, stay in the
    result. The covariance may be a generalised one, which holds only for weighted sums whose
    weights add up to zero: all coefficients with k > 0 are such sums.
    """
    covariance = np.asarray(covariance, float)
    n = covariance.shape[-1]
    omega = np.pi * np.arange(1, n) / n
    even = 2 * rfft(covariance * (n - np.arange(n)), 2 * n)[..., 1:n].real - n * covariance[..., :1]
    odd = -rfft(covariance, 2 * n)[..., 1:n].imag
    return (even - 2 * odd / np.sin(omega)) / n


def _contrasts(start, m):
    """Return the distances of k blocks of samples, and contrasts of their means, (k, k - 1).

    A contrast is a weighted sum whose weights add up to zero. Here the columns of weights are
    orthonormal, and a random walk has no correlation between the contrasts. `start`, (k,), is the
    number of the first sample of each block, and `m` the number of samples of a block. No
    disturbance lies between the blocks.

    The first result has the distances, in samples: those from the first block, (k,), if no gap lies
    between the blocks, else those between all pairs of blocks, (k, k). The second result has the
    weights, a column for each contrast. Without a gap the contrasts are those of the cosine
    transform.
    """
    n = len(start)
    if (np.diff(start) == m).all():
        phase = np.pi / n * np.outer(np.arange(n) + 0.5, np.arange(1, n))
        return start - start[0], np.sqrt(2 / n) * np.cos(phase)
    distance = np.abs(np.subtract.outer(start, start))
    walk = -distance / 2.0
    walk -= walk.mean(axis=0)
    walk -= walk.mean(axis=1, keepdims=True)
    # the mean of all blocks has no part in a walk without its mean: a large eigenvalue sorts it
    # last, where it is left out
    top = 2 * np.trace(walk) + 1
    return distance, np.linalg.eigh(walk + top / n)[1][:, -2::-1]


def _squares(distance, contrasts, processes):
    """Return the expected squares of k - 1 contrasts for each of c noise processes, (c, k - 1).

    A contrast is a weighted sum of the means of k blocks of samples, whose weights add up to zero.
    `distance` has the distances of the blocks, and `contrasts` the weights, (k, k - 1), both from
    `_contrasts`. `processes` has an array in the shape of `distance` for each process: the
    covariance of the means of two blocks.
    """
    if distance.ndim == 1:
        return expected_squares([*processes])
    return np.array([np.einsum("ik,ik->k", contrasts, c @ contrasts) for c in processes])


@dataclass(frozen=True)
class _Piece:
    """A piece of one power cycle: fewer than `LARGEST` blocks of consecutive samples.

    The slope of one straight line is subtracted from the fast modes of all blocks of a piece. A
    level is a stretch between two disturbances; it has its own mean. `cycle` is the index of the
    power cycle.
    """

    cycle: int
    place: np.ndarray  # (k,): index of the first value of each block in its Signal
    start: np.ndarray  # (k,): position of the first sample of each block on the grid
    levels: list  # for each level the distances of the blocks, and the contrasts of their means

    @cached_property
    def basis(self):
        """Weights of the contrasts of the means of k blocks, (k, s): a column for each slow mode.

        A contrast is a weighted sum of the means whose weights add up to zero. The weights of a
        column are zero outside one level.
        """
        return block_diag(*(contrasts for _, contrasts in self.levels))


@dataclass(frozen=True)
class Modes:
    """Modes: the basis in which the noise of one or more power cycles is described.

    A power cycle is cut into blocks of m samples. The fast modes are the orthonormal cosine
    coefficients 1 … m - 1 of each block. The slow modes are contrasts of the means of the blocks:
    weighted sums whose weights add up to zero. So no mode depends on the mean of a power cycle, or
    on the mean of a stretch between two disturbances, here called a level. In this basis white
    noise and random walk are uncorrelated, and other processes nearly so. The expected square of
    each mode is exact for every process. In an unbroken record the slow modes are a cosine
    transform.

    A long gap keeps its length in time. A gap of a few samples is closed up: the samples before and
    after it are taken as neighbours.

    Attributes
    ----------
    dt : float
        Interval of the samples, s.
    m : int
        Number of samples of a block.
    span : float
        Length of the longest power cycle, s.
    longest_level, usual_level : float
        Length of the longest level, s, and of the usual one, s: half of the samples lie in levels
        that are longer than the usual one.
    frequency, count : ndarray, shape (r,)
        Frequency of each row, Hz, and the number of its values. The first s rows are the slow
        modes, one by one. The other rows are bins of neighbouring fast modes.
    units : ndarray, shape (r, 4)
        Expected mean square of each row for quantisation, white noise, flicker and random walk,
        each with the coefficient Q, N, B or K = 1, SI.
    correlation_times : ndarray, shape (c,)
        Correlation times, s, for which `processes` was computed, from the interval of the samples
        to the length of the longest power cycle.
    processes : CubicSpline
        Logarithm of the expected mean square of each row, (r,), for a Gauss-Markov process of
        variance 1, as a function of the logarithm of its correlation time in s.
    ramp : ndarray, shape (s,)
        Amplitudes of the slow modes for a ramp of 1 SI/s.
    """

    dt: float
    m: int
    span: float
    longest_level: float
    usual_level: float
    frequency: np.ndarray
    count: np.ndarray
    units: np.ndarray
    correlation_times: np.ndarray
    processes: CubicSpline
    ramp: np.ndarray
    _pieces: list
    # index of the first fast mode of each bin
    _bins: np.ndarray
    _gains: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    def amplitudes(self, signals):
        """Return the amplitudes of the s slow modes, (s,), and mean squares of the fast modes.

        The first result has the amplitudes, SI. The second has a mean square for each of the r - s
        bins of fast modes, (r - s,), SI^2, taken over the modes of the bin and over all blocks.
        `signals` are the Signals of one axis, in the order of the power cycles. A straight line is
        fitted to the slow modes of each piece, some 500 blocks, and is subtracted from the fast
        modes of these blocks, so that they do not show a drift.
        """
        slow, squares, number = [], np.zeros(self.m - 1), 0
        line = dct(np.arange(self.m) * self.dt, norm="ortho")[1:]
        for piece in self._pieces:
            x = signals[piece.cycle].values
            blocks = [x[i : i + self.m] for i in piece.place]
            means, number = np.array([block.mean() for block in blocks]), number + len(blocks)
            amplitudes, ramp = piece.basis.T @ means, piece.basis.T @ (piece.start * self.dt)
            slow.append(amplitudes)
            slope = ramp @ amplitudes / (ramp @ ramp) if len(ramp) > 1 else 0.0
            for block, mean in zip(blocks, means, strict=True):
                squares += (dct(block - mean, norm="ortho")[1:] - slope * line) ** 2
        return np.concatenate(slow), _bin_means(squares / number, self._bins)

    def unit(self, term):
        """Return the expected mean square of each row for a noise term of size 1, (r,), SI.

        A row is a slow mode or a bin of fast modes. `term` is ``Q``, ``N``, ``B`` or ``K``, whose
        coefficient is then 1; or the correlation time, s, of a Gauss-Markov process of variance 1.
        """
        if isinstance(term, str):
            return self.units[:, NAMES.index(term)]
        return np.exp(self.processes(np.log(term)))

    def gain(self, low_pass):
        """Return the factor by which a filter changes the power of white noise in each row, (r,).

        `low_pass` is the filter, a LowPass. A row is a slow mode or a bin of fast modes.
        """
        if low_pass not in self._gains:
            slow = low_pass.gain(self.frequency[: len(self.ramp)] * self.dt)
            fast = _bin_means(expected_squares(low_pass.autocovariance(self.m)), self._bins)
            self._gains[low_pass] = np.append(slow, fast)
        return self._gains[low_pass]


def modes(signals):
    """Return the Modes, the basis that describes the noise of one axis in all its power cycles.

    `signals` is a list with the Signal of each power cycle. They have one sampling rate, and at
    least one of them has two samples or more. Only the times of the samples are used, not their
    values.
    """
    closed = [signal.closed_up() for signal in signals]
    dt = 1 / np.average([s.rate for s in closed], weights=[s.lengths.sum() for s in closed])
    m = _block_length(np.concatenate([signal.lengths for signal in closed]))
    # if no level has two blocks, as in bursts of two samples, a block is one sample
    m, pieces = next((k, p) for k in (m, 1) if (p := _pieces(closed, k)))
    span = max(s.span for s in closed)
    low, high = np.log10([dt, max(span, 8 * dt)])
    correlation_times = 10 ** np.linspace(low, high, int(np.ceil(TIMES * (high - low))) + 1)

    slow = [
        _squares(distance, contrasts, covariances(distance, m, dt, correlation_times))
        for piece in pieces
        for distance, contrasts in piece.levels
    ]
    k = np.arange(1, m)
    bins = np.flatnonzero(np.diff(np.floor(BINS * np.log10(k)), prepend=-1))
    samples = [*covariances(np.arange(m), 1, dt, correlation_times)]
    squares = np.concatenate([*slow, _bin_means(expected_squares(samples), bins)], axis=1)
    ramp = np.concatenate([piece.basis.T @ (piece.start * dt) for piece in pieces])
    # frequency at which the expected square of a walk is as large: exact for an unbroken record
    frequency = 1 / (2 * np.pi * np.sqrt(squares[3, : len(ramp)] * m * dt))
    count = sum(len(p.place) for p in pieces) * np.diff(np.append(bins, m - 1))
    times = np.sort(np.concatenate([_level_times(s) for s in closed]))
    return Modes(
        dt=dt,
        m=m,
        span=span,
        longest_level=times.max(),
        usual_level=float(times[np.searchsorted(np.cumsum(times), times.sum() / 2)]),
        frequency=np.concatenate([frequency, _bin_means(k / (2 * m * dt), bins)]),
        count=np.concatenate([np.ones(len(ramp)), count]),
        units=squares[:4].T,
        correlation_times=correlation_times,
        processes=CubicSpline(np.log(correlation_times), np.log(squares[4:])),
        ramp=ramp,
        _pieces=pieces,
        _bins=bins,
    )


def _bin_means(values, first):
    """Return the means of values over bins of the last axis, (..., bins).

    `values`, (..., n), has n values in order, of which each bin takes consecutive ones. `first`,
    (bins,), has the index of the first value of each bin.
    """
    return np.add.reduceat(values, first, axis=-1) / np.diff(np.append(first, values.shape[-1]))


def _level_times(signal):
    """Return the duration of each level of a Signal, s, (levels,).

    A level is a stretch between two disturbances; gaps within it count. `signal` is the Signal.
    """
    first = np.flatnonzero(np.diff(signal.levels, prepend=-1))
    last = np.append(first[1:], len(signal.levels)) - 1
    samples = signal.starts[last] + signal.lengths[last] - signal.starts[first]
    return samples / signal.rate


def _block_length(lengths):
    """Return the number of samples of the blocks into which a record is cut, an int.

    `lengths`, (s,), are the numbers of samples of the s stretches of the record, each without a
    gap. The number of blocks is about `BLOCKS`, or more if the stretches are short, so that whole
    blocks within the stretches have at least the share `HELD` of all samples. The number of samples
    of long blocks has no large prime factors, which makes the transform up to four times faster.
    """
    m = int(-(-lengths.sum() // BLOCKS))
    if m > LONG:
        m = next_fast_len(m, real=True)
    while m > 1 and (lengths // m * m).sum() < HELD * lengths.sum():
        m //= 2
    return m


def _pieces(signals, m):
    """Return the pieces of all power cycles, a list of _Piece.

    A piece has some of the blocks of one power cycle, fewer than `LARGEST`. `signals` has the
    Signal of each power cycle, and `m` is the number of samples of a block. A level is a stretch
    between two disturbances. If no level of a piece has two blocks, the piece has no contrast of
    block means and is left out.
    """
    pieces = []
    for cycle, signal in enumerate(signals):
        ends = np.cumsum(signal.lengths)
        stretches = zip(ends - signal.lengths, ends - m + 1, strict=True)
        place = np.concatenate([np.arange(first, last, m) for first, last in stretches])
        start = signal.samples[place]
        level = np.repeat(signal.levels, signal.lengths)[place]
        for part in np.array_split(np.arange(len(start)), len(start) // LARGEST + 1):
            # each level has its own contrasts, which do not depend on a walk in other levels
            ends = np.flatnonzero(np.diff(level[part])) + 1
            if len(part) > len(ends) + 1:
                levels = [_contrasts(starts, m) for starts in np.split(start[part], ends)]
                pieces.append(_Piece(cycle, place[part], start[part], levels))
    return pieces
