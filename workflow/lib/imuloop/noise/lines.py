"""Lines of one axis: found, measured, removed, named."""

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from imuloop.noise.periodogram import SHORTEST, Periodogram, chance_over_band
from imuloop.noise.sampling import Sampling
from imuloop.noise.sinusoids import FittedSinusoid, fit_sinusoid, follow, strongest_frequency

# relative difference of the clocks of two sessions, within which a line is the same
SAME_CLOCK = 1e-4
# mains, Hz; relative wander (50 mHz) and error of the clock behind the time stamps
MAINS, ORDERS = (50.0, 60.0), ("1st", "2nd", "3rd", "4th", "5th")
WANDER, CLOCK = 1e-3, 2e-4


@dataclass(frozen=True)
class Line:
    """Sinusoid of one axis.

    Frequency in Hz, and amplitude, SI of the axis, in the session where it stands out most, with
    95 % intervals. `parts` are what is removed: more than one a session where frequency, phase or
    amplitude wander; then `frequency` is the mean weighted with the power and `amplitude` the root
    mean square, low by what the line wanders within a part.
    """

    frequency: float
    frequency_ci95: tuple[float, float]
    amplitude: float
    amplitude_ci95: tuple[float, float]
    parts: tuple[FittedSinusoid, ...]

    def subtract(self, samplings, values):
        """Return the values without the line; sessions that do not show it are not copied."""
        shown = {part.session for part in self.parts}
        result = [
            [np.array(x, float) if i in shown else x for x in stretches]
            for i, stretches in enumerate(values)
        ]
        for part in self.parts:
            part.subtract(samplings[part.session], result[part.session])
        return result

    def left(self, line, rate):
        """Return whether a later line is what this one left: within 1/T of a part of time T."""
        beside = {
            part.session
            for part in self.parts
            if abs(part.frequency - line.frequency) * (part.end - part.begin) <= rate
        }
        return beside.issuperset(part.session for part in line.parts)


def means(samplings, values, size):
    """Return samplings and values of the means of `size` samples: slow lines at no cost."""
    samplings_of_means, values_of_means = [], []
    for sampling, stretches in zip(samplings, values, strict=True):
        kept = [i for i, n in enumerate(sampling.lengths) if n >= size]
        if not kept:
            continue
        blocks = [stretches[i][: sampling.lengths[i] // size * size] for i in kept]
        values_of_means.append([x.reshape(-1, size).mean(axis=1) for x in blocks])
        starts, lengths = (
            tuple(of[i] // size for i in kept) for of in (sampling.starts, sampling.lengths)
        )
        levels = tuple(sampling.levels[i] for i in kept)
        samplings_of_means.append(Sampling(sampling.rate / size, starts, lengths, levels))
    return samplings_of_means, values_of_means


def find_line(samplings, values, spectrum, level):
    """Return the sinusoid that stands out most from the noise, if chance does not explain it.

    The largest ratio of the periodogram to the spectrum and its local background, see
    `Periodogram`, is a line where the chance of it is below the level. A line that wanders is one
    line: where the halves of the record, each with a frequency, phase and amplitude of its own,
    explain more than the whole and chance, it is followed through them. Sessions are tested one by
    one and their independent frequencies W add: the clocks of two sessions differ by more than the
    width 1/T of a line, so that powers at one frequency do not.

    Takes a Sampling per session, the samples of each stretch of each, SI, the one-sided density of
    the noise, SI^2/Hz, as a function of frequency in Hz, and the chance of finding a line in noise
    that has none. None also where no session is long enough.

    References
    ----------
    Intervals: D. C. Rife and R. R. Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591.
    """
    every = [Periodogram.of(*each, spectrum) for each in zip(samplings, values, strict=True)]
    live = {i: found for i, found in enumerate(every) if found is not None}
    if not live:
        return None
    peaks = {i: found.strongest() for i, found in live.items()}
    best = min(peaks, key=lambda i: peaks[i][0])
    independent = sum(found.band.independent for found in live.values())
    if chance_over_band(peaks[best][0], independent) > level:
        return None
    fitted = fit_sinusoid(samplings[best], values[best], peaks[best][1], best)
    if chance_over_band(live[best].chance(fitted), independent) > level:
        return None
    parts = {}
    for i, found in live.items():
        span, same = found.band.span, fitted
        if i != best:
            if fitted.frequency * span < SHORTEST:
                continue
            reach = 1 / live[best].band.span + 1 / span + SAME_CLOCK * fitted.frequency
            near = strongest_frequency(samplings[i], values[i], fitted.frequency, reach)
            same = fit_sinusoid(samplings[i], values[i], near, i)
            if chance_over_band(found.chance(same), 2 * reach * span) > level:
                continue
        density, _ = found.density(same.frequency)
        parts[i] = follow(samplings[i], values[i], same, density)
    return Line(
        *_summary(parts[best], samplings[best].rate, *live[best].density(fitted.frequency)),
        parts=tuple(each for i in sorted(parts) for each in parts[i]),
    )


def mains(frequency, rate):
    """Return which mains harmonic lies at a frequency, itself or folded by the sampling, or None.

    E.g. ``50 Hz mains, alias of its 2nd harmonic``; the lowest harmonic that fits, both mains where
    both do. A harmonic h of :math:`f_0` appears at :math:`|h f_0 - k r|`. The window to either side
    is 1.2 per mille of :math:`h f_0`: 50 mHz of 50 Hz for mains' own wander, and 200 ppm for the
    clock behind the time stamps, whose error scales all logged frequencies, r too. Nothing is named
    within a window of zero, where any slow line would be, nor where the window is wider than 0.8 %
    of the band. The chance that a line lies in a window by accident is 3 % at 100 and 200 Hz, 1 %
    at 1 kHz, below 10 % at any rate.
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


def _summary(parts, rate, density, freedom):
    """Return frequency, amplitude and their intervals, averaged over the parts of a session."""
    variance = density * rate / 2
    t = stdtrit(freedom, 0.975)
    f, c, s, d_amplitude, d_frequency = np.array(
        [(p.frequency, p.cosine, p.sine, p.amplitude_std, p.frequency_std) for p in parts]
    ).T
    share = d_amplitude**-2 / np.sum(d_amplitude**-2)
    power = share * (c**2 + s**2)
    # each part beyond the first takes noise of its own
    noise = 2 * variance / np.sum(d_amplitude**-2)
    # a mean square less the noise in it, of which chance may leave nothing
    amplitude = np.sqrt(max(power.sum() - (len(parts) - 1) * noise, 0.0))
    power /= power.sum()
    frequency = power @ f
    a_error = t * np.sqrt(noise / 2)
    f_error = t * np.sqrt(variance * np.sum((power * d_frequency) ** 2))
    if len(parts) > 1:
        scatter = np.sum(power**2 * (f - frequency) ** 2) * len(parts) / (len(parts) - 1)
        f_error = max(f_error, stdtrit(len(parts) - 1, 0.975) * np.sqrt(scatter))
    # neither is below zero
    return (
        float(frequency),
        (float(max(frequency - f_error, 0.0)), float(frequency + f_error)),
        float(amplitude),
        (float(max(amplitude - a_error, 0.0)), float(amplitude + a_error)),
    )
