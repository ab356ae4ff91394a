"""Lines of one axis: search, measurement, removal and names."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.noise_model import Coefficient
from imuloop.noise.periodogram import SHORTEST, Periodogram, chance_at_one, chance_over_band
from imuloop.noise.sinusoids import fit_sinusoid

# relative difference between the clocks of two power cycles within which a line is the same
SAME_CLOCK = 1e-4
# mains, Hz, and names of the harmonics
MAINS, ORDERS = (50.0, 60.0), ("1st", "2nd", "3rd", "4th", "5th")
# relative wander of mains (50 mHz), and relative error of the clock behind the time stamps
WANDER, CLOCK = 1e-3, 2e-4


@dataclass(frozen=True)
class Line:
    """A line in the spectrum of one axis.

    `frequency`, Hz, and `amplitude`, SI of the axis, are those in the signal where the line stands
    out most. The amplitude is too low if the line wanders. `sinusoids` holds the FittedSinusoid of
    each signal that shows the line, by the index of the signal.
    """

    frequency: Coefficient
    amplitude: Coefficient
    sinusoids: dict

    def subtract(self, signals):
        """Return the Signals without the line; those that do not show it are returned unchanged."""
        fits = self.sinusoids
        return [fits[i].subtract(s) if i in fits else s for i, s in enumerate(signals)]


def find_line(signals, spectrum, level):
    """Return the most significant Line; None if noise explains it.

    A line is the highest peak of a `Periodogram` over its background, if the chance of such a peak
    in noise is below the level. Each signal is tested alone, but the chance is that of such a peak
    at any independent frequency of any signal. Powers of two sessions do not add: their clocks
    differ by more than the width of a line.

    Parameters
    ----------
    signals : sequence of Signal
        Values of an axis, SI.
    spectrum : callable
        One-sided density of the noise, SI^2/Hz, as a function of frequency in Hz.
    level : float
        Chance of finding a line in noise that has none.

    Returns
    -------
    Line or None
        None also where no signal is long enough.

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
        # how far the frequency of the same line may be: widths of the peaks, and error of the
        # clocks
        reach = 1 / signals[best].span + 1 / span + SAME_CLOCK * frequency
        if frequency * span >= SHORTEST:
            _, peak = periodograms[i].highest(frequency - reach, frequency + reach)
            sinusoid = fit_sinusoid(signals[i], peak)
            if chance_over_band(periodograms[i].chance(sinusoid), 2 * reach * span) <= level:
                sinusoids[i] = sinusoid
    error = np.sqrt(periodograms[best].noise(frequency)[0])
    return Line(
        Coefficient.of(frequency, error * strongest.frequency_std),
        Coefficient.of(np.hypot(*strongest.amplitudes), error * strongest.amplitude_std),
        sinusoids,
    )


def strongest_peak(signals, spectrum, level):
    """Return the highest peak over the background, if its chance in noise is below the level.

    Returns the frequency of the peak in Hz, or None; the index of the signal with the peak; and the
    Periodograms by index of the signal. Signals that are too short are left out. Takes Signals of
    an axis; the density of the noise, SI^2/Hz, a function of frequency in Hz; and the level.
    """
    all_signals = {i: Periodogram.of(signal, spectrum) for i, signal in enumerate(signals)}
    periodograms = {i: periodogram for i, periodogram in all_signals.items() if periodogram}
    if not periodograms:
        return None, None, {}
    height, frequency, best = max((*p.highest(), i) for i, p in periodograms.items())
    # between two frequencies of the padded transform a peak is up to 1/sinc^2(1/4) higher
    chance = chance_at_one(height / 0.81, periodograms[best].noise(frequency)[1])
    rare = _chance_anywhere(periodograms, chance) <= level
    return frequency if rare else None, best, periodograms


def _chance_anywhere(periodograms, chance):
    """Return the chance of a peak anywhere in Periodograms, from the `chance` at one frequency."""
    return chance_over_band(chance, sum(p.independent for p in periodograms.values()))


def mains(frequency, rate):
    """Return the name of the mains harmonic at a frequency, Hz, or None if mains do not fit.

    An example is ``50 Hz mains, alias of its 2nd harmonic``. `rate` is the sampling rate, Hz. The
    name is the lowest harmonic that fits, of both mains where both fit. The harmonic h of
    :math:`f_0` appears at :math:`|h f_0 - k r|`, where k is a whole number and r the rate. The
    window to either side is 1.2 per mille of :math:`h f_0`: 1 per mille for the wander of mains,
    and 200 ppm for the clock behind the time stamps, whose error scales all logged frequencies.
    Nothing is named within a window of zero, where any slow line would be, nor where the window is
    wider than 0.8 % of the band. The chance that a line lies in a window by accident is 3 % at 100
    and 200 Hz, 1 % at 1 kHz, and below 10 % at any rate.
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
