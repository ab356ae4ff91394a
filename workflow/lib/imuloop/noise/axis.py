"""The noise of one axis: terms, Gauss-Markov processes and lines of its clean stretches."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.core.noise_model import AxisNoise, SinusoidTerm
from imuloop.noise.gains import density
from imuloop.noise.intervals import coefficients_with_intervals
from imuloop.noise.likelihood import Likelihood
from imuloop.noise.lines import find_line, mains, strongest_peak
from imuloop.noise.low_pass import choose_low_pass, leakage_weights, likeliest_corner
from imuloop.noise.misfit import misfit
from imuloop.noise.selection import Selection

# largest number of lines that are subtracted
LINES = 8
# a line that is nearer to an earlier line than this share of its frequency is the remains of one
# that wanders
NEAR = 0.02
# relative error of the output by rounding after a line was subtracted, share of the largest value
DIGITS = 1e-12
# fewest values that can determine five terms and a test of the misfit
MIN_VALUES = 16


@dataclass(frozen=True)
class AxisEstimate:
    """The noise of one axis, as estimated, and how well it fits the spectrum."""

    # coefficients of the terms that passed their test, with intervals, and limits of the others
    noise: AxisNoise = field(default_factory=AxisNoise)
    # largest significant misfit of the spectrum over half a decade, a relative standard deviation,
    # by which all intervals are widened; 0 if no misfit is significant
    misfit: float = 0.0


def estimate_axis(basis, signals, settings):
    """Return the AxisEstimate: the noise terms, the low-pass filter and the lines of one axis.

    A term is a noise process or a ramp, and a line is a sinusoid. With fewer than `MIN_VALUES`
    values, the estimate is empty. The steps are:

    1. Lines are found and subtracted (`find_lines`).
    2. The low-pass filter is chosen, if the spectrum shows one, and with it the noise terms
       (`Selection`). The terms describe the noise in front of the filter.
    3. Where the model does not fit the spectrum (`misfit`), the frequencies get smaller weights,
       and the terms are chosen again.

    Parameters
    ----------
    basis : Modes
        Modes of the signals: the basis in which their noise is described.
    signals : list of Signal
        Values of the axis in each power cycle, SI, not all constant.
    settings : NoiseSettings
        Significance level of all tests.
    """
    if basis.count.sum() < MIN_VALUES:
        return AxisEstimate()
    lines, selection = find_lines(basis, signals, settings)
    selection, low_pass, n_factor = choose_low_pass(selection), None, 1.0
    terms = selection.supported
    if selection.low_pass:
        selection, terms = _weighted(selection, leakage_weights(selection), terms)
    size, weight = misfit(selection, terms)
    if size:
        selection, terms = _weighted(selection, weight, terms)
    if selection.low_pass:
        selection, low_pass, n_factor = likeliest_corner(selection, terms)
    noise = coefficients_with_intervals(selection, terms, n_factor)
    sinusoid = tuple(
        SinusoidTerm(line.amplitude, line.frequency, mains(line.frequency.value, 1 / basis.dt))
        for line in lines
    )
    return AxisEstimate(replace(noise, sinusoid=sinusoid, low_pass=low_pass), size)


def _weighted(selection, weight, terms):
    """Return the Selection with smaller weights of its rows, and the noise terms it then supports.

    `selection` is the Selection of one axis: the likelihood of its noise, and the choice of the
    terms. A row is a frequency or a band of frequencies (`Modes`). `weight`, shape (r,), multiplies
    the weights of the r rows, and then the terms are selected again. `terms` are those that were
    selected before. The results are the Selection with the new weights, and the new terms.
    Exception: if the Selection has a low-pass filter and the new terms lack white noise, the old
    terms are returned, because the filter is known only from its effect on white noise.
    """
    selection = selection.weighted(weight)
    kept = selection.low_pass and "N" not in selection.supported
    return selection, terms if kept else selection.supported


def find_lines(basis, signals, settings):
    """Return the Lines of an axis, a list, and the Selection of its noise terms without the lines.

    A line is a sinusoid in the output. Lines are found one by one, and the Selection is made after
    they are subtracted. Each line is tested against the noise that is fitted to the signals without
    the lines that were found before. Exception: a line whose frequency wanders leaves further peaks
    nearby, which are subtracted as lines but are not in the list.

    Parameters
    ----------
    basis : Modes
        Modes of the signals: the basis in which their noise is described.
    signals : list of Signal
        Values of the axis in each power cycle, SI.
    settings : NoiseSettings
        Significance level of a line and of a noise term.
    """
    lines, digits = [], (DIGITS * max(abs(signal.values).max() for signal in signals)) ** 2
    while True:
        likelihood = Likelihood(*basis.amplitudes(signals), basis.count, basis.ramp, digits)
        selection = Selection(basis, likelihood, settings.significance)
        line = _strongest_line(signals, selection) if len(lines) < LINES else None
        if line is None:
            break
        lines.append(line)
        signals = line.subtract(signals)
    frequencies = np.array([line.frequency.value for line in lines])
    width = np.maximum(1 / basis.span, NEAR * frequencies)
    near = np.tril(np.abs(frequencies - frequencies[:, None]) <= width, -1).any(axis=1)
    return [line for line, remains in zip(lines, near, strict=True) if not remains], selection


def _strongest_line(signals, selection):
    """Return the most significant Line of an axis, or None if no line is significant.

    A line is a sinusoid in the output. `signals` are the Signals of the axis, SI, one for each
    power cycle. `selection` is the Selection of the noise terms that they support. First, peaks are
    compared with the spectrum of these terms. The power of a line that has few periods may have
    been fitted as noise, so that the line does not stand out. So there is a second search: the
    highest peak relative to a flat spectrum is found, the terms are fitted without the frequencies
    near this peak, and all peaks are compared with the spectrum of this fit.
    """
    basis, likelihood, level = selection.modes, selection.likelihood, selection.level
    power = likelihood.power(selection.fit(selection.supported).ramp)
    if (power <= likelihood.floor).all():
        # nothing but rounding is left
        return None
    if line := find_line(signals, _density(selection), level):
        return line
    flat = basis.dt * np.mean(likelihood.power())
    peak, *_ = strongest_peak(signals, lambda frequency: np.full_like(frequency, flat), level)
    if peak is None:
        return None
    apart = abs(basis.frequency - peak) > 1 / basis.span
    return find_line(signals, _density(selection.weighted(apart)), level)


def _density(selection):
    """Return the noise spectrum of one axis, by the supported terms of a Selection, as a function.

    `selection` is the Selection. The function takes frequencies, Hz, and returns the one-sided
    power spectral density, SI^2/Hz. It is that of the fitted terms, but at least the density that
    the rounding of numbers may cause.
    """
    dt, noise = selection.modes.dt, selection.noise(selection.supported)
    # no less than the density of rounding
    lowest = 2 * selection.likelihood.floor * dt
    return lambda frequency: np.maximum(density(noise, frequency, 1 / dt), lowest)
