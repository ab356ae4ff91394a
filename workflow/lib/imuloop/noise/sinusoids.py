"""Sinusoids by least squares in the clean stretches of a run, with little memory."""

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
    """Least-squares sinusoid in part of a run: samples from `begin`, before `end`.

    Frequency in Hz, cosine and sine in SI; the phase counts from the middle between the part's
    first and last clean sample. `explained` is the sum of squares that it takes, SI^2; standard
    errors are those where the noise is white with variance 1.
    """

    run: int
    begin: int
    end: int
    frequency: float
    cosine: float
    sine: float
    explained: float
    amplitude_std: float
    frequency_std: float

    def subtract(self, run):
        """Take the sinusoid out of the values of the run, in place."""
        part, size = run.cut(self.begin, self.end), np.array([self.cosine, self.sine])
        values = part.values
        values -= np.concatenate([size @ waves for *_, waves in _chunks(part, self.frequency)])


def fit_sinusoid(run, start, number):
    """Return the FittedSinusoid beside levels and a slope, from within 1/(4 span) of `start`, Hz.

    Gauss-Newton; a step is halved until the sinusoid explains more. `number` is that of the run.
    """
    (first, last), span = run.extent, run.span
    frequency, step, most = start, 0.0, -np.inf
    for _ in range(ROUNDS):
        products = _products(run, frequency + step)
        amplitudes = np.linalg.solve(products[1:4, 1:4], products[1:4, 0])
        explained = amplitudes @ products[1:4, 0]
        if explained < most:
            step /= 2
            continue
        frequency, most, (_, cosine, sine) = frequency + step, explained, amplitudes
        # derivative by the frequency, t = u span/2: pi span u (sine cos - cosine sin)
        mix = np.eye(5, 6)
        mix[4, 4:] = np.pi * (last - first) / run.rate * np.array([sine, -cosine])
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
        run=number,
        begin=first,
        end=last + 1,
        frequency=float(frequency + change),
        cosine=cosine,
        sine=sine,
        explained=float(fit @ gram[1:, 0] - gram[0, 1] ** 2 / gram[1, 1]),
        amplitude_std=float(np.sqrt(direction @ covariance @ direction)),
        frequency_std=float(np.sqrt(covariance[3, 3])),
    )


def follow(run, sinusoid, density):
    """Return one sinusoid per part of a run where its frequency wanders, else the one given.

    Halved as long as smaller parts explain more than chance; `density` is that of the noise there,
    one-sided, SI^2/Hz.
    """
    begin, end = sinusoid.begin, sinusoid.end
    threshold, halves = GAIN * density * run.rate, []
    for i, j in ((begin, (begin + end) // 2), ((begin + end) // 2, end)):
        part, span = run.cut(i, j), (j - i) / run.rate
        if _periods(sinusoid, run.rate, span) < PERIODS or sum(part.lengths) * 4 < j - i:
            return [sinusoid]
        # what never changes has no sinusoid
        if not part.is_constant():
            near = strongest_frequency(part, sinusoid.frequency, 2 / span)
            halves.append(fit_sinusoid(part, near, sinusoid.run))
    gain = sum(half.explained for half in halves) - sinusoid.explained
    if not halves or (gain < threshold and not _wanders(run.cut(begin, end), sinusoid, threshold)):
        return [sinusoid]
    return [each for half in halves for each in follow(run, half, density)]


def _wanders(run, sinusoid, threshold):
    """Return whether 4, 8, ... parts, each with a frequency nearby, explain more than one."""
    sums, counts, _ = _baseband(run, sinusoid.frequency)
    parts, span = 4, (sinusoid.end - sinusoid.begin) / run.rate
    while _periods(sinusoid, run.rate, span) / parts >= PERIODS and len(sums) // parts >= 8:
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


def strongest_frequency(run, frequency, reach):
    """Return the frequency of most power within `reach` of one, to 1/(16 span)."""
    sums, _, interval = _baseband(run, frequency)
    offsets = np.linspace(-reach, reach, 2 * int(np.ceil(8 * reach * len(sums) * interval)) + 1)
    times = np.arange(len(sums)) * interval
    power = [abs(np.exp(-2j * np.pi * offset * times) @ sums) for offset in offsets]
    return frequency + offsets[int(np.argmax(power))]


def _baseband(run, frequency):
    """Return values times exp(-i w t) summed over short bins, their samples, and the bin in s."""
    first, last = run.extent
    width = -(-(last - first + 1) // BINS)
    size = -(-(last - first + 1) // width)
    sums, number = np.zeros(size, complex), np.zeros(size)
    for _, x, sample, _, (cosine, sine) in _chunks(run, frequency):
        bins = (sample - first) // width
        sums += np.bincount(bins, x * cosine, size) - 1j * np.bincount(bins, x * sine, size)
        number += np.bincount(bins, minlength=size)
    return sums, number, width / run.rate


def _products(run, frequency):
    """Return the products of x, u, cosine, sine, u cosine, u sine without the levels' means."""
    number = np.bincount(run.level, run.lengths)
    gram, sums = np.zeros((6, 6)), np.zeros((6, len(number)))
    for level, x, _, u, waves in _chunks(run, frequency):
        columns = np.vstack([x, u, waves, u * waves])
        gram += columns @ columns.T
        sums[:, level] += columns.sum(axis=1)
    return gram - (sums / number) @ sums.T


def _chunks(run, frequency):
    """Yield level, values less its mean, numbers of the samples, u and (cosine, sine) of each.

    u goes from -1 to 1 over the run, the phase counts from its middle.
    """
    first, last = run.extent
    middle, half = (first + last) / 2, (last - first) / 2
    stretches = run.split(run.centred(run.values))
    for start, level, x in zip(run.starts, run.level, stretches, strict=True):
        for i in range(0, len(x), CHUNK):
            part = x[i : i + CHUNK]
            sample = start + i + np.arange(len(part))
            angle = 2 * np.pi * (frequency / run.rate * (sample - middle) % 1)
            waves = np.array([np.cos(angle), np.sin(angle)])
            yield level, part, sample, (sample - middle) / half, waves
