"""Sinusoids by least squares in the clean stretches of a signal, with little memory."""

from dataclasses import dataclass, replace

import numpy as np

# samples of a chunk
CHUNK = 8192
# rounds of a fit, which ends where the frequency changes by less than this share of 1/span
ROUNDS, CLOSE = 8, 1e-3


@dataclass(frozen=True)
class FittedSinusoid:
    """Sinusoid in one Signal by least squares."""

    frequency: float  # Hz
    # amplitudes, SI; the phase is 0 in the middle between the first and the last sample
    cosine: float
    sine: float
    explained: float  # sum of squares that the sinusoid takes, SI^2
    # standard errors of amplitude and frequency in white noise of variance 1 SI^2
    amplitude_std: float
    frequency_std: float

    def subtract(self, signal):
        """Return the Signal without the sinusoid."""
        amplitudes = np.array([self.cosine, self.sine])
        parts = [amplitudes @ waves for *_, waves in _chunks(signal, self.frequency)]
        return replace(signal, values=signal.values - np.concatenate(parts))


def fit_sinusoid(signal, frequency):
    """Return the FittedSinusoid of a Signal, fitted together with levels and a slope.

    By Gauss-Newton from `frequency`, Hz, which is right within 1/(4 span). A step is at most as
    long.
    """
    step = 1 / (4 * signal.span)
    for _ in range(ROUNDS):
        products = _products(signal, frequency)
        _, cosine, sine = np.linalg.solve(products[1:4, 1:4], products[1:4, 0])
        # derivative by the frequency, t = u span/2: pi span u (sine cos - cosine sin)
        mix = np.eye(5, 6)
        mix[4, 4:] = np.pi * (signal.extent - 1) / signal.rate * np.array([sine, -cosine])
        gram = mix @ products @ mix.T
        covariance = np.linalg.inv(gram[1:, 1:])
        fit = covariance @ gram[1:, 0]
        frequency += float(np.clip(fit[3], -step, step))
        if abs(fit[3]) < 4 * CLOSE * step:
            break
    _, cosine, sine, _ = fit.tolist()
    direction = np.array([0, cosine, sine, 0]) / np.hypot(cosine, sine)
    return FittedSinusoid(
        frequency=frequency,
        cosine=cosine,
        sine=sine,
        explained=float(fit @ gram[1:, 0] - gram[0, 1] ** 2 / gram[1, 1]),
        amplitude_std=float(np.sqrt(direction @ covariance @ direction)),
        frequency_std=float(np.sqrt(covariance[3, 3])),
    )


def _products(signal, frequency):
    """Return the products of x, u, cosine, sine, u cosine and u sine, (6, 6).

    The mean of each level is taken out of each before. `_chunks` describes x, u and the waves.
    """
    number = np.bincount(signal.levels, signal.lengths)
    gram, sums = np.zeros((6, 6)), np.zeros((6, len(number)))
    for level, x, u, waves in _chunks(signal, frequency):
        columns = np.vstack([x, u, waves, u * waves])
        gram += columns @ columns.T
        sums[:, level] += columns.sum(axis=1)
    return gram - (sums / number) @ sums.T


def _chunks(signal, frequency):
    """Yield level, x, u and the waves of one chunk of samples after the other.

    x, (k,), are the values without the mean of their level. u, (k,), goes from -1 to 1 over the
    signal. The waves, (2, k), are cosine and sine at `frequency`, Hz, with phase 0 at u = 0.
    """
    half = (signal.extent - 1) / 2
    stretches = signal.split(signal.centred(signal.values))
    for start, level, x in zip(signal.starts, signal.levels, stretches, strict=True):
        for i in range(0, len(x), CHUNK):
            sample = start + i + np.arange(len(x[i : i + CHUNK])) - half
            angle = 2 * np.pi * (frequency / signal.rate * sample % 1)
            yield level, x[i : i + CHUNK], sample / half, np.array([np.cos(angle), np.sin(angle)])
