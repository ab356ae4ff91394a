"""The choice of a low-pass filter from the spectrum of an axis.

Nearly every inertial sensor filters its output. White noise then falls towards half the sampling
rate, and N is the density in front of the filter.
"""

from dataclasses import replace
from functools import partial
from math import sqrt

import numpy as np

from imuloop.core.noise_model import DEGREES, Coefficient, LowPassTerm
from imuloop.noise.gains import GAINS, LowPass, density
from imuloop.noise.likelihood import likeliest
from imuloop.noise.processes import NAMES
from imuloop.noise.selection import correlation_times

# corners that are tried, and the highest, share of the rate
CORNERS, HIGHEST = np.geomspace(0.01, 0.48, 12), 0.495
# shifts of the logarithm of a corner: for a derivative, and to the ends of the last search
SHIFT, REACH = 1e-3, 0.2
# log-likelihood that a parameter has to gain: half a chi-square of one degree at 0.002
PRICE = 4.8
# rise of the log-likelihood at which the fits end that compare filters and corners
ROUGH = 0.01


def choose_low_pass(selection):
    """Return the Selection with the likeliest low-pass filter, or unchanged if none is needed.

    `selection` is the Selection: the likelihood of one axis, and the choice of its noise terms. A
    filter and a Gauss-Markov process may have similar spectra. So that neither is taken for the
    other, models are compared, and each parameter of a model has to raise the log-likelihood by
    `PRICE`. A filter has two parameters (kind and corner), or three with a floor; a process has
    two, and any other term one. A filter also has to pass `_filters_white`.
    """
    modes, ramp = selection.likelihood, selection.fit((*NAMES, "R")).ramp
    # the fitted ramp is subtracted first, so that no fit of a filter has to fit it again
    level = replace(selection, likelihood=replace(modes, slow=modes.slow - ramp * modes.rho))
    unfiltered = level.fit(NAMES)
    start = np.append(unfiltered.theta, 0.0)
    rough_fit = partial(_fit, level, start=start, close=ROUGH)
    values = {kind: [rough_fit(kind, corner)[0] for corner in CORNERS] for kind in GAINS}
    # a filter has at least two parameters, and each has to gain `PRICE`
    if max(map(max, values.values())) - unfiltered.value < 2 * PRICE:
        return selection
    fits = [_fit_corner(level, kind, CORNERS[np.argmax(v)]) for kind, v in values.items()]
    # a filter by resampling has to be more likely by `PRICE`: a record that is too short to tell
    # gets a simpler filter
    low_pass = max(fits, key=lambda fit: fit[0] - PRICE * (fit[1].kind in DEGREES))[1]
    filtered = replace(selection, low_pass=low_pass)
    better = _score(filtered) > _score(selection) and _filters_white(filtered)
    return filtered if better else selection


def _fit(selection, kind, corner, **options):
    """Return the log-likelihood of four noise terms behind a low-pass filter, and the LowPass.

    The terms are quantisation Q, white noise N, flicker B and random walk K. The LowPass is the
    filter with its fitted floor. The floor is the share of the power of white noise that enters
    behind the filter.

    Parameters
    ----------
    selection : Selection
        The likelihood of the axis, without a filter.
    kind : str
        Kind of the filter, a key of `GAINS`.
    corner : float
        Corner of the filter, a share of the sampling rate.
    **options
        Options of `Likelihood.fit`. `start`, (5,), has variances near the maximum: of Q, N, B, K
        and of the white noise behind the filter. The fit ends when the log-likelihood grows by less
        than `close`.
    """
    low_pass = LowPass(kind, float(corner))
    units = replace(selection, low_pass=low_pass).units(NAMES)
    units = np.column_stack([units, selection.unit("N")])
    fit = selection.likelihood.fit(units, **options)
    white, behind = fit.theta[NAMES.index("N")], fit.theta[-1]
    floor = float(behind / (white + behind)) if behind else 0.0
    return fit.value, replace(low_pass, floor=floor)


