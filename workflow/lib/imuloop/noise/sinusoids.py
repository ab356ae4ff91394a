"""Sinusoids by least squares in the clean stretches of a session, at little memory."""

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
    """Least-squares sinusoid in part of a session: samples from `begin`, before `end`.

    Frequency in Hz, cosine and sine in SI; the phase counts from the middle between the part's
    first and last clean sample. `explained` is the sum of squares that it takes, SI^2; standard
    errors are those where the noise is white with variance 1.
    """

    session: int
    begin: int
    end: int
    frequency: float
    cosine: float
    sine: float
    explained: float
    amplitude_std: float
    frequency_std: float

    def subtract(self, sampling, values):
        """Take the sinusoid out of the values of the session, in place."""
        part, x = sampling.cut(values, self.begin, self.end)
        size = np.array([self.cosine, self.sine])
        line = np.concatenate([size @ waves for *_, waves in _chunks(part, x, self.frequency)])
        for stretch, each in zip(x, np.split(line, np.cumsum(part.lengths)[:-1]), strict=True):
            stretch -= each


def fit_sinusoid(sampling, values, start, session):
    """Return the FittedSinusoid beside levels and a slope, from within 1/(4 span) of `start`, Hz.

    Gauss-Newton; a step is halved until the sinusoid explains more.
    """
    first, last = sampling.extent
    span = (last - first + 1) / sampling.rate
    frequency, step, most = start, 0.0, -np.inf
    for _ in range(ROUNDS):
        tried = _products(sampling, values, frequency + step)
        line = np.linalg.solve(tried[1:4, 1:4], tried[1:4, 0])
        if line @ tried[1:4, 0] < most:
            step /= 2
            continue
        frequency, gram, most = frequency + step, tried, line @ tried[1:4, 0]
        _, cosine, sine = line
        # derivative by the frequency, t = u span/2: pi span u (sine cos - cosine sin)
        mix = np.eye(5, 6)
        mix[4, 4:] = np.pi * (last - first) / sampling.rate * np.array([sine, -cosine])
        mixed = mix @ gram @ mix.T
        covariance = np.linalg.inv(mixed[1:, 1:])
        fit, change = covariance @ mixed[1:, 0], 0.0
        if abs(fit[3]) * span < CLOSE:
            change = fit[3]
            break
        step = np.clip(frequency + fit[3], max(start - 1 / span, 1 / span), start + 1 / span)
        step -= frequency
        # where the fit does not end, the sinusoid of the last frequency
        fit = np.append(line, 0.0)
    cosine, sine = fit[1:3]
    direction = np.array([0, cosine, sine, 0]) / np.hypot(cosine, sine)
    return FittedSinusoid(
        session=session,
        begin=first,
        end=last + 1,
        frequency=float(frequency + change),
        cosine=float(cosine),
        sine=float(sine),
        explained=float(fit @ mixed[1:, 0] - gram[0, 1] ** 2 / gram[1, 1]),
        amplitude_std=float(np.sqrt(direction @ covariance @ direction)),
        frequency_std=float(np.sqrt(covariance[3, 3])),
    )


def follow(sampling, values, sinusoid, density):
    """Return the sinusoids of the parts of a session through which one wanders, or it alone.

    Halved as long as smaller parts explain more than chance; `density` is that of the noise there,
    one-sided, SI^2/Hz.
    """
    begin, end, frequency = sinusoid.begin, sinusoid.end, sinusoid.frequency
    middle, noise = (begin + end) // 2, GAIN * density * sampling.rate
    halves = []
    for i, j in ((begin, middle), (middle, end)):
        part, x = sampling.cut(values, i, j)
        span = (j - i) / sampling.rate
        if span * _from_ends(frequency, sampling.rate) < PERIODS or sum(part.lengths) * 4 < j - i:
            return [sinusoid]
        # what never changes has no sinusoid
        if any(np.ptp(each) for each in x):
            near = strongest_frequency(part, x, frequency, 2 / span)
            halves.append(fit_sinusoid(part, x, near, sinusoid.session))
    if not halves:
        return [sinusoid]
    if sum(half.explained for half in halves) - sinusoid.explained < noise:
        part, x = sampling.cut(values, begin, end)
        if not _wanders(part, x, sinusoid, noise):
            return [sinusoid]
    return [each for half in halves for each in follow(sampling, values, half, density)]


