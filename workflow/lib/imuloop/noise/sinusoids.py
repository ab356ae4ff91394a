"""Sinusoids by least squares in the clean stretches of a signal, with little memory."""

from dataclasses import dataclass

import numpy as np

# parts of a record in which a sinusoid is summed, and samples that are worked on at a time
BINS, CHUNK = 8192, 8192
# the fit of a frequency ends at this share of 1/T
ROUNDS, CLOSE = 8, 1e-3
# a sinusoid is followed through halves of a record of that many periods at least, where they
# explain more, in units of the noise: exp(-GAIN) by chance
PERIODS, GAIN = 12, 12.0


@dataclass(frozen=True)
class FittedSinusoid:
    """Least-squares sinusoid in part of a Signal: samples from `begin`, before `end`.

    Frequency in Hz, cosine and sine in SI; the phase counts from the middle between the part's
    first and last clean sample. `explained` is the sum of squares that it takes, SI^2; standard
    errors are those where the noise is white with variance 1.
    """

    signal: int
    begin: int
    end: int
    frequency: float
    cosine: float
    sine: float
    explained: float
    amplitude_std: float
    frequency_std: float

    def subtract(self, signal):
        """Take the sinusoid out of the values of the signal, in place."""
        part, size = signal.cut(self.begin, self.end), np.array([self.cosine, self.sine])
        values = part.values
        values -= np.concatenate([size @ waves for *_, waves in _chunks(part, self.frequency)])


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
        begin=first,
        end=last + 1,
        frequency=float(frequency + change),
        cosine=cosine,
        sine=sine,
        explained=float(fit @ gram[1:, 0] - gram[0, 1] ** 2 / gram[1, 1]),
        amplitude_std=float(np.sqrt(direction @ covariance @ direction)),
        frequency_std=float(np.sqrt(covariance[3, 3])),
    )


def follow(signal, sinusoid, density):
    """Return one sinusoid per part of a signal where its frequency wanders, else the one given.

    Halved as long as smaller parts explain more than chance; `density` is that of the noise there,
    one-sided, SI^2/Hz.
    """
    begin, end = sinusoid.begin, sinusoid.end
    threshold, halves = GAIN * density * signal.rate, []
    for i, j in ((begin, (begin + end) // 2), ((begin + end) // 2, end)):
        part, span = signal.cut(i, j), (j - i) / signal.rate
        if _periods(sinusoid, signal.rate, span) < PERIODS or sum(part.lengths) * 4 < j - i:
            return [sinusoid]
        # what never changes has no sinusoid
        if not part.is_constant():
            near = strongest_frequency(part, sinusoid.frequency, 2 / span)
            halves.append(fit_sinusoid(part, near, sinusoid.signal))
    gain = sum(half.explained for half in halves) - sinusoid.explained
    if not halves or (
        gain < threshold and not _wanders(signal.cut(begin, end), sinusoid, threshold)
    ):
        return [sinusoid]
    return [each for half in halves for each in follow(signal, half, density)]


def _wanders(signal, sinusoid, threshold):
    """Return whether 4, 8, ... parts, each with a frequency nearby, explain more than one."""
    sums, counts, _ = _baseband(signal, sinusoid.frequency)
    parts, span = 4, (sinusoid.end - sinusoid.begin) / signal.rate
    while _periods(sinusoid, signal.rate, span) / parts >= PERIODS and len(sums) // parts >= 8:
        size = len(sums) // parts
        power = abs(np.fft.fft(sums[: parts * size].reshape(parts, size), 4 * size)) ** 2
        # up to two widths 1/T to either side
        top = np.hstack([power[:, :9], power[:, -8:]]).max(axis=1)
        taken = 2 * top / np.maximum(counts[: parts * size].reshape(parts, size).sum(axis=1), 1)
        # the mirror at -f is left out: an error of 1/(pi PERIODS)
        if taken.sum() > 1.03 * sinusoid.explained + (parts - 1) * threshold:
            return True
        parts *= 2
    return False


def _periods(sinusoid, rate, span):
    """Return the periods in a time of a sinusoid, or of what its sampling folds it to."""
    return min(sinusoid.frequency, rate / 2 - sinusoid.frequency) * span


def strongest_frequency(signal, frequency, reach):
    """Return the frequency of most power within `reach` of one, to 1/(16 span)."""
    sums, _, interval = _baseband(signal, frequency)
    offsets = np.linspace(-reach, reach, 2 * int(np.ceil(8 * reach * len(sums) * interval)) + 1)
    times = np.arange(len(sums)) * interval
    power = [abs(np.exp(-2j * np.pi * offset * times) @ sums) for offset in offsets]
    return frequency + offsets[int(np.argmax(power))]


def _baseband(signal, frequency):
    """Return values times exp(-i w t) summed over short bins, their samples, and the bin in s."""
    first, last = signal.extent
    width = -(-(last - first + 1) // BINS)
    size = -(-(last - first + 1) // width)
    sums, number = np.zeros(size, complex), np.zeros(size)
    for _, x, sample, _, (cosine, sine) in _chunks(signal, frequency):
        bins = (sample - first) // width
        sums += np.bincount(bins, x * cosine, size) - 1j * np.bincount(bins, x * sine, size)
        number += np.bincount(bins, minlength=size)
    return sums, number, width / signal.rate


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
