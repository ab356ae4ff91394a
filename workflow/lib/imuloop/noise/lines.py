"""Sinusoids in the clean stretches of one axis: found, measured, removed, named."""

from dataclasses import dataclass
from itertools import pairwise
from math import log

import numpy as np
from scipy import fft, optimize, special, stats

from imuloop.noise.layout import Layout

# periods in a session below which a line is not told from a drift; as far from Nyquist
SHORTEST = 3
# independent values in a block of the background: at least, at most, share of those below it
FEWEST, MOST, SHARE = 24, 1024, 0.25
# relative difference of the clocks of two sessions, within which a line is the same
SAME_CLOCK = 1e-4
# mains, Hz; relative wander (50 mHz) and error of the clock behind the time stamps
MAINS, HARMONICS = (50.0, 60.0), ("1st", "2nd", "3rd", "4th", "5th")
WANDER, CLOCK = 1e-3, 2e-4
# a line is followed through halves of a record of that many periods at least, where they explain
# more, in units of the noise: exp(-GAIN) by chance
PERIODS, GAIN = 12, 12.0
# samples that are modelled at a time; parts of a record in which a wave is summed
CHUNK, BINS = 8192, 2048
# the fit of a frequency ends at this share of 1/T
ROUNDS, CLOSE = 8, 1e-3


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


@dataclass(frozen=True)
class Line:
    """Sinusoid of one axis.

    Attributes
    ----------
    frequency, frequency_ci95 : float, tuple of two floats
        Hz, with its 95 % interval.
    amplitude, amplitude_ci95 : float, tuple of two floats
        SI of the axis, with its 95 % interval, in the session where it stands out most.
    p_value : float
        Probability that noise alone shows such a peak anywhere in the searched band.
    waves : tuple of Wave
        What is removed. More than one a session where frequency, phase or amplitude wander; then
        `frequency` is the mean weighted with the power and `amplitude` the root mean square.
    """

    frequency: float
    frequency_ci95: tuple[float, float]
    amplitude: float
    amplitude_ci95: tuple[float, float]
    p_value: float
    waves: tuple[Wave, ...]

    def subtract(self, layouts, values):
        """Return the values without the line; sessions that do not show it are not copied.

        Parameters
        ----------
        layouts : sequence of Layout
        values : sequence of sequences of ndarray
            As `find_line` takes them.

        Returns
        -------
        list of lists of ndarray
        """
        shown = {wave.session for wave in self.waves}
        result = [
            [np.array(x, float) if i in shown else x for x in stretches]
            for i, stretches in enumerate(values)
        ]
        for wave in self.waves:
            layout, parts = _cut(layouts[wave.session], result[wave.session], wave.begin, wave.end)
            for i, part, _, waves in _chunks(layout, wave.frequency):
                parts[i][part] -= np.array([wave.cosine, wave.sine]) @ waves
        return result


