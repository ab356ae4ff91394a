"""Sinusoids by least squares in the clean stretches of a session, at little memory."""

from dataclasses import dataclass

import numpy as np

from imuloop.noise.layout import CHUNK, Layout

# parts of a record in which a wave is summed
BINS = 8192
# the fit of a frequency ends at this share of 1/T
ROUNDS, CLOSE = 8, 1e-3
# a wave is followed through halves of a record of that many periods at least, where they explain
# more, in units of the noise: exp(-GAIN) by chance
PERIODS, GAIN = 12, 12.0


@dataclass(frozen=True)
class Wave:
    """Least-squares sinusoid in part of a session.

    Attributes
    ----------
    session, begin, end : int
        Where: samples from `begin`, before `end`.
    frequency, cosine, sine : float
        Hz and SI; the phase counts from the middle between the part's first and last clean sample.
    explained : float
        Sum of squares that it takes, SI^2.
    amplitude_std, frequency_std : float
        Standard errors where the noise is white with variance 1.
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


def fit_wave(layout, stretches, start, session):
    """Return the sinusoid beside levels and a slope, by Gauss-Newton from within 1/(4 span).

    A step is halved until the sinusoid explains more.
    """
    first, last = extent(layout)
    span = (last - first + 1) / layout.rate
    frequency, step, most = start, 0.0, -np.inf
    for _ in range(ROUNDS):
        tried = products(layout, stretches, frequency + step)
        line = np.linalg.solve(tried[1:4, 1:4], tried[1:4, 0])
        if line @ tried[1:4, 0] < most:
            step /= 2
            continue
        frequency, gram, most = frequency + step, tried, line @ tried[1:4, 0]
        _, cosine, sine = line
        # derivative by the frequency, t = u span/2: pi span u (sine cos - cosine sin)
        mix = np.eye(5, 6)
        mix[4, 4:] = np.pi * (last - first) / layout.rate * np.array([sine, -cosine])
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
    return Wave(
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


def follow(layout, stretches, wave, density):
    """Return the waves of the parts, halved as long as smaller parts explain more than chance."""
    middle, noise = (wave.begin + wave.end) // 2, GAIN * density * layout.rate
    halves = []
    for begin, end in ((wave.begin, middle), (middle, wave.end)):
        part, x = cut(layout, stretches, begin, end)
        span = (end - begin) / layout.rate
        if (
            span * _from_ends(wave.frequency, layout.rate) < PERIODS
            or sum(part.lengths) * 4 < end - begin
        ):
            return [wave]
        if not any(np.ptp(each) for each in x):
            # what never changes has no wave
            continue
        near = highest(part, x, wave.frequency, 2 / span)
        halves.append(fit_wave(part, x, near, wave.session))
    if not halves:
        return [wave]
    if sum(half.explained for half in halves) - wave.explained < noise:
        part, x = cut(layout, stretches, wave.begin, wave.end)
        if not _wanders(part, x, wave, noise):
            return [wave]
    return [w for half in halves for w in follow(layout, stretches, half, density)]


def _wanders(layout, stretches, wave, noise):
    """Return whether 4, 8, ... parts, each with a frequency nearby, explain more than a wave."""
    sums, counts, _ = _baseband(layout, stretches, wave.frequency)
    span = (wave.end - wave.begin) / layout.rate
    parts, periods = 4, span * _from_ends(wave.frequency, layout.rate)
    while periods / parts >= PERIODS and len(sums) // parts >= 8:
        size = len(sums) // parts
        power = abs(np.fft.fft(sums[: parts * size].reshape(parts, size), 4 * size)) ** 2
        # up to two widths 1/T to either side
        top = np.hstack([power[:, :9], power[:, -8:]]).max(axis=1)
        taken = 2 * top / np.maximum(counts[: parts * size].reshape(parts, size).sum(axis=1), 1)
        # the mirror at -f is left out: an error of 1/(pi PERIODS)
        if taken.sum() > 1.03 * wave.explained + (parts - 1) * noise:
            return True
        parts *= 2
    return False


def _from_ends(frequency, rate):
    """Return the distance from zero and from Nyquist, where a wave meets its mirror, Hz."""
    return min(frequency, rate / 2 - frequency)


def highest(layout, stretches, frequency, reach):
    """Return the frequency of most power within `reach` of one, to 1/(16 span)."""
    sums, _, interval = _baseband(layout, stretches, frequency)
    span = len(sums) * interval
    offsets = np.linspace(-reach, reach, 2 * int(np.ceil(8 * reach * span)) + 1)
    times = np.arange(len(sums)) * interval
    power = [abs(np.exp(-2j * np.pi * offset * times) @ sums) for offset in offsets]
    return frequency + offsets[int(np.argmax(power))]


def _baseband(layout, stretches, frequency):
    """Return values times exp(-i w t) summed over short bins, their samples, and the bin in s."""
    first, last = extent(layout)
    width = -(-(last - first + 1) // BINS)
    size = -(-(last - first + 1) // width)
    means = _means(layout, stretches)
    sums, number = np.zeros(size, complex), np.zeros(size)
    for group, sample, _, (cosine, sine) in chunks(layout, frequency):
        x, level = _values(layout, stretches, group)
        x, bins = x - means[level], (sample - first) // width
        sums += np.bincount(bins, x * cosine, size) - 1j * np.bincount(bins, x * sine, size)
        number += np.bincount(bins, minlength=size)
    return sums, number, width / layout.rate


def products(layout, stretches, frequency):
    """Return the products of x, u, cosine, sine, u cosine, u sine without the levels' means."""
    means = _means(layout, stretches)
    gram, sums = np.zeros((6, 6)), np.zeros((means.size, 6))
    for group, _, u, waves in chunks(layout, frequency):
        x, level = _values(layout, stretches, group)
        columns = np.empty((6, u.size))
        columns[0] = x - means[level]
        columns[1], columns[2:4], columns[4:] = u, waves, u * waves
        gram += columns @ columns.T
        if len(group) == 1:
            sums[level] += columns.sum(1)
        else:
            sums += np.array([np.bincount(level, c, means.size) for c in columns]).T
    return gram - (sums.T / layout.of_level[1]) @ sums


