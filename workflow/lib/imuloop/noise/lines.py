"""Lines of one axis: how they are found, measured, subtracted and named."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.noise_model import Coefficient
from imuloop.noise.periodogram import SHORTEST, Periodogram, chance_at_one, chance_over_band
from imuloop.noise.sinusoids import fit_sinusoid

# largest relative difference of the clocks, and so of the frequency of a line, in two power cycles
SAME_CLOCK = 1e-4
# mains, Hz, and names of the harmonics
MAINS, ORDERS = (50.0, 60.0), ("1st", "2nd", "3rd", "4th", "5th")
# relative wander of mains (50 mHz), and relative error of the clock behind the time stamps
WANDER, CLOCK = 1e-3, 2e-4


@dataclass(frozen=True)
class Line:
    """A line in the spectrum of one axis: a sinusoid in its output.

    `frequency`, Hz, and `amplitude`, SI, come from the power cycle in which the line stands out
    most. The amplitude is too low if the frequency wanders. `sinusoids` has the FittedSinusoid of
    each power cycle that shows the line, by the index of its Signal.
    """

    frequency: Coefficient
    amplitude: Coefficient
    sinusoids: dict

    def subtract(self, signals):
        """Return the Signals without the line, a list; a signal that does not show it is unchanged.

        `signals` are those in which the line was found, in the same order.
        """
        fits = self.sinusoids
        return [fits[i].subtract(s) if i in fits else s for i, s in enumerate(signals)]


def find_line(signals, spectrum, level):
    """Return the most significant Line, a sinusoid, of an axis; None if noise explains all peaks.

    The height of a peak is the periodogram of a power cycle over its local background
    (`Periodogram`). The highest peak of all power cycles is a line if noise alone would reach its
    height with a probability of at most `level`. This probability is for any frequency of any power
    cycle. The powers of the cycles are not added, because the clocks of two sessions differ by more
    than the width of a line. Another power cycle shows the same line if its highest peak near the
    frequency of the line passes the same test, where the probability is for any of the near
    frequencies.

    Parameters
    ----------
    signals : sequence of Signal
        Values of the axis in each power cycle, SI.
    spectrum : callable
        One-sided density of the noise, SI^2/Hz, as a function of frequency in Hz.
    level : float
        Probability of finding a line in noise that has none.

    Returns
    -------
    Line or None
        The line, with the standard errors of its frequency and amplitude. None also if no signal is
        long enough.

    References
    ----------
    Intervals: D. C. Rife and R. R. Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591.
    """
    peak, best, periodograms = strongest_peak(signals, spectrum, level)
    if peak is None:
        return None
    strongest = fit_sinusoid(signals[best], peak)
    if _chance_anywhere(periodograms, periodograms[best].chance(strongest)) > level:
        return None
    sinusoids, frequency = {best: strongest}, strongest.frequency
    for i in periodograms.keys() - {best}:
        span = signals[i].span
        # largest distance from the frequency of the same line in the other signal: the widths of
        # both peaks, and the difference of the two clocks
        reach = 1 / signals[best].span + 1 / span + SAME_CLOCK * frequency
        if frequency * span >= SHORTEST:
            _, peak = periodograms[i].highest(frequency - reach, frequency + reach)
            sinusoid = fit_sinusoid(signals[i], peak)
            if chance_over_band(periodograms[i].chance(sinusoid), 2 * reach * span) <= level:
                sinusoids[i] = sinusoid
    # the standard errors of a sinusoid are for white noise of variance 1: `error` is the standard
    # deviation of white noise that has the density of the noise at this frequency
    error = np.sqrt(periodograms[best].noise(frequency)[0])
    return Line(
        Coefficient.of(frequency, error * strongest.frequency_std),
        Coefficient.of(np.hypot(*strongest.amplitudes), error * strongest.amplitude_std),
        sinusoids,
    )


def strongest_peak(signals, spectrum, level):
    """Return the frequency and signal of the highest peak of an axis, and all Periodograms.

    Parameters
    ----------
    signals : sequence of Signal
        Values of the axis in each power cycle, SI.
    spectrum : callable
        One-sided density of the noise, SI^2/Hz, as a function of frequency in Hz.
    level : float
        The peak counts only if noise alone would reach its height, at any frequency of any signal,
        with at most this probability.

    Returns
    -------
    frequency : float or None
        Frequency of the peak, Hz; None if the probability of such a peak in noise is above `level`,
        or all signals are too short.
    index : int or None
        Index of the signal with the peak; None if all signals are too short.
    periodograms : dict of int to Periodogram
        Periodograms by the index of the signal; signals that are too short are left out.
    """
    all_signals = {i: Periodogram.of(signal, spectrum) for i, signal in enumerate(signals)}
    periodograms = {i: periodogram for i, periodogram in all_signals.items() if periodogram}
    if not periodograms:
        return None, None, {}
    height, frequency, best = max((*p.highest(), i) for i, p in periodograms.items())
    # the true peak may lie between two frequencies of the padded transform, and is then higher than
    # the height there by up to 1/sinc^2(1/4) = 1/0.81
    chance = chance_at_one(height / 0.81, periodograms[best].noise(frequency)[1])
    rare = _chance_anywhere(periodograms, chance) <= level
    return frequency if rare else None, best, periodograms


def _chance_anywhere(periodograms, chance):
    """Return the probability that noise has a peak of a given height anywhere in any signal.

    `chance` is the probability of such a peak at a single frequency, and `periodograms` is a dict
    of the Periodograms of all signals.
    """
    return chance_over_band(chance, sum(p.independent for p in periodograms.values()))


def mains(frequency, rate):
    """Return the name of the harmonic of mains that a line may be, or None if no harmonic fits.

    A line is a sinusoid in the output of a sensor. An example of a name is ``50 Hz mains, alias of
    its 2nd harmonic``. `frequency` is the frequency of the line, Hz, and `rate` the sampling rate,
    Hz. The lowest harmonic of the 50 Hz or the 60 Hz mains that fits is named; if both mains fit,
    both are named.

    With mains of :math:`f_0`, the harmonic h appears at :math:`|h f_0 - k r|`, where k is a whole
    number and r the rate. A line fits the harmonic if it lies there within 1.2 per mille of
    :math:`h f_0` to either side. Of this tolerance, 1 per mille is for the wander of mains, and 200
    ppm for the error of the clock behind the time stamps, which scales all logged frequencies.
    There are two exceptions. A line whose frequency is at most this tolerance is not named, since
    any slow line would fit. And a harmonic is not considered if its tolerance is 0.4 % of the
    sampling rate or more, since then many lines would fit by chance. A line at a random frequency
    is named with a probability of 3 % at 100 and 200 Hz, 1 % at 1 kHz, and below 10 % at any rate.
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
