"""The modes of a record: amplitudes in which its noise is uncorrelated, and what they expect."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import dct
from scipy.interpolate import CubicSpline

from imuloop.noise.processes import (
    gauss_markov_means,
    gauss_markov_samples,
    mean_covariances,
    sample_covariances,
)

# blocks of a record; more would cost the cube, fewer would mix slow and fast noise
BLOCKS = 512
# share of the samples that whole blocks have to hold
HELD = 0.9
# bins of the fast modes a decade, and correlation times between which spectra are interpolated
BINS, TIMES = 24, 8


def expected_squares(covariance):
    r"""Return the expected squares of a cosine transform, for any covariance.

    .. math:: E c_k^2 = \frac{1}{n} \left[ \sum_{|d|<n} \gamma_d (n - |d|) \cos \omega d
        - \frac{2}{\sin \omega} \sum_{d \ge 0} \gamma_d \sin \omega d \right],
        \quad \omega = \pi k/n

    for the orthonormal DCT-II of n values whose covariance is Toeplitz; by one Fourier transform.

    Parameters
    ----------
    covariance : array_like, shape (..., n)
        At lags 0 ... n-1; it may be a generalised one, since the modes k > 0 are contrasts.

    Returns
    -------
    ndarray, shape (..., n - 1)
        For k = 1 ... n-1.
    """
    covariance = np.asarray(covariance, float)
    n = covariance.shape[-1]
    omega = np.pi * np.arange(1, n) / n
    even = 2 * np.fft.rfft(covariance * (n - np.arange(n)), 2 * n)[..., 1:n].real
    even -= n * covariance[..., :1]
    odd = -np.fft.rfft(covariance, 2 * n)[..., 1:n].imag
    return (even - 2 * odd / np.sin(omega)) / n


@dataclass(frozen=True)
class _Piece:
    """Blocks whose means are transformed together, at most `BLOCKS` of one session."""

    session: int
    stretch: np.ndarray
    offset: np.ndarray
    start: np.ndarray
    basis: np.ndarray


@dataclass(frozen=True)
class Modes:
    r"""Basis of one or more sessions, each cut into blocks of m samples.

    Fast modes: orthonormal cosine coefficients 1 ... m-1 of each block. Slow modes: the means of
    the blocks, an exact decimation, in the basis of their contrasts that diagonalises the walk;
    white noise is diagonal in any orthonormal basis. For an unbroken session that is again the
    cosine transform. Contrasts are free of the level of each session and of each stretch between
    two disturbances, while gaps keep their place in time.

    In this basis white noise and walk are uncorrelated, others nearly so, and the expected square
    of each mode is exact for every process.

    Attributes
    ----------
    dt : float
        Interval of the samples, s.
    m : int
        Samples of a block.
    span : float
        Longest session, s.
    level : float
        Longest time without a new level, s.
    number : int
        Samples that the blocks hold.
    frequency : ndarray, shape (r,)
        Of each row, Hz: slow modes one by one, then the bins of the fast ones.
    count : ndarray, shape (r,)
        Values behind each row.
    units : ndarray, shape (r, 4)
        Expected mean squares for unit Q, N, B, K, SI.
    ramp : ndarray, shape (s,)
        Amplitudes of the slow modes for a ramp of 1 SI/s.
    """

    dt: float
    m: int
    span: float
    level: float
    number: int
    frequency: np.ndarray
    count: np.ndarray
    units: np.ndarray
    ramp: np.ndarray
    _pieces: tuple
    _bins: np.ndarray

    def amplitudes(self, values):
        """Return the slow modes' amplitudes and the fast ones' mean squares.

        Parameters
        ----------
        values : list of list of ndarray
            Samples of each stretch of each session.

        Returns
        -------
        slow : ndarray, shape (s,)
            SI, with sign.
        fast : ndarray, shape (r - s,)
            SI squared; the straight line of each piece is taken out before.
        """
        slow, squares = [], np.zeros(self.m - 1)
        line = dct(np.arange(self.m) * self.dt, norm="ortho")[1:]
        for piece in self._pieces:
            blocks = [
                values[piece.session][i][j : j + self.m]
                for i, j in zip(piece.stretch, piece.offset, strict=True)
            ]
            means = np.array([block.mean() for block in blocks])
            own = piece.basis.T @ means
            slow.append(own)
            if self.m == 1:
                continue
            ramp = piece.basis.T @ (piece.start * self.dt)
            slope = ramp @ own / (ramp @ ramp) if len(own) > 1 else 0.0
            # some at a time: a record of days need not be there twice
            some = max(1, 2**20 // self.m)
            for first in range(0, len(blocks), some):
                part = np.array(blocks[first : first + some])
                part -= means[first : first + some, None]
                squares += ((dct(part, norm="ortho", axis=1)[:, 1:] - slope * line) ** 2).sum(0)
        number = sum(len(piece.start) for piece in self._pieces)
        return np.concatenate(slow), _binned(squares / number, self._bins)

    def gauss_markov(self, tc):
        """Return the expected mean squares for a Gauss-Markov process of variance 1, shape (r,).

        Interpolated between correlation times of which there are `TIMES` a decade.
        """
        return np.exp(self._gauss_markov(np.log(tc)))

    @cached_property
    def correlation_times(self):
        """Correlation times between two samples and the longest session, s."""
        low, high = np.log10([self.dt, max(self.span, 8 * self.dt)])
        return 10 ** np.linspace(low, high, int(np.ceil(TIMES * (high - low))) + 1)

    @cached_property
    def _gauss_markov(self):
        rows = [self._gauss_markov_at(tc) for tc in self.correlation_times]
        return CubicSpline(np.log(self.correlation_times), np.log(rows))

    def _gauss_markov_at(self, tc):
        slow = [
            _diagonal(p.basis, gauss_markov_means(p.start, self.m, self.dt, tc))
            for p in self._pieces
        ]
        fast = expected_squares(gauss_markov_samples(self.m, self.dt, tc))
        return np.concatenate([*slow, _binned(fast, self._bins)])


def modes(layouts):
    """Return the modes of sessions of one rate.

    Parameters
    ----------
    layouts : sequence of Layout
        At least one, with at least one stretch of two samples.

    Returns
    -------
    Modes
    """
    dt = 1 / np.average([x.rate for x in layouts], weights=[sum(x.lengths) for x in layouts])
    m = _block_length([n for layout in layouts for n in layout.lengths])
    pieces = [p for number, layout in enumerate(layouts) for p in _pieces(number, layout, m)]
    pieces = [p for p in pieces if p.basis.shape[1]]
    units, frequency, ramp = [], [], []
    for piece in pieces:
        covariances = mean_covariances(piece.start, m, dt)
        units.append(np.column_stack([_diagonal(piece.basis, c) for c in covariances]))
        # that at which a walk has so much power: exact for an unbroken record
        frequency.append(1 / (2 * np.pi * np.sqrt(units[-1][:, 3] * m * dt)))
        ramp.append(piece.basis.T @ (piece.start * dt))
    k = np.arange(1, m)
    bins = np.unique(np.floor(BINS * np.log10(np.maximum(k, 1))), return_inverse=True)[1]
    blocks = sum(len(p.start) for p in pieces)
    if m > 1:
        squares = expected_squares(sample_covariances(m, dt))
        units.append(np.column_stack([_binned(s, bins) for s in squares]))
        frequency.append(_binned(k / (2 * m * dt), bins))
    slow = sum(len(r) for r in ramp)
    count = np.concatenate([np.ones(slow), blocks * np.bincount(bins, minlength=0)])
    return Modes(
        dt=dt,
        m=m,
        span=max((x.starts[-1] + x.lengths[-1] - x.starts[0]) / x.rate for x in layouts),
        level=max(_longest_level(x) for x in layouts),
        number=blocks * m,
        frequency=np.concatenate(frequency),
        count=count,
        units=np.concatenate(units),
        ramp=np.concatenate(ramp),
        _pieces=tuple(pieces),
        _bins=bins,
    )


def _longest_level(layout):
    """Return the longest time from start to end of stretches of one level, s."""
    level, start = np.asarray(layout.levels), np.asarray(layout.starts)
    end = start + np.asarray(layout.lengths)
    spans = [end[level == i].max() - start[level == i].min() for i in np.unique(level)]
    return max(spans) / layout.rate


def _block_length(lengths):
    """Return the samples of a block: about `BLOCKS` of them, that hold nearly all samples."""
    lengths = np.asarray(lengths)
    m = -(-lengths.sum() // BLOCKS)
    while m > 1 and (lengths // m * m).sum() < HELD * lengths.sum():
        m //= 2
    return int(m)


def _pieces(session, layout, m):
    """Return the pieces of a session, none of more than `BLOCKS` blocks."""
    number = np.array([n // m for n in layout.lengths])
    stretch = np.repeat(np.arange(len(number)), number)
    offset = np.concatenate([m * np.arange(n) for n in number])
    start = np.asarray(layout.starts)[stretch] + offset
    level = np.asarray(layout.levels)[stretch]
    for part in np.array_split(np.arange(len(start)), -(-len(start) // (BLOCKS + BLOCKS // 8))):
        yield _Piece(
            session, stretch[part], offset[part], start[part], _contrasts(start[part], level[part])
        )


def _contrasts(start, level):
    """Return the orthonormal contrasts of block means in which a walk is diagonal, (k, k - l)."""
    indicator = (level[:, None] == np.unique(level)).astype(float)
    q = indicator / np.linalg.norm(indicator, axis=0)
    walk = -np.abs(np.subtract.outer(start, start)) / 2.0
    walk -= q @ (q.T @ walk)
    walk -= (walk @ q) @ q.T
    # the levels, null directions of the walk, go far above all others
    top = 2 * np.trace(walk) + 1
    values, vectors = np.linalg.eigh(walk + top * q @ q.T)
    return vectors[:, : len(values) - q.shape[1]][:, ::-1]


def _diagonal(basis, covariance):
    """Return the diagonal of V^T C V."""
    return np.einsum("ik,ik->k", basis, covariance @ basis)


def _binned(values, bins):
    """Return the mean over each bin."""
    return np.bincount(bins, values) / np.bincount(bins) if len(bins) else np.empty(0)