def _means(layout, stretches):
    """Return the mean of each level."""
    counts = layout.of_level[1]
    total = np.zeros(counts.size)
    for group in layout.groups:
        x, level = _values(layout, stretches, group)
        if len(group) == 1:
            total[level] += x.sum()
        else:
            total += np.bincount(level, x, counts.size)
    return total / counts


def _values(layout, stretches, group):
    """Return the values of a group, and their levels: one number where it is a single part."""
    level = layout.of_level[0]
    if len(group) == 1:
        ((i, part),) = group
        return stretches[i][part], level[i]
    x = np.concatenate([stretches[i][part] for i, part in group])
    return x, np.repeat(level[[i for i, _ in group]], [p.stop - p.start for _, p in group])


def chunks(layout, frequency):
    """Yield of each group: its parts, the number of each sample, u and (cosine, sine).

    u goes from -1 to 1 over the session, the phase counts from its middle.
    """
    first, last = extent(layout)
    middle, half = (first + last) / 2, (last - first) / 2
    turns = frequency / layout.rate
    within = np.exp(2j * np.pi * turns * np.arange(min(CHUNK, max(layout.lengths))))
    for group in layout.groups:
        start = np.array([layout.starts[i] + part.start for i, part in group])
        length = np.array([part.stop - part.start for _, part in group])
        phase = np.exp(2j * np.pi * (turns * (start - middle) % 1))
        if len(group) == 1:
            sample, wave = np.arange(start[0], start[0] + length[0]), phase * within[: length[0]]
        else:
            # places in their parts
            place = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
            sample = np.repeat(start, length) + place
            wave = np.repeat(phase, length) * within[place]
        yield group, sample, (sample - middle) / half, np.array([wave.real, wave.imag])


def cut(layout, stretches, begin, end):
    """Return the layout and the values, as views, from sample `begin` to before `end`."""
    kept = [
        (max(a, begin), x[max(begin - a, 0) : max(end - a, 0)], level)
        for a, x, level in zip(layout.starts, stretches, layout.levels, strict=True)
        if a < end and a + len(x) > begin
    ]
    starts, parts, levels = zip(*kept, strict=True) if kept else ((), (), ())
    return Layout(layout.rate, starts, tuple(len(x) for x in parts), levels), parts


def extent(layout):
    """Return first and last sample of a session."""
    ends = np.add(layout.starts, layout.lengths)
    return min(layout.starts), int(ends.max()) - 1