def find_line(layouts, values, spectrum, level):
    r"""Return the sinusoid that stands out most from the noise, if chance does not explain it.

    The periodogram :math:`I(f) = 2 |\sum x_j e^{-2 \pi i f t_j}|^2/(n r)` of each session, level
    means and one slope removed, gaps filled with zeros, padded to twice the record, is divided by
    the spectrum and by the local background: the largest of the medians of I/S in the block of
    frequencies around and in the two beside it. So a misfit of the smooth model, its slope, and a
    band of neighbouring lines wider than half a block raise the background and are no lines. With
    a spectrum that is right up to a local factor, I/S is exponential, and

    .. math:: p_1 = E[e^{-x M}],\quad p = 1 - \exp(-p_1 - W \sqrt u e^{-u}),\quad u = -\ln p_1

    where x is the ratio at its maximum, M the largest of the medians of m exponentials and
    :math:`W = B \sqrt{4 \pi\,\mathrm{var}(t)}` counts the independent frequencies of the band B
    (Baluev's bound on the maximum over a continuous frequency).

    Sessions are tested one by one and W adds over them: the clocks of two sessions differ by more
    than the width 1/T of a line, so that powers at one frequency do not add.

    Parameters
    ----------
    layouts : sequence of Layout
        One a session.
    values : sequence of sequences of ndarray
        Samples of each clean stretch of each session, SI.
    spectrum : callable
        One-sided density of the noise, SI^2/Hz, at frequencies in Hz: 2 N^2 for white noise.
    level : float
        Chance, 1, of finding a line in noise that has none.

    Returns
    -------
    Line or None
        None also where no session is long enough, or all are constant.

    References
    ----------
    R. V. Baluev, MNRAS 385 (2008) 1279. Median, largest of neighbours: H. Rohling, IEEE Trans.
    Aerosp. Electron. Syst. 19 (1983) 608. Intervals: D. C. Rife and R. R. Boorstyn, IEEE Trans.
    Inf. Theory 20 (1974) 591.
    """
    searches = [_search(*session, spectrum) for session in zip(layouts, values, strict=True)]
    live = {i: search for i, search in enumerate(searches) if search is not None}
    if not live:
        return None
    peaks = {i: search.strongest() for i, search in live.items()}
    best = min(peaks, key=lambda i: peaks[i][0])
    independent = sum(s.band.independent for s in live.values())
    if _over_band(peaks[best][0], independent) > level:
        return None
    search = live[best]
    wave = _fit_wave(layouts[best], values[best], peaks[best][1], best)
    p_value = _over_band(search.chance(wave), independent)
    if p_value > level:
        return None
    waves = {best: _follow(layouts[best], values[best], wave, search.density(wave.frequency)[0])}
    for i in live.keys() - {best}:
        span = live[i].band.span
        reach = 1 / search.band.span + 1 / span + SAME_CLOCK * wave.frequency
        near = _highest(layouts[i], values[i], wave.frequency, reach)
        same = _fit_wave(layouts[i], values[i], near, i)
        if _over_band(live[i].chance(same), 2 * reach * span) <= level:
            density = live[i].density(same.frequency)[0]
            waves[i] = _follow(layouts[i], values[i], same, density)
    return Line(
        *_summary(waves[best], layouts[best].rate, *search.density(wave.frequency)),
        p_value=p_value,
        waves=tuple(wave for i in sorted(waves) for wave in waves[i]),
    )


def detection_limit(layouts, spectrum, frequency, level, probability=0.9):
    r"""Return the amplitude of a line that `find_line` finds with the given probability.

    Twice I/S is non-central chi-square with two degrees of freedom and
    :math:`\lambda = A^2 n/(r S)`. The session with the lowest limit counts.

    Parameters
    ----------
    layouts, spectrum, level
        As `find_line` takes them.
    frequency : float
        Hz.
    probability : float, optional
        1.

    Returns
    -------
    float
        SI of the axis; infinite where the frequency is not searched.
    """
    bands = [band for band in map(_band, layouts) if band is not None]
    independent = sum(band.independent for band in bands)
    limit = np.inf
    for band in bands:
        if not band.edges[0] <= frequency / band.step < band.edges[-1]:
            continue
        near = band.near(frequency)
        m, sides = band.sizes[near].min(), near.stop - near.start
        ratio = optimize.brentq(
            lambda x, *of: _over_band(_chance(x, *of), independent) - level, 0.1, 1e6, (m, sides)
        )
        half = (m + 1) / 2
        # the line itself, some three values wide, lies in the block that it is compared with
        share = special.betaincinv(half, half, 0.5 ** (1 / sides)) * m / (m - 3)
        background = -np.log1p(-share)
        noncentrality = optimize.brentq(
            lambda v, x: stats.ncx2.sf(2 * x, 2, v) - probability, 0, 1e8, (ratio * background,)
        )
        density = spectrum(np.array([frequency]))[0]
        limit = min(limit, float(np.sqrt(noncentrality * band.rate * density / band.samples)))
    return limit


def mains(frequency, rate):
    r"""Return which mains harmonic lies at a frequency, itself or folded by the sampling.

    A harmonic h of :math:`f_0` appears at :math:`|h f_0 - k r|`. The window to either side is 1.2
    per mille of :math:`h f_0`: 50 mHz of 50 Hz for mains' own wander, and 200 ppm for the clock
    behind the time stamps, whose error scales all logged frequencies, r too. Within the window of
    zero nothing is named: every slow line would be.

    Parameters
    ----------
    frequency, rate : float
        Hz. Where the rate is only nominal, a missing name says nothing.

    Returns
    -------
    str or None
        E.g. ``50 Hz mains, alias of its 2nd harmonic``; the lowest harmonic that fits, both mains
        where both do. CHANCE
    """
    names = []
    for f0 in MAINS:
        for h, order in enumerate(HARMONICS, 1):
            window = h * f0 * (WANDER + CLOCK)
            folded = abs(h * f0 - rate * round(h * f0 / rate))
            if frequency > window and abs(frequency - folded) <= window:
                alias = ", alias of its " if h * f0 > rate / 2 else ", its "
                names.append(f"{f0:.0f} Hz mains{alias}{order} harmonic")
                break
    return " or ".join(names).replace(", its 1st harmonic", "") or None


