"""Sinusoids that are fitted to a signal by least squares, in chunks, to save memory."""

from dataclasses import dataclass, replace

import numpy as np

# samples of a chunk
CHUNK = 8192
# rounds of a fit, and the change of the frequency, a share of 1/span, at which it ends
ROUNDS, CLOSE = 8, 1e-3


@dataclass(frozen=True)
class FittedSinusoid:
    """A sinusoid that was fitted to one Signal, the values of a power cycle, by least squares."""

    frequency: float  # Hz
    # (2,): amplitudes of cosine and sine, SI; the phase is 0 midway between the first and the last
    # sample
    amplitudes: np.ndarray
    explained: float  # by how much the sinusoid lowers the sum of squares, SI^2
    # standard errors of amplitude and frequency in white noise of variance 1 SI^2
    amplitude_std: float
    frequency_std: float

    def subtract(self, signal):
        """Return a Signal without the sinusoid; `signal` is the one to which it was fitted."""
        parts = [self.amplitudes @ columns[2:4] for _, columns in _chunks(signal, self.frequency)]
        return replace(signal, values=signal.values - np.concatenate(parts))


def fit_sinusoid(signal, frequency):
    """Return the FittedSinusoid: the sinusoid near a frequency that fits a signal best.

    `signal` is a Signal. The mean of each level, the samples between two disturbances, and one
    slope are fitted together with the sinusoid, by least squares. The method is Gauss-Newton. It
    starts from `frequency`, Hz, which has to be right within 1/(4 span), where span is the duration
    of the Signal, s. No step of the frequency is longer than 1/(4 span).
    """
    step = 1 / (4 * signal.span)
    for _ in range(ROUNDS):
        products = _products(signal, frequency)
        cosine, sine = np.linalg.solve(products[1:4, 1:4], products[1:4, 0])[1:]
        # derivative of the sinusoid with respect to the frequency at the time u span/2, with the
        # amplitudes `sine` and `cosine`: pi span u (sine cos - cosine sin)
        mix = np.eye(5, 6)
        mix[4, 4:] = np.pi * (signal.extent - 1) / signal.rate * np.array([sine, -cosine])
        gram = mix @ products @ mix.T
        covariance = np.linalg.inv(gram[1:, 1:])
        fit = covariance @ gram[1:, 0]
        frequency += float(np.clip(fit[3], -step, step))
        if abs(fit[3]) < 4 * CLOSE * step:
            break
    amplitudes = fit[1:3]
    direction = amplitudes / np.hypot(*amplitudes)
    return FittedSinusoid(
        frequency=frequency,
        amplitudes=amplitudes,
        # the second term is the part that the slope explains without the sinusoid
        explained=float(fit @ gram[1:, 0] - gram[0, 1] ** 2 / gram[1, 1]),
        amplitude_std=float(np.sqrt(direction @ covariance[1:3, 1:3] @ direction)),
        frequency_std=float(np.sqrt(covariance[3, 3])),
    )


def _products(signal, frequency):
    """Return the products of each two of six functions, summed over all samples, (6, 6).

    The functions are the rows x, u, cosine, sine, u cosine and u sine of `_chunks`. The
    least-squares fit of a sinusoid is solved from these sums. The mean of each function over each
    level, the samples between two disturbances, is subtracted first. `signal` is the Signal, and
    `frequency` the one of cosine and sine, Hz.
    """
    number = np.bincount(signal.levels, signal.lengths)
    gram, sums = np.zeros((6, 6)), np.zeros((6, len(number)))
    for level, rows in _chunks(signal, frequency):
        gram += rows @ rows.T
        sums[:, level] += rows.sum(axis=1)
    return gram - (sums / number) @ sums.T


def _chunks(signal, frequency):
    """Yield the number of the level and six rows of numbers, (6, k), of each chunk of k samples.

    A chunk is a part of a stretch of `signal`, a Signal. A level has the samples between two
    disturbances; its number is yielded because each level has its own mean. The rows are x, u,
    cosine, sine, u cosine and u sine. x are the values of the signal minus the mean of their level.
    u is the time, which goes from -1 to 1 over the signal. Cosine and sine have the `frequency`,
    Hz, and phase 0 at u = 0.
    """
    half = (signal.extent - 1) / 2
    stretches = signal.split(signal.centred(signal.values))
    for start, level, x in zip(signal.starts, signal.levels, stretches, strict=True):
        for i in range(0, len(x), CHUNK):
            part = x[i : i + CHUNK]
            sample = start + i + np.arange(len(part)) - half
            angle = 2 * np.pi * (frequency / signal.rate * sample % 1)
            u, waves = sample / half, np.array([np.cos(angle), np.sin(angle)])
            yield level, np.vstack([part, u, waves, u * waves])
