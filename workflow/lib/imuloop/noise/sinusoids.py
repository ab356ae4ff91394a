"""Sinusoids by least squares in the clean stretches of a signal, with little memory."""

from dataclasses import dataclass, replace

import numpy as np

# samples that are worked on at a time
CHUNK = 8192
# the fit of a frequency ends at this share of 1/T
ROUNDS, CLOSE = 8, 1e-3


@dataclass(frozen=True)
class FittedSinusoid:
    """Least-squares sinusoid in the Signal of a number.

    Frequency in Hz, cosine and sine in SI; the phase counts from the middle between the first and
    the last clean sample. `explained` is the sum of squares that it takes, SI^2; standard
    errors are those where the noise is white with variance 1.
    """

    signal: int
    frequency: float
    cosine: float
    sine: float
    explained: float
    amplitude_std: float
    frequency_std: float

    def subtract(self, signal):
        """Return the Signal without the sinusoid."""
        size = np.array([self.cosine, self.sine])
        parts = [size @ waves for *_, waves in _chunks(signal, self.frequency)]
        return replace(signal, values=signal.values - np.concatenate(parts))


def fit_sinusoid(signal, frequency, number):
    """Return the FittedSinusoid beside levels and a slope, from within 1/(4 span) of `frequency`.

    By Gauss-Newton, in steps of at most as much; Hz. `number` is that of the signal.
    """
    (first, last), step = signal.extent, 1 / (4 * signal.span)
    for _ in range(ROUNDS):
        products = _products(signal, frequency)
        _, cosine, sine = np.linalg.solve(products[1:4, 1:4], products[1:4, 0])
        # derivative by the frequency, t = u span/2: pi span u (sine cos - cosine sin)
        mix = np.eye(5, 6)
        mix[4, 4:] = np.pi * (last - first) / signal.rate * np.array([sine, -cosine])
        gram = mix @ products @ mix.T
        covariance = np.linalg.inv(gram[1:, 1:])
        fit = covariance @ gram[1:, 0]
        frequency += float(np.clip(fit[3], -step, step))
        if abs(fit[3]) < 4 * CLOSE * step:
            break
    _, cosine, sine, _ = fit.tolist()
    direction = np.array([0, cosine, sine, 0]) / np.hypot(cosine, sine)
    return FittedSinusoid(
        signal=number,
        frequency=frequency,
        cosine=cosine,
        sine=sine,
        explained=float(fit @ gram[1:, 0] - gram[0, 1] ** 2 / gram[1, 1]),
        amplitude_std=float(np.sqrt(direction @ covariance @ direction)),
        frequency_std=float(np.sqrt(covariance[3, 3])),
    )


def _products(signal, frequency):
    """Return the products of x, u, cosine, sine, u cosine, u sine without the levels' means."""
    number = np.bincount(signal.level, signal.lengths)
    gram, sums = np.zeros((6, 6)), np.zeros((6, len(number)))
    for level, x, u, waves in _chunks(signal, frequency):
        columns = np.vstack([x, u, waves, u * waves])
        gram += columns @ columns.T
        sums[:, level] += columns.sum(axis=1)
    return gram - (sums / number) @ sums.T


def _chunks(signal, frequency):
    """Yield level, values less its mean, u and (cosine, sine) of a few samples after the others.

    u goes from -1 to 1 over the signal, the phase counts from its middle.
    """
    first, last = signal.extent
    middle, half = (first + last) / 2, (last - first) / 2
    stretches = signal.split(signal.centred(signal.values))
    for start, level, x in zip(signal.starts, signal.level, stretches, strict=True):
        for i in range(0, len(x), CHUNK):
            sample = start + i + np.arange(len(x[i : i + CHUNK])) - middle
            angle = 2 * np.pi * (frequency / signal.rate * sample % 1)
            yield level, x[i : i + CHUNK], sample / half, np.array([np.cos(angle), np.sin(angle)])