@dataclass(frozen=True)
class _Band:
    """What is searched in one session.

    `edges` of the blocks in steps of the padded transform, `sizes` the independent values in each;
    `independent` is W of `find_line`.
    """

    rate: float
    samples: int
    span: float
    padded: int
    edges: np.ndarray
    sizes: np.ndarray
    independent: float

    @property
    def step(self):
        """Distance of the frequencies of the padded transform, Hz."""
        return self.rate / self.padded

    def near(self, frequency):
        """Return the block of a frequency in Hz and those beside it."""
        at = np.searchsorted(self.edges, frequency / self.step, side="right") - 1
        block = int(np.clip(at, 0, self.sizes.size - 1))
        return slice(max(block - 1, 0), min(block + 2, self.sizes.size))


@dataclass(frozen=True)
class _Search:
    """Periodogram over spectrum of one session, and the medians of its blocks."""

    band: _Band
    spectrum: object
    ratio: np.ndarray
    medians: np.ndarray

    def strongest(self):
        """Return the least chance, at one frequency, that a peak may have, and its place in Hz."""
        edges = self.band.edges - self.band.edges[0]
        peaks = np.maximum.reduceat(self.ratio, edges[:-1])
        best = {}
        for b, peak in enumerate(peaks):
            near = slice(max(b - 1, 0), b + 2)
            kind = (self.band.sizes[near].min(), self.band.sizes[near].size)
            best[kind] = max(best.get(kind, (0.0, 0)), (peak / self.medians[near].max(), b))
        # between two frequencies of the padded transform a peak is up to 1/sinc^2(1/4) higher
        chance, b = min((_chance(x / 0.81, *kind), b) for kind, (x, b) in best.items())
        top = edges[b] + int(self.ratio[edges[b] : edges[b + 1]].argmax())
        place = float(top + self.band.edges[0])
        if 0 < top < self.ratio.size - 1:
            left, centre, right = np.log(self.ratio[top - 1 : top + 2].astype(float))
            place += np.clip((right - left) / (4 * centre - 2 * (left + right)), -0.5, 0.5)
        return chance, place * self.band.step

    def chance(self, wave):
        """Return the chance of a peak as high as a fitted wave at one frequency."""
        near = self.band.near(wave.frequency)
        density = self.spectrum(np.array([wave.frequency]))[0]
        x = wave.explained / (self.band.rate * density * self.medians[near].max())
        return _chance(x, self.band.sizes[near].min(), near.stop - near.start)

    def density(self, frequency):
        """Return the local density and its degrees of freedom; a median has 48 % of a mean's."""
        near = self.band.near(frequency)
        sizes = self.band.sizes[near]
        scale = np.average(self.medians[near], weights=sizes) / log(2)
        return self.spectrum(np.array([frequency]))[0] * scale, 2 * log(2) ** 2 * sizes.sum()


def _band(layout):
    """Return what is searched in a session, None where it is too short."""
    starts, lengths = np.array(layout.starts), np.array(layout.lengths)
    n, samples = int(lengths.sum()), int((starts + lengths).max() - starts.min())
    # frequencies in units of rate/n, the distance of independent ones
    low = SHORTEST * n / samples
    sizes, k = [], low
    while k + (size := int(np.clip(SHARE * k, FEWEST, MOST))) < n / 2 - low:
        sizes.append(size)
        k += size
    if not sizes:
        return None
    padded = fft.next_fast_len(2 * samples, real=True)
    edges = np.ceil((low + np.cumsum([0, *sizes])) * padded / n).astype(int)
    edges[-1] = int((n / 2 - low) * padded / n)
    middle = starts + (lengths - 1) / 2
    spread = (middle - np.average(middle, weights=lengths)) ** 2 + (lengths**2 - 1) / 12
    turns = np.sqrt(4 * np.pi * np.average(spread, weights=lengths))
    return _Band(
        rate=layout.rate,
        samples=n,
        span=samples / layout.rate,
        padded=padded,
        edges=edges,
        sizes=np.array(sizes),
        independent=float((edges[-1] - edges[0]) / padded * turns),
    )


