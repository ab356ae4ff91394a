"""The noise of one axis: terms, humps and lines of its clean stretches."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient, SinusoidTerm
from imuloop.noise.intervals import axis_noise
from imuloop.noise.likelihood import Likelihood
from imuloop.noise.lines import find_line, mains
from imuloop.noise.misfit import band, groups, misfit, weights
from imuloop.noise.modes import modes
from imuloop.noise.processes import NAMES, densities, gauss_markov_density
from imuloop.noise.record_length import record_seconds
from imuloop.noise.sampling import Sampling
from imuloop.noise.selection import ORDER, Selection, correlation_times

# lines at most, with what they leave
LINES = 8
# digits of the output that a line which was taken out leaves right, share of the largest value
DIGITS = 1e-12
# ends of a normal interval, standard errors
TWO_SIDED, ONE_SIDED = 1.959964, 1.644854
# fewer values cannot carry five terms and a test of the misfit
MIN_VALUES = 16


@dataclass(frozen=True)
class AxisEstimate:
    """Result of `estimate_axis`: the coefficients, tested, with intervals or limits.

    `misfit` is the largest relative standard deviation by which the spectrum leaves the terms
    beyond chance over half a decade, 0 where chance is enough; it is part of all intervals.
    `band_hz` is the highest frequency that counts, below half the rate where a filter took power.
    """

    noise: AxisNoise
    misfit: float
    band_hz: float


def estimate_record(x, rate, settings):
    """Return the AxisEstimate of one unbroken record `x`, shape (n,), of `rate` in Hz."""
    run = Sampling.unbroken(rate, len(x)).with_values(np.asarray(x, float))
    return estimate_axis(modes([run]), [run], settings)


def estimate_axis(basis, runs, settings):
    """Return the AxisEstimate of one axis, without any term of under 16 values.

    Lines are found and taken out (`find_lines`). Then octaves at the top that a filter has emptied
    are left out, and the terms are chosen (`Selection`). Where the spectrum leaves them beyond
    chance, frequencies that hold many values count less, and the terms are chosen once more.

    Takes Modes, the axis' Runs that these are of, SI, not all constant, and NoiseSettings.
    """
    if basis.count.sum() < MIN_VALUES:
        return AxisEstimate(AxisNoise(), 0.0, 0.5 / basis.dt)
    lines, selection = find_lines(basis, runs, settings)
    highest = _highest(selection)
    count = np.where(basis.frequency <= highest, basis.count, 0.0)
    number = groups(basis.frequency, basis.count)
    if highest < basis.frequency.max():
        selection = selection.weighted(count)
    terms = selection.supported
    fit = selection.fit(terms)
    power, expected = selection.likelihood.power(fit.ramp), selection.units(terms) @ fit.theta
    ratio = np.divide(*map(selection.likelihood.above_rounding, (power, expected)))
    epsilon = misfit(ratio, count, number, len(terms), settings.significance)
    if epsilon.any():
        selection = selection.weighted(count * weights(epsilon, count, number))
        terms = selection.supported
    noise = axis_noise(selection, terms)
    noise = replace(
        noise,
        **_with_lengths(noise, selection.squares(terms), basis.dt, settings.significance),
        sinusoid=tuple(_sinusoid(line, 1 / basis.dt) for line in lines),
    )
    return AxisEstimate(noise, float(epsilon.max()), highest)


def find_lines(basis, runs, settings):
    """Return the lines, and the Selection of what remains; arguments as of `estimate_axis`.

    Lines are found and taken out one by one, each against the noise fitted beside those before.
    What one before has left where it wandered is taken out too, but is no line.
    """
    lines, digits = [], (DIGITS * max(abs(run.values).max() for run in runs)) ** 2
    while True:
        likelihood = Likelihood(*basis.amplitudes(runs), basis.count, basis.ramp, digits)
        selection = Selection(basis, likelihood, settings.significance)
        if len(lines) == LINES:
            break
        if likelihood.is_rounding(selection.fit(selection.supported).ramp):
            break
        line = find_line(runs, _density(selection), settings.significance)
        line = line or _slow_line(runs, selection)
        if line is None:
            break
        lines.append(line)
        runs = line.subtract(runs)
    own = [
        line
        for i, line in enumerate(lines)
        if not any(before.explains(line, 1 / basis.dt) for before in lines[:i])
    ]
    return own, selection


def _slow_line(runs, selection):
    """Return a line of few periods that the fitted terms hold for noise, or None.

    What stands out from its neighbours alone is kept from the fit of the terms, and is a line if it
    then stands out from these. It is sought in the means of the blocks: a faster line is one mode
    among many, too narrow for any term to follow.
    """
    basis, level = selection.modes, selection.level
    slow = [means for run in runs if (means := run.closed_up().means(basis.m))]
    flat = basis.dt * np.mean(selection.likelihood.power())
    line = find_line(slow, lambda f: np.full_like(f, flat), level)
    if line is None:
        return None
    width = 1 / (basis.m * basis.dt * max(part.end - part.begin for part in line.parts))
    apart = abs(basis.frequency - line.frequency) > width
    density = _density(selection.weighted(selection.likelihood.count * apart))
    # the means tell in no time whether the whole record is worth another look
    found = find_line(slow, density, level)
    return found and find_line(runs, density, level)


def _density(selection):
    """Return the one-sided density of the supported terms as a function of frequency, SI^2/Hz."""
    dt, theta = selection.modes.dt, selection.squares(selection.supported)

    def density(frequency):
        total = densities(frequency, dt) @ [theta.get(name, 0.0) for name in NAMES]
        for tc in correlation_times(theta):
            total += theta[tc] * gauss_markov_density(frequency, dt, tc)
        # white noise of the size of rounding
        return 2 * np.maximum(total, selection.likelihood.floor * dt)

    return density


def _highest(selection):
    """Return the highest frequency of the band that no filter has touched, Hz."""
    basis, likelihood = selection.modes, selection.likelihood
    plain = selection.units(NAMES)

    def predict(rows):
        counted = selection.weighted(np.where(rows, likelihood.count, 0.0)).likelihood
        return likelihood.above_rounding(plain @ counted.fit(plain, True).theta)

    power = likelihood.above_rounding(likelihood.power())
    return band(basis.frequency, basis.count, power, predict)


def _with_lengths(noise, theta, dt, level):
    """Return the coefficients that are not supported, with the record that would show them."""
    squares = [theta.get(name, 0.0) for name in NAMES]
    processes = [(theta[tc], tc) for tc in correlation_times(theta)]
    lengths = {}
    for name in ORDER:
        c = getattr(noise, name)
        if not c.identifiable and c.upper95:
            seconds = record_seconds(name, c.upper95, squares, processes, dt, level)
            lengths[name] = replace(c, needed_s=seconds)
    return lengths


def _sinusoid(line, rate):
    """Return a line with its intervals, the one-sided limit from the same normal errors."""

    def coefficient(value, interval):
        upper = value + (interval[1] - value) * ONE_SIDED / TWO_SIDED
        return Coefficient(value, interval, upper, True)

    return SinusoidTerm(
        coefficient(line.amplitude, line.amplitude_ci95),
        coefficient(line.frequency, line.frequency_ci95),
        mains(line.frequency, rate),
    )
