"""The noise of one axis: terms, Gauss-Markov processes and lines of its clean stretches."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient, LowPassTerm, SinusoidTerm
from imuloop.noise.gains import density
from imuloop.noise.intervals import coefficients_with_intervals
from imuloop.noise.likelihood import Likelihood
from imuloop.noise.lines import find_line, mains
from imuloop.noise.low_pass import choose_low_pass, leakage_weights, likeliest_corner
from imuloop.noise.misfit import misfit
from imuloop.noise.selection import Selection

# lines at most, with what remains of those that wander
LINES = 8
# share of its frequency within which other lines are what remains of a line that wanders
NEAR = 0.02
# share of the largest value to which the output is right once a line was taken out
DIGITS = 1e-12
# fewer values cannot carry five terms and a test of the misfit
MIN_VALUES = 16


@dataclass(frozen=True)
class AxisEstimate:
    """Result of `estimate_axis`."""

    # coefficients, tested, with intervals or limits
    noise: AxisNoise = field(default_factory=AxisNoise)
    # largest relative standard deviation by which the spectrum leaves the terms beyond chance over
    # half a decade; 0 where chance explains all; it is part of all intervals
    misfit: float = 0.0


def estimate_axis(basis, signals, settings):
    """Return the AxisEstimate of one axis, without any term if there are under 16 values.

    Lines are found and taken out (`find_lines`). Then a low-pass filter is chosen, if the spectrum
    shows one, and the terms in front of it (`Selection`). Where the spectrum leaves them beyond
    chance, frequencies that hold many values count less, and the terms are chosen once more.

    Parameters
    ----------
    basis : Modes
        Modes of the signals.
    signals : list of Signal
        Values of the axis for each power cycle, SI, not all constant.
    settings : NoiseSettings
    """
    if basis.count.sum() < MIN_VALUES:
        return AxisEstimate()
    lines, selection = find_lines(basis, signals, settings)
    selection, wider, term = choose_low_pass(selection), 1.0, None
    terms = selection.supported
    if selection.low_pass:
        selection, terms = _weighted(selection, leakage_weights(selection), terms)
    size, weight = misfit(selection, terms)
    if size:
        selection, terms = _weighted(selection, weight, terms)
    if selection.low_pass:
        selection, error, wider = likeliest_corner(selection, terms)
        low_pass, corner = selection.low_pass, selection.low_pass.corner / basis.dt
        term = LowPassTerm(low_pass.kind, Coefficient.of(corner, corner * error), low_pass.floor)
    sinusoid = tuple(
        SinusoidTerm(line.amplitude, line.frequency, mains(line.frequency.value, 1 / basis.dt))
        for line in lines
    )
    noise = coefficients_with_intervals(selection, terms, wider)
    return AxisEstimate(replace(noise, sinusoid=sinusoid, low_pass=term), size)


def _weighted(selection, weight, terms):
    """Return a Selection in which rows have less weight, and its terms.

    `weight`, shape (r,), are factors of the weights. The terms stay as they are if white noise, by
    which a filter is known, would go.
    """
    selection = selection.weighted(selection.likelihood.count * weight)
    kept = selection.low_pass and "N" not in selection.supported
    return selection, terms if kept else selection.supported


def find_lines(basis, signals, settings):
    """Return the Lines of an axis, and the Selection of what remains without them.

    Lines are found and taken out one by one, each against the noise that is fitted to what remains.
    A line that wanders leaves others nearby. They are taken out too, but not returned.
    `estimate_axis` describes the arguments.
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
    """Return the most significant Line of Signals, or None.

    The fit of the terms may take a line of a few periods for noise. So a line that stands out from
    its neighbours alone is kept from the fit. It is a line if it then stands out from the terms. It
    is sought in the means of the blocks: a faster line is one mode among many, too narrow for any
    term to follow.
    """
    basis, likelihood, level = selection.modes, selection.likelihood, selection.level
    power = likelihood.power(selection.fit(selection.supported).ramp)
    if (power <= likelihood.floor).all():
        # nothing but rounding is left
        return None
    if line := find_line(signals, _density(selection), level):
        return line
    flat = basis.dt * np.mean(likelihood.power())
    slow = [means for signal in signals if (means := signal.closed_up().means(basis.m))]
    line = find_line(slow, lambda f: np.full_like(f, flat), level)
    if line is None:
        return None
    apart = abs(basis.frequency - line.frequency.value) > 1 / basis.span
    spectrum = _density(selection.weighted(likelihood.count * apart))
    return find_line(slow, spectrum, level) and find_line(signals, spectrum, level)


def _density(selection):
    """Return the one-sided density of the supported terms, SI^2/Hz, a function of frequency, Hz."""
    dt, noise = selection.modes.dt, selection.noise(selection.supported)
    # no less than that of rounding
    lowest = 2 * selection.likelihood.floor * dt
    return lambda frequency: np.maximum(density(noise, frequency, 1 / dt), lowest)