def _search(layout, stretches, spectrum):
    """Return the search of one session, None where it is too short or constant."""
    band = _band(layout)
    if band is None:
        return None
    # single precision: its rounding lies 14 decades below the variance
    power = fft.rfft(_filled(layout, stretches, band.padded))[band.edges[0] : band.edges[-1]]
    power = power.real**2 + power.imag**2
    power *= 2 / (band.samples * band.rate)
    edges = band.edges - band.edges[0]
    medians = np.empty(band.sizes.size)
    for b, (i, j) in enumerate(pairwise(edges)):
        power[i:j] /= spectrum(band.step * np.arange(i + band.edges[0], j + band.edges[0]))
        # every other one: those between are not independent
        medians[b] = np.median(power[i:j:2])
    return _Search(band, spectrum, power, medians) if medians.all() else None


def _cut(layout, stretches, begin, end):
    """Return the layout and the values, as views, from sample `begin` to before `end`."""
    kept = [
        (max(a, begin), x[max(begin - a, 0) : max(end - a, 0)], level)
        for a, x, level in zip(layout.starts, stretches, layout.levels, strict=True)
        if a < end and a + len(x) > begin
    ]
    starts, parts, levels = zip(*kept, strict=True) if kept else ((), (), ())
    return Layout(layout.rate, starts, tuple(len(x) for x in parts), levels), parts


def _levels(layout):
    """Return the level of each stretch as 0, 1, ..., and the samples of each level."""
    level = np.unique(layout.levels, return_inverse=True)[1]
    return level, np.bincount(level, layout.lengths)


def _extent(layout):
    """Return first and last sample of a session."""
    ends = np.add(layout.starts, layout.lengths)
    return min(layout.starts), int(ends.max()) - 1


def _chunks(layout, frequency=0.0):
    """Yield stretch, slice, u from -1 to 1 over the session, cosine and sine from its middle on."""
    first, last = _extent(layout)
    middle, half = (first + last) / 2, (last - first) / 2
    turns = frequency / layout.rate
    within = np.exp(2j * np.pi * turns * np.arange(CHUNK))
    for i, (start, length) in enumerate(zip(layout.starts, layout.lengths, strict=True)):
        for a in range(0, length, CHUNK):
            b = min(a + CHUNK, length)
            u = (np.arange(start + a, start + b) - middle) / half
            wave = np.exp(2j * np.pi * (turns * (start + a - middle) % 1)) * within[: b - a]
            yield i, slice(a, b), u, np.array([wave.real, wave.imag])


def _gram(layout, stretches, frequency):
    """Return the products of x, u, cosine, sine, u cosine, u sine without the levels' means."""
    level, counts = _levels(layout)
    mean = np.bincount(level, [np.sum(x) for x in stretches]) / counts
    gram, sums = np.zeros((6, 6)), np.zeros((counts.size, 6))
    for i, part, u, waves in _chunks(layout, frequency):
        columns = np.empty((6, u.size))
        columns[0] = stretches[i][part] - mean[level[i]]
        columns[1], columns[2:4], columns[4:] = u, waves, u * waves
        gram += columns @ columns.T
        sums[level[i]] += columns.sum(1)
    return gram - (sums.T / counts) @ sums


def _filled(layout, stretches, padded):
    """Return a session without its levels and its slope, zeros in the gaps and behind."""
    level, counts = _levels(layout)
    starts, lengths = np.array(layout.starts), np.array(layout.lengths)
    middles = starts + (lengths - 1) / 2
    x_mean = np.bincount(level, [np.sum(x) for x in stretches]) / counts
    t_mean = np.bincount(level, lengths * middles) / counts
    upper = 0.0
    for i, part, *_ in _chunks(layout):
        t = np.arange(part.start, part.stop) + (starts[i] - t_mean[level[i]])
        upper += t @ (stretches[i][part] - x_mean[level[i]])
    slope = upper / (lengths @ ((lengths**2 - 1) / 12 + (middles - t_mean[level]) ** 2))
    filled = np.zeros(padded, np.float32)
    for i, part, *_ in _chunks(layout):
        t = np.arange(part.start, part.stop) + (starts[i] - t_mean[level[i]])
        at = starts[i] - starts.min() + part.start
        filled[at : at + t.size] = stretches[i][part] - x_mean[level[i]] - slope * t
    return filled


def _chance(x, m, sides):
    """Return E[exp(-x M)], M the largest of `sides` medians of m exponentials of mean 1."""
    s = np.geomspace(1e-4, 1e3, 700)
    below = special.betainc((m + 1) / 2, (m + 1) / 2, -np.expm1(-s / x)) ** sides
    return np.trapezoid(np.exp(-s) * below, s)


