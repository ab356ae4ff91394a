"""The noise of one axis: terms, humps and lines of its clean stretches."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient, LowPassTerm, SinusoidTerm
from imuloop.noise.intervals import coefficients_with_intervals
from imuloop.noise.likelihood import Likelihood
from imuloop.noise.lines import find_line, mains
from imuloop.noise.low_pass import choose_low_pass, leakage_weights, likeliest_corner
from imuloop.noise.misfit import misfit
from imuloop.noise.processes import density
from imuloop.noise.selection import Selection

# lines at most, with what they leave
LINES = 8
# digits of the output that a line which was taken out leaves right, share of the largest value
DIGITS = 1e-12
# fewer values cannot carry five terms and a test of the misfit
MIN_VALUES = 16


@dataclass(frozen=True)
class AxisEstimate:
    """Result of `estimate_axis`: the coefficients, tested, with intervals or limits.

    `misfit` is the largest relative standard deviation by which the spectrum leaves the terms
    beyond chance over half a decade, 0 where chance is enough; it is part of all intervals.
    """

    noise: AxisNoise
    misfit: float


def estimate_axis(basis, signals, settings):
    """Return the AxisEstimate of one axis, without any term of under 16 values.

    Lines are found and taken out (`find_lines`). Then a low-pass filter is chosen, if the spectrum
    shows one, and the terms in front of it (`Selection`). Where the spectrum leaves them beyond
    chance, frequencies that hold many values count less, and the terms are chosen once more.

    Takes Modes, the axis' Signals that these are of, SI, not all constant, and NoiseSettings.
    """
    if basis.count.sum() < MIN_VALUES:
        return AxisEstimate(AxisNoise(), 0.0)
    lines, selection = find_lines(basis, signals, settings)
    low_pass, wider, term = choose_low_pass(selection), 1.0, None
    selection = selection.filtered(low_pass)
    terms = selection.supported
    if low_pass:
        selection, terms = _weighted(selection, leakage_weights(basis, low_pass), terms)
    size, weight = misfit(selection, terms)
    if size:
        selection, terms = _weighted(selection, weight, terms)
    if low_pass:
        low_pass, error, wider = likeliest_corner(selection, low_pass, terms)
        selection = selection.filtered(low_pass)
        corner = low_pass.corner / basis.dt
        term = LowPassTerm(low_pass.kind, Coefficient.of(corner, corner * error), low_pass.floor)
    sinusoid = tuple(
        SinusoidTerm(line.amplitude, line.frequency, mains(line.frequency.value, 1 / basis.dt))
        for line in lines
    )
    noise = coefficients_with_intervals(selection, terms, wider)
    return AxisEstimate(replace(noise, sinusoid=sinusoid, low_pass=term), size)


def _weighted(selection, weight, terms):
    """Return a Selection with less weight of some rows, and its terms.

    The terms stay if white noise, which a filter is known by, would go.
    """
    selection = selection.weighted(selection.likelihood.count * weight)
    kept = np.ndim(selection.gain) and "N" not in selection.supported
    return selection, terms if kept else selection.supported


def find_lines(basis, signals, settings):
    """Return the lines, and the Selection of what remains; arguments as in `estimate_axis`.

    Lines are found and taken out one by one, each against the noise fitted beside those before.
    What remains of one that wandered is taken out too, but is no line.
    """
    lines, digits = [], (DIGITS * max(abs(signal.values).max() for signal in signals)) ** 2
    while True:
        likelihood = Likelihood(*basis.amplitudes(signals), basis.count, basis.ramp, digits)
        selection = Selection(basis, likelihood, settings.significance)
        if len(lines) == LINES:
            break
        power = likelihood.power(selection.fit(selection.supported).ramp)
        if (power <= likelihood.floor).all():
            # nothing but rounding is left
            break
        line = find_line(signals, _density(selection), settings.significance)
        line = line or _slow_line(signals, selection)
        if line is None:
            break
        lines.append(line)
        signals = line.subtract(signals)
    true = [
        line
        for i, line in enumerate(lines)
        if not any(before.explains(line, basis.span) for before in lines[:i])
    ]
    return true, selection


def _slow_line(signals, selection):
    """Return a line of few periods that the fitted terms hold for noise, or None.

    What stands out from its neighbours alone is kept from the fit of the terms, and is a line if it
    then stands out from these. It is sought in the means of the blocks: a faster line is one mode
    among many, too narrow for any term to follow.
    """
    basis, level = selection.modes, selection.level
    slow = [means for signal in signals if (means := signal.closed_up().means(basis.m))]
    flat = basis.dt * np.mean(selection.likelihood.power())
    line = find_line(slow, lambda f: np.full_like(f, flat), level)
    if line is None:
        return None
    width = 1 / basis.span
    apart = abs(basis.frequency - line.frequency.value) > width
    spectrum = _density(selection.weighted(selection.likelihood.count * apart))
    # the means tell in no time whether the whole record is worth another look
    return find_line(slow, spectrum, level) and find_line(signals, spectrum, level)


def _density(selection):
    """Return the one-sided density of the supported terms as a function of frequency, SI^2/Hz."""
    dt, squares = selection.modes.dt, selection.squares(selection.supported)
    # white noise of the size of rounding
    lowest = selection.likelihood.floor * dt
    return lambda frequency: 2 * np.maximum(density(frequency, dt, squares), lowest)