def _wanders(sampling, values, sinusoid, noise):
    """Return whether 4, 8, ... parts, each with a frequency nearby, explain more than one."""
    sums, counts, _ = _baseband(sampling, values, sinusoid.frequency)
    span = (sinusoid.end - sinusoid.begin) / sampling.rate
    parts, periods = 4, span * _from_ends(sinusoid.frequency, sampling.rate)
    while periods / parts >= PERIODS and len(sums) // parts >= 8:
        size = len(sums) // parts
        power = abs(np.fft.fft(sums[: parts * size].reshape(parts, size), 4 * size)) ** 2
        # up to two widths 1/T to either side
        top = np.hstack([power[:, :9], power[:, -8:]]).max(axis=1)
        taken = 2 * top / np.maximum(counts[: parts * size].reshape(parts, size).sum(axis=1), 1)
        # the mirror at -f is left out: an error of 1/(pi PERIODS)
        if taken.sum() > 1.03 * sinusoid.explained + (parts - 1) * noise:
            return True
        parts *= 2
    return False


def _from_ends(frequency, rate):
    """Return the distance from zero and from Nyquist, where a sinusoid meets its mirror, Hz."""
    return min(frequency, rate / 2 - frequency)


def strongest_frequency(sampling, values, frequency, reach):
    """Return the frequency of most power within `reach` of one, to 1/(16 span)."""
    sums, _, interval = _baseband(sampling, values, frequency)
    offsets = np.linspace(-reach, reach, 2 * int(np.ceil(8 * reach * len(sums) * interval)) + 1)
    times = np.arange(len(sums)) * interval
    power = [abs(np.exp(-2j * np.pi * offset * times) @ sums) for offset in offsets]
    return frequency + offsets[int(np.argmax(power))]


def _baseband(sampling, values, frequency):
    """Return values times exp(-i w t) summed over short bins, their samples, and the bin in s."""
    first, last = sampling.extent
    width = -(-(last - first + 1) // BINS)
    size = -(-(last - first + 1) // width)
    sums, number = np.zeros(size, complex), np.zeros(size)
    for _, x, sample, _, (cosine, sine) in _chunks(sampling, values, frequency):
        bins = (sample - first) // width
        sums += np.bincount(bins, x * cosine, size) - 1j * np.bincount(bins, x * sine, size)
        number += np.bincount(bins, minlength=size)
    return sums, number, width / sampling.rate


def _products(sampling, values, frequency):
    """Return the products of x, u, cosine, sine, u cosine, u sine without the levels' means."""
    number = np.bincount(sampling.level, sampling.lengths)
    gram, sums = np.zeros((6, 6)), np.zeros((6, len(number)))
    for level, x, _, u, waves in _chunks(sampling, values, frequency):
        columns = np.vstack([x, u, waves, u * waves])
        gram += columns @ columns.T
        sums += [np.bincount(level, c, len(number)) for c in columns]
    return gram - (sums / number) @ sums.T


def _chunks(sampling, values, frequency):
    """Yield level, value less its level's mean, number of each sample, u and (cosine, sine).

    u goes from -1 to 1 over the session, the phase counts from its middle.
    """
    first, last = sampling.extent
    middle, half = (first + last) / 2, (last - first) / 2
    x, sample = sampling.joined(values)
    level = np.repeat(sampling.level, sampling.lengths)
    for i in range(0, len(x), CHUNK):
        at = slice(i, i + CHUNK)
        from_middle = sample[at] - middle
        angle = 2 * np.pi * (frequency / sampling.rate * from_middle % 1)
        waves = np.array([np.cos(angle), np.sin(angle)])
        yield level[at], x[at], sample[at], from_middle / half, waves
