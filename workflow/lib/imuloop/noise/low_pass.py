"""Which low-pass filter a spectrum shows.

Nearly every inertial sensor filters its output. White noise then falls towards half the sampling
rate, and N is the density in front of the filter.
"""

from dataclasses import replace
from functools import cache
from operator import itemgetter

import numpy as np
from scipy.optimize import minimize_scalar

from imuloop.noise.gains import DEGREES, LowPass
from imuloop.noise.processes import NAMES, density

# corners that are tried, share of the rate
CORNERS = np.geomspace(0.01, 0.48, 14)
# highest corner, share of the rate
HIGHEST = 0.495
# kinds that are tried at all corners, and those that are then tried near the best of these
KINDS = {
    "first order": ("first order",),
    "first order, sampled": ("first order, sampled",),
    "second order": ("second order", "second order, sampled"),
    "eighth order": ("fourth order", "eighth order"),
    "held or averaged": ("held or averaged", "interpolated"),
    "averaged three times": ("averaged three times",),
}
# shift of the logarithm of a corner by which a derivative is taken
SHIFT = 1e-3
# log-likelihood that a parameter has to gain: half a chi-square of one degree at 0.002
PRICE = 4.8


def choose_low_pass(selection):
    """Return the most likely LowPass of a spectrum; None where it needs none.

    Each parameter, of a filter (2, 3 with a floor) as of a process (2) or another term (1), has to
    gain `PRICE` in log-likelihood, so that a filter is not taken for a hump, and a hump not for a
    filter.
    """
    whole, none = selection.likelihood, np.zeros(0)
    power = whole.power(selection.fit((*NAMES, "R")).ramp)
    level = replace(selection, likelihood=replace(whole, slow=none, rho=none, fast=power))
    plain = level.fit(NAMES)
    start = np.append(plain.theta, 0.0)
    found = {kind: [_fit(level, kind, corner, start)[0] for corner in CORNERS] for kind in KINDS}
    if max(map(max, found.values())) - plain.value < 2 * PRICE:
        return None
    tops = [
        _likeliest(level, kind, CORNERS[np.argmax(found[first])])
        for first, kinds in KINDS.items()
        for kind in kinds
    ]
    fits = sorted(tops, key=itemgetter(0))[-3:]
    # a record that is too short to tell takes the simpler name
    low_pass = max(fits, key=lambda fit: fit[0] - PRICE * (fit[1].kind in DEGREES))[1]
    price = PRICE * (3 if low_pass.floor else 2)
    filtered = selection.filtered(low_pass)
    better = _score(filtered) - price > _score(selection)
    return low_pass if better and _is_seen(filtered, low_pass) else None


def _is_seen(filtered, low_pass):
    """Return whether white noise is most of the power in front of a filter, at its corner."""
    terms, corner = filtered.supported, low_pass.corner / filtered.modes.dt
    if "N" not in terms or low_pass.corner < CORNERS[0]:
        return False
    squares = filtered.squares(terms)
    slow = {term: square for term, square in squares.items() if term not in ("Q", "N")}
    return density(np.array([corner]), filtered.modes.dt, slow)[0] < squares["N"]


def leakage_weights(modes, low_pass):
    """Return the weight of each row, shape (r,), less than 1 where leakage is part of its power.

    Where a filter leaves next to nothing, the squares of a block are what leaks from lower
    frequencies by its ends: many values that are few independent ones.
    """
    density = low_pass.gain(np.minimum(modes.frequency * modes.dt, 0.5))
    return np.minimum(density / modes.gain(low_pass), 1.0) ** 2


def _fit(selection, kind, corner, start=None):
    """Return the log-likelihood of all terms behind a filter, and its LowPass."""
    low_pass = LowPass(kind, float(corner))
    units = selection.filtered(low_pass).units(NAMES)
    found = selection.likelihood.fit(np.column_stack([units, selection.unit("N")]), start=start)
    white, behind = found.theta[NAMES.index("N")], found.theta[-1]
    floor = float(behind / (white + behind)) if behind else 0.0
    return found.value, replace(low_pass, floor=floor)


def _likeliest(selection, kind, start):
    """Return the same at the likeliest corner, between those beside `start` in `CORNERS`."""
    step = CORNERS[1] / CORNERS[0]
    found = minimize_scalar(
        lambda u: -_fit(selection, kind, np.exp(u))[0],
        bounds=np.log([start / step, min(start * step, HIGHEST)]),
        method="bounded",
        options={"xatol": 3e-3},
    )
    return _fit(selection, kind, np.exp(found.x))


def likeliest_corner(selection, low_pass, terms):
    """Return a LowPass at the likeliest corner, with the errors by the information matrix.

    Takes a Selection behind the filter, and the supported terms.

    Returns
    -------
    low_pass : LowPass
    error : float
        Standard error of the logarithm of the corner.
    wider : float
        Standard error of N over that at a known corner.
    """

    @cache
    def behind(u):
        corner = min(float(np.exp(u)), HIGHEST)
        return selection.filtered(replace(low_pass, corner=corner))

    u = np.log(low_pass.corner)
    found = minimize_scalar(
        lambda x: -behind(x).fit(terms).value,
        bounds=(u - 0.2, u + 0.2),
        method="bounded",
        options={"xatol": 1e-4},
    )
    u, best = float(found.x), behind(float(found.x))
    units, theta = best.units(terms), best.fit(terms).theta
    change = (units - behind(u - SHIFT).units(terms)) @ theta / SHIFT
    known, free = (
        best.likelihood.covariance(each, units @ theta)
        for each in (units, np.column_stack([units, change]))
    )
    place, corner = terms.index("N"), min(float(np.exp(u)), HIGHEST)
    return (
        replace(low_pass, corner=corner),
        float(np.sqrt(free[-1, -1])),
        float(np.sqrt(free[place, place] / known[place, place])),
    )


def _score(selection):
    """Return the log-likelihood of the supported terms less the price of their parameters."""
    terms = selection.supported
    parameters = len(terms) + sum(not isinstance(term, str) for term in terms)
    return selection.fit(terms).value - PRICE * parameters