def _fit_corner(selection, kind, near):
    """Return the log-likelihood and the LowPass of a filter at the likeliest corner near `near`.

    The corner is the frequency at which the power gain is a half, a share of the sampling rate, as
    is `near`. `selection` is the likelihood of the axis, and `kind` the kind of the filter, a key
    of `GAINS`.
    """
    step = CORNERS[1] / CORNERS[0]
    ends = near / step, min(near * step, HIGHEST)
    corner = likeliest(lambda corner: _fit(selection, kind, corner)[0], *ends, close=3e-4)
    return _fit(selection, kind, corner)


def _score(selection):
    """Return the log-likelihood of a Selection, `selection`, less `PRICE` for each parameter.

    By this score a Selection with a filter is compared with one without. The parameters are those
    of the supported terms and of the low-pass filter, if there is one.
    """
    terms, low_pass = selection.supported, selection.low_pass
    parameters = len(terms) + len(correlation_times(terms))
    if low_pass:
        parameters += 3 if low_pass.floor else 2
    return selection.fit(terms).value - PRICE * parameters


def _filters_white(filtered):
    """Return whether white noise is most of the noise power at the corner of a filter.

    Only then can the spectrum show the filter. The powers are those in front of the filter.
    `filtered` is a Selection with the filter and its noise terms. The result is also false if the
    corner is below the lowest of `CORNERS`.
    """
    noise, corner = filtered.noise(filtered.supported), filtered.low_pass.corner
    slow, rate = replace(noise, Q=Coefficient(), N=Coefficient()), 1 / filtered.modes.dt
    return corner >= CORNERS[0] and density(slow, corner * rate, rate) < 2 * noise.N.square


def leakage_weights(filtered):
    """Return the weight of each row of a spectrum behind a low-pass filter, (r,), 0 to 1.

    A row is a frequency or a band of frequencies (`Modes`). Where the filter leaves next to no
    power, most of this power is leakage: power of lower frequencies that appears here because each
    block of samples has abrupt ends. The squared amplitudes in these rows are correlated, so that
    they tell less than their number suggests. The weight allows for that. It is the square of the
    share of the power that is not leakage. `filtered` is the Selection with the filter.
    """
    modes, low_pass = filtered.modes, filtered.low_pass
    gain = low_pass.gain(modes.frequency * modes.dt)
    return np.minimum(gain / modes.gain(low_pass), 1.0) ** 2


def likeliest_corner(filtered, terms):
    """Return a Selection with its filter at the likeliest corner, the LowPassTerm, and a factor.

    There are three results. The first is `filtered` with its filter at the likeliest corner. The
    second is the LowPassTerm, which has this corner with its interval, by the information matrix.
    The third is the factor by which the interval of the white noise coefficient N has to be
    widened: the standard error of N over the one that N would have if the corner were known
    exactly.

    `filtered` is a Selection, the likelihood of one axis, with a low-pass filter whose corner is
    near the likeliest one. `terms` are its supported noise terms, N among them.
    """

    def behind(corner):
        """Return `filtered` with its filter at another `corner`, a share of the sampling rate."""
        return replace(filtered, low_pass=replace(filtered.low_pass, corner=corner))

    near = filtered.low_pass.corner
    ends = near * np.exp(-REACH), min(near * np.exp(REACH), HIGHEST)
    corner = likeliest(lambda corner: behind(corner).fit(terms).value, *ends, close=1e-4)
    best = behind(corner)
    units, theta = best.units(terms), best.fit(terms).theta
    change = (units - behind(corner * np.exp(-SHIFT)).units(terms)) @ theta / SHIFT
    known_corner = best.likelihood.covariance(units, units @ theta)
    any_corner = best.likelihood.covariance(np.column_stack([units, change]), units @ theta)
    hertz, n = corner / best.modes.dt, terms.index("N")
    coefficient = Coefficient.of(hertz, hertz * sqrt(any_corner[-1, -1]))
    term = LowPassTerm(best.low_pass.kind, coefficient, best.low_pass.floor)
    return best, term, sqrt(any_corner[n, n] / known_corner[n, n])