def _over_band(chance, independent):
    """Return the chance of a peak anywhere from that at one frequency."""
    chance = max(chance, 1e-300)
    return float(-np.expm1(-chance * (1 + independent * np.sqrt(-np.log(min(chance, 1.0))))))


def _highest(layout, stretches, frequency, reach):
    """Return the frequency of most power within `reach` of one, to 1/(16 span)."""
    first, last = _extent(layout)
    width = -(-(last - first + 1) // BINS)
    level, counts = _levels(layout)
    mean = np.bincount(level, [np.sum(x) for x in stretches]) / counts
    sums = np.zeros(BINS, complex)
    for i, part, _, waves in _chunks(layout, frequency):
        x = stretches[i][part] - mean[level[i]]
        bins = np.arange(part.start, part.stop) + (layout.starts[i] - first)
        bins //= width
        for wave, unit in zip(waves, (1, -1j), strict=True):
            sums += unit * np.bincount(bins, x * wave, BINS)
    span = (last - first + 1) / layout.rate
    offsets = np.linspace(-reach, reach, 2 * int(np.ceil(8 * reach * span)) + 1)
    times = np.arange(BINS) * (width / layout.rate)
    power = [abs(np.exp(-2j * np.pi * offset * times) @ sums) for offset in offsets]
    return frequency + offsets[int(np.argmax(power))]


def _follow(layout, stretches, wave, density):
    """Return the waves of the parts, halved as long as the halves explain more than chance."""
    middle = (wave.begin + wave.end) // 2
    halves = []
    for begin, end in ((wave.begin, middle), (middle, wave.end)):
        part, x = _cut(layout, stretches, begin, end)
        span = (end - begin) / layout.rate
        if span * wave.frequency < PERIODS or sum(part.lengths) * 4 < end - begin:
            return [wave]
        near = _highest(part, x, wave.frequency, 2 / span)
        halves.append(_fit_wave(part, x, near, wave.session))
    more = sum(half.explained for half in halves) - wave.explained
    if more < GAIN * density * layout.rate:
        return [wave]
    return [w for half in halves for w in _follow(layout, stretches, half, density)]


def _summary(waves, rate, density, freedom):
    """Return frequency, amplitude and their intervals, averaged over the parts of a session."""
    variance = density * rate / 2
    t = stats.t.ppf(0.975, freedom)
    f, c, s, d_amplitude, d_frequency = np.array(
        [(w.frequency, w.cosine, w.sine, w.amplitude_std, w.frequency_std) for w in waves]
    ).T
    share = d_amplitude**-2 / np.sum(d_amplitude**-2)
    amplitude = np.sqrt(share @ (c**2 + s**2))
    power = share * (c**2 + s**2) / amplitude**2
    frequency = power @ f
    a_error = t * np.sqrt(variance / np.sum(d_amplitude**-2))
    f_error = t * np.sqrt(variance * np.sum((power * d_frequency) ** 2))
    if len(waves) > 1:
        scatter = np.sum(power**2 * (f - frequency) ** 2) * len(waves) / (len(waves) - 1)
        f_error = max(f_error, stats.t.ppf(0.975, len(waves) - 1) * np.sqrt(scatter))
    return (
        float(frequency),
        (float(frequency - f_error), float(frequency + f_error)),
        float(amplitude),
        (float(amplitude - a_error), float(amplitude + a_error)),
    )


def _fit_wave(layout, stretches, start, session):
    """Return the sinusoid beside levels and a slope, by Gauss-Newton from within 1/(4 span)."""
    first, last = _extent(layout)
    span = (last - first + 1) / layout.rate
    frequency = start
    for _ in range(ROUNDS):
        gram = _gram(layout, stretches, frequency)
        _, cosine, sine = np.linalg.solve(gram[1:4, 1:4], gram[1:4, 0])
        # derivative by the frequency, t = u span/2: pi span u (sine cos - cosine sin)
        mix = np.eye(5, 6)
        mix[4, 4:] = np.pi * (last - first) / layout.rate * np.array([sine, -cosine])
        mixed = mix @ gram @ mix.T
        covariance = np.linalg.inv(mixed[1:, 1:])
        _, cosine, sine, change = fit = covariance @ mixed[1:, 0]
        if abs(change) * span < CLOSE:
            break
        frequency = float(np.clip(frequency + change, start - 1 / span, start + 1 / span))
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
