"""Lines of one axis: found, measured, removed, named."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.noise_model import Coefficient
from imuloop.noise.periodogram import SHORTEST, Periodogram, chance_over_band
from imuloop.noise.sinusoids import FittedSinusoid, fit_sinusoid

# relative difference of the clocks of two power cycles, within which a line is the same
SAME_CLOCK = 1e-4
# mains, Hz; relative wander (50 mHz) and error of the clock behind the time stamps
MAINS, ORDERS = (50.0, 60.0), ("1st", "2nd", "3rd", "4th", "5th")
WANDER, CLOCK = 1e-3, 2e-4
# share of its frequency within which a line that wandered leaves others
NEAR = 0.02


@dataclass(frozen=True)
class Line:
    """Sinusoid of one axis.

    Frequency in Hz, and amplitude, SI of the axis, in the signal where it stands out most, too low
    if it wanders there; the sinusoid of each signal that shows it, which is what is removed.
    """

    frequency: Coefficient
    amplitude: Coefficient
    sinusoids: tuple[FittedSinusoid, ...]

    def subtract(self, signals):
        """Return the Signals without the line; those that do not show it are returned unchanged."""
        signals = list(signals)
        for each in self.sinusoids:
            signals[each.signal] = each.subtract(signals[each.signal])
        return signals

    def explains(self, line, span):
        """Return whether a later line is a remainder of this one, which wandered.

        It is then within 1/`span`, the length of the longest record in s, or within `NEAR`.
        """
        frequency = self.frequency.value
        return abs(frequency - line.frequency.value) <= max(1 / span, NEAR * frequency)


def find_line(signals, spectrum, level):
    """Return the most significant sinusoid; None if chance explains it.

    The largest ratio of the periodogram to the spectrum and its local background, see
    `Periodogram`, is a line where the chance of it is below the level. Signals are tested one by
    one and their independent frequencies W add: the clocks of two sessions differ by more than the
    width 1/T of a line, so that powers at one frequency do not.

    Takes the Signals of an axis, SI, the one-sided density of the noise, SI^2/Hz, as a function of
    frequency in Hz, and the chance of finding a line in noise that has none. None also where no
    signal is long enough.

    References
    ----------
    Intervals: D. C. Rife and R. R. Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591.
    """
    each = {i: Periodogram.of(signal, spectrum) for i, signal in enumerate(signals)}
    each = {i: periodogram for i, periodogram in each.items() if periodogram}
    if not each:
        return None
    independent = sum(periodogram.independent for periodogram in each.values())
    peaks = {i: periodogram.strongest(level) for i, periodogram in each.items()}
    best = min(peaks, key=lambda i: peaks[i][0])
    if chance_over_band(peaks[best][0], independent) > level:
        return None
    strongest, own = fit_sinusoid(signals[best], peaks[best][1], best), each.pop(best)
    if chance_over_band(own.chance(strongest), independent) > level:
        return None
    sinusoids, frequency = [strongest], strongest.frequency
    for i, periodogram in each.items():
        span = signals[i].span
        reach = 1 / signals[best].span + 1 / span + SAME_CLOCK * frequency
        if frequency * span >= SHORTEST:
            sinusoid = fit_sinusoid(signals[i], periodogram.near(frequency, reach), i)
            if chance_over_band(periodogram.chance(sinusoid), 2 * reach * span) <= level:
                sinusoids.append(sinusoid)
    error = np.sqrt(own.variance(frequency))
    amplitude = float(np.hypot(strongest.cosine, strongest.sine))
    return Line(
        Coefficient.of(frequency, error * strongest.frequency_std),
        Coefficient.of(amplitude, error * strongest.amplitude_std),
        tuple(sinusoids),
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
