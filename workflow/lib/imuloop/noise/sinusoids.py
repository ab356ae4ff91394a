"""Sinusoids by least squares in the clean stretches of a signal, with little memory."""

from dataclasses import dataclass

import numpy as np

# parts of a record in which a sinusoid is summed, and samples that are worked on at a time
BINS, CHUNK = 8192, 8192
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
        """Take the sinusoid out of the values of the signal, in place."""
        size, values = np.array([self.cosine, self.sine]), signal.values
        values -= np.concatenate([size @ waves for *_, waves in _chunks(signal, self.frequency)])


def fit_sinusoid(signal, start, number):
    """Return the FittedSinusoid beside levels and a slope, from within 1/(4 span) of `start`, Hz.

    Gauss-Newton; a step is halved until the sinusoid explains more. `number` is that of the signal.
    """
    (first, last), span = signal.extent, signal.span
    frequency, step, most = start, 0.0, -np.inf
    for _ in range(ROUNDS):
        products = _products(signal, frequency + step)
        amplitudes = np.linalg.solve(products[1:4, 1:4], products[1:4, 0])
        explained = amplitudes @ products[1:4, 0]
        if explained < most:
            step /= 2
            continue
        frequency, most, (_, cosine, sine) = frequency + step, explained, amplitudes
        # derivative by the frequency, t = u span/2: pi span u (sine cos - cosine sin)
        mix = np.eye(5, 6)
        mix[4, 4:] = np.pi * (last - first) / signal.rate * np.array([sine, -cosine])
        gram = mix @ products @ mix.T
        covariance = np.linalg.inv(gram[1:, 1:])
        fit = covariance @ gram[1:, 0]
        if abs(fit[3]) * span < CLOSE:
            break
        limits = max(start - 1 / span, 1 / span), start + 1 / span
        step = np.clip(frequency + fit[3], *limits) - frequency
    else:
        # the sinusoid of the last frequency
        fit = np.append(gram[1:4, 0] @ np.linalg.inv(gram[1:4, 1:4]), 0.0)
    _, cosine, sine, change = fit.tolist()
    direction = np.array([0, cosine, sine, 0]) / np.hypot(cosine, sine)
    return FittedSinusoid(
        signal=number,
        frequency=float(frequency + change),
        cosine=cosine,
        sine=sine,
        explained=float(fit @ gram[1:, 0] - gram[0, 1] ** 2 / gram[1, 1]),
        amplitude_std=float(np.sqrt(direction @ covariance @ direction)),
        frequency_std=float(np.sqrt(covariance[3, 3])),
    )


def strongest_frequency(signal, frequency, reach):
    """Return the frequency of most power within `reach` of one, to 1/(16 span)."""
    sums, interval = _baseband(signal, frequency)
    offsets = np.linspace(-reach, reach, 2 * int(np.ceil(8 * reach * len(sums) * interval)) + 1)
    times = np.arange(len(sums)) * interval
    power = [abs(np.exp(-2j * np.pi * offset * times) @ sums) for offset in offsets]
    return frequency + offsets[int(np.argmax(power))]


def _baseband(signal, frequency):
    """Return values times exp(-i w t) summed over short bins, and the length of a bin, s."""
    first, last = signal.extent
    width = -(-(last - first + 1) // BINS)
    size = -(-(last - first + 1) // width)
    sums = np.zeros(size, complex)
    for _, x, sample, _, (cosine, sine) in _chunks(signal, frequency):
        bins = (sample - first) // width
        sums += np.bincount(bins, x * cosine, size) - 1j * np.bincount(bins, x * sine, size)
    return sums, width / signal.rate


def _products(signal, frequency):
    """Return the products of x, u, cosine, sine, u cosine, u sine without the levels' means."""
    number = np.bincount(signal.level, signal.lengths)
    gram, sums = np.zeros((6, 6)), np.zeros((6, len(number)))
    for level, x, _, u, waves in _chunks(signal, frequency):
        columns = np.vstack([x, u, waves, u * waves])
        gram += columns @ columns.T
        sums[:, level] += columns.sum(axis=1)
    return gram - (sums / number) @ sums.T


def _chunks(signal, frequency):
    """Yield level, values less its mean, numbers of the samples, u and (cosine, sine) of each.

    u goes from -1 to 1 over the signal, the phase counts from its middle.
    """
    first, last = signal.extent
    middle, half = (first + last) / 2, (last - first) / 2
    stretches = signal.split(signal.centred(signal.values))
    for start, level, x in zip(signal.starts, signal.level, stretches, strict=True):
        for i in range(0, len(x), CHUNK):
            part = x[i : i + CHUNK]
            sample = start + i + np.arange(len(part))
            angle = 2 * np.pi * (frequency / signal.rate * (sample - middle) % 1)
            waves = np.array([np.cos(angle), np.sin(angle)])
            yield level, part, sample, (sample - middle) / half, waves
