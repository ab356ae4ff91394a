"""Lines of one axis: found, measured, removed, named."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from imuloop.noise.layout import Layout
from imuloop.noise.periodogram import SHORTEST, band_of, one_frequency, over_band, periodogram
from imuloop.noise.waves import Wave, chunks, cut, fit_wave, follow, highest

# relative difference of the clocks of two sessions, within which a line is the same
SAME_CLOCK = 1e-4
# mains, Hz; relative wander (50 mHz) and error of the clock behind the time stamps
MAINS, ORDERS = (50.0, 60.0), ("1st", "2nd", "3rd", "4th", "5th")
WANDER, CLOCK = 1e-3, 2e-4


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
        `frequency` is the mean weighted with the power and `amplitude` the root mean square, low
        by what the line wanders within a part.
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
            layout, parts = cut(layouts[wave.session], result[wave.session], wave.begin, wave.end)
            for group, _, _, waves in chunks(layout, wave.frequency):
                line, at = np.array([wave.cosine, wave.sine]) @ waves, 0
                for i, part in group:
                    parts[i][part] -= line[at : at + part.stop - part.start]
                    at += part.stop - part.start
        return result

    def left(self, line, rate):
        """Return whether a later line is what this one left: within 1/T of a wave of time T."""
        beside = {
            wave.session
            for wave in self.waves
            if abs(wave.frequency - line.frequency) * (wave.end - wave.begin) <= rate
        }
        return beside.issuperset(wave.session for wave in line.waves)


def means(layouts, values, size):
    """Return the layouts and the values of the means of `size` samples: slow lines at no cost."""
    layouts_of_means, values_of_means = [], []
    for layout, stretches in zip(layouts, values, strict=True):
        kept = [i for i, n in enumerate(layout.lengths) if n >= size]
        if not kept:
            continue
        blocks = [stretches[i][: layout.lengths[i] // size * size] for i in kept]
        values_of_means.append([x.reshape(-1, size).mean(axis=1) for x in blocks])
        starts, lengths = ([of[i] // size for i in kept] for of in (layout.starts, layout.lengths))
        levels = tuple(layout.levels[i] for i in kept)
        layouts_of_means.append(Layout(layout.rate / size, tuple(starts), tuple(lengths), levels))
    return layouts_of_means, values_of_means


def find_line(layouts, values, spectrum, level):
    r"""Return the sinusoid that stands out most from the noise, if chance does not explain it.

    The periodogram :math:`I(f) = 2 |\sum x_j e^{-2 \pi i f t_j}|^2/(n r)` of each session, level
    means and one slope removed, gaps filled with zeros, padded to twice the record, is divided by
    the spectrum and by the local background: the largest of the medians of I/S in the block of
    frequencies around and in the two beside it. So a misfit of the smooth model, its slope, and a
    band of neighbouring lines wider than half a block (0.15 Hz, 0.5 % of f or 128 independent
    frequencies) raise the background and are no lines. With a spectrum that is right up to a local
    factor, I/S is exponential, and

    .. math:: p_1 = E[e^{-x M}],\quad p = 1 - \exp(-p_1 - W \sqrt u e^{-u}),\quad u = -\ln p_1

    where x is the ratio at its maximum, M the largest of the medians of m exponentials and
    :math:`W = B \sqrt{4 \pi\,\mathrm{var}(t)}` counts the independent frequencies of the band B
    (Baluev's bound on the maximum over a continuous frequency).

    A line that wanders is told from many by halving: where the halves of the record, each with a
    frequency, phase and amplitude of its own, explain more than the whole and chance, it is
    followed through them, and is still one line.

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
    searches = [periodogram(*session, spectrum) for session in zip(layouts, values, strict=True)]
    live = {i: search for i, search in enumerate(searches) if search is not None}
    if not live:
        return None
    peaks = {i: search.strongest() for i, search in live.items()}
    best = min(peaks, key=lambda i: peaks[i][0])
    independent = sum(s.band.independent for s in live.values())
    if over_band(peaks[best][0], independent) > level:
        return None
    search = live[best]
    wave = fit_wave(layouts[best], values[best], peaks[best][1], best)
    p_value = over_band(search.chance(wave), independent)
    if p_value > level:
        return None
    density = search.density_of_parts(wave.frequency)
    waves = {best: follow(layouts[best], values[best], wave, density)}
    for i in live.keys() - {best}:
        span = live[i].band.span
        if wave.frequency * span < SHORTEST:
            continue
        reach = 1 / search.band.span + 1 / span + SAME_CLOCK * wave.frequency
        near = highest(layouts[i], values[i], wave.frequency, reach)
        same = fit_wave(layouts[i], values[i], near, i)
        if over_band(live[i].chance(same), 2 * reach * span) <= level:
            density = live[i].density_of_parts(same.frequency)
            waves[i] = follow(layouts[i], values[i], same, density)
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
    # load for a second, and no estimate needs them
    from scipy import optimize, stats

    bands = [band for band in map(band_of, layouts) if band is not None]
    independent = sum(band.independent for band in bands)
    limit = np.inf
    for band in bands:
        if not band.edges[0] <= frequency / band.step < band.edges[-1]:
            continue
        near = band.near(frequency)
        m, sides = band.sizes[near].min(), near.stop - near.start
        ratio = optimize.brentq(
            lambda x, *of: over_band(one_frequency(x, *of), independent) - level,
            0.1,
            1e6,
            (m, sides),
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
    behind the time stamps, whose error scales all logged frequencies, r too. Nothing is named
    within a window of zero, where any slow line would be, nor where the window is wider than
    0.8 % of the band. The chance that a line lies in a window by accident is 3 % at 100 and 200 Hz,
    1 % at 1 kHz, below 10 % at any rate.

    Parameters
    ----------
    frequency, rate : float
        Hz. Where the rate is only nominal, a missing name says nothing.

    Returns
    -------
    str or None
        E.g. ``50 Hz mains, alias of its 2nd harmonic``; the lowest harmonic that fits, both mains
        where both do.
    """
    names = []
    for f0 in MAINS:
        for h, order in enumerate(ORDERS, 1):
            window = h * f0 * (WANDER + CLOCK)
            folded = abs(h * f0 - rate * round(h * f0 / rate))
            if window < min(frequency, rate / 250) and abs(frequency - folded) <= window:
                alias = ", alias" if h * f0 > rate / 2 else ""
                harmonic = f"{' of' if alias else ','} its {order} harmonic" if h > 1 else ""
                names.append(f"{f0:.0f} Hz mains{alias}{harmonic}")
                break
    return " or ".join(names) or None


def _summary(waves, rate, density, freedom):
    """Return frequency, amplitude and their intervals, averaged over the parts of a session."""
    variance = density * rate / 2
    t = special.stdtrit(freedom, 0.975)
    f, c, s, d_amplitude, d_frequency = np.array(
        [(w.frequency, w.cosine, w.sine, w.amplitude_std, w.frequency_std) for w in waves]
    ).T
    share = d_amplitude**-2 / np.sum(d_amplitude**-2)
    power = share * (c**2 + s**2)
    # each part beyond the first takes noise of its own
    noise = 2 * variance / np.sum(d_amplitude**-2)
    # a mean square less the noise in it, of which chance may leave nothing
    amplitude = np.sqrt(max(power.sum() - (len(waves) - 1) * noise, 0.0))
    power /= power.sum()
    frequency = power @ f
    a_error = t * np.sqrt(noise / 2)
    f_error = t * np.sqrt(variance * np.sum((power * d_frequency) ** 2))
    if len(waves) > 1:
        scatter = np.sum(power**2 * (f - frequency) ** 2) * len(waves) / (len(waves) - 1)
        f_error = max(f_error, special.stdtrit(len(waves) - 1, 0.975) * np.sqrt(scatter))
    # neither is below zero
    return (
        float(frequency),
        (float(max(frequency - f_error, 0.0)), float(frequency + f_error)),
        float(amplitude),
        (float(max(amplitude - a_error, 0.0)), float(amplitude + a_error)),
    )
