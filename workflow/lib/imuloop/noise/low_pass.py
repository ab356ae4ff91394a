"""Which low-pass filter a spectrum shows.

Nearly every inertial sensor filters its output. White noise then falls towards half the sampling
rate, and N is the density in front of the filter.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import minimize_scalar

from imuloop.core.low_pass import DEGREES, LowPass
from imuloop.noise.likelihood import Likelihood
from imuloop.noise.modes import Modes
from imuloop.noise.processes import NAMES, density

# corners that are tried, share of the rate, and every so many of them at first
CORNERS, COARSE = np.geomspace(0.01, 0.48, 53), 4
# the likeliest corner is looked for within this factor of the best of these
STEP = 1.1
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
# bins a decade in which corners are tried
BINS = 24
# log-likelihood that a parameter has to gain: half a chi-square of one degree at 0.002
PRICE = 4.8


def choose_low_pass(selection):
    """Return the most likely LowPass of a spectrum; None where it needs none.

    Each parameter, of a filter (2, 3 with a floor) as of a process (2) or another term (1), has to
    gain `PRICE` in log-likelihood, so that a filter is not taken for a hump, and a hump not for a
    filter.
    """
    rows = _Rows.of(selection, BINS)
    coarse = {kind: [rows.fit(kind, c)[0] for c in CORNERS[::COARSE]] for kind in KINDS}
    if max(map(max, coarse.values())) - rows.plain() < 2 * PRICE:
        return None
    tops = [
        (*rows.top(kind, COARSE * int(np.argmax(coarse[first]))), kind)
        for first, kinds in KINDS.items()
        for kind in kinds
    ]
    # a floor of a millionth is seen in the last row alone
    every = _Rows.of(selection, np.inf)
    fits = [every.likeliest(kind, corner) for _, corner, kind in sorted(tops)[-3:]]
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


@dataclass(frozen=True)
class _Rows:
    """A spectrum in logarithmic bins, so that many corners can be tried.

    `binned` averages rows of the Modes in these bins; `units`, (k, 4), are the expected squares of
    Q, N, B and K.
    """

    binned: Callable
    modes: Modes
    units: np.ndarray
    likelihood: Likelihood

    @classmethod
    def of(cls, selection, bins):
        """Return the rows of a Selection, its ramp taken out, in bins per decade."""
        frequency, whole = selection.modes.frequency, selection.likelihood
        used = np.flatnonzero(whole.count)
        order = used[np.argsort(frequency[used], kind="stable")]
        first = np.arange(len(order))
        if np.isfinite(bins):
            number = np.floor(bins * np.log10(frequency[order]))
            first = np.flatnonzero(np.diff(number, prepend=-np.inf))
        weight = whole.count[order]
        count, none = np.add.reduceat(weight, first), np.zeros(0)

        def binned(rows):
            return (np.add.reduceat(weight * rows[order].T, first, axis=-1) / count).T

        power = binned(whole.power(selection.fit((*NAMES, "R")).ramp))
        likelihood = Likelihood(none, power, count, none, whole.digits)
        return cls(binned, selection.modes, binned(selection.units(NAMES)), likelihood)

    def plain(self):
        """Return the log-likelihood of all terms without a filter."""
        return self.likelihood.fit(self.units).value

    def fit(self, kind, corner):
        """Return the log-likelihood of all terms behind a filter, and its LowPass."""
        low_pass = LowPass(kind, float(corner))
        units = self.units * self.binned(self.modes.gain(low_pass))[:, None]
        units = np.column_stack([self.units[:, 0], units[:, 1:], self.units[:, 1]])
        found = self.likelihood.fit(units)
        white, behind = found.theta[1], found.theta[-1]
        floor = float(behind / (white + behind)) if behind else 0.0
        return found.value, replace(low_pass, floor=floor)

    def top(self, kind, at):
        """Return the largest log-likelihood and its corner: a parabola through three of `CORNERS`.

        They lie uphill from a place among them.
        """
        at = min(max(at, 1), len(CORNERS) - 2)
        below, centre, above = (self.fit(kind, CORNERS[at + k])[0] for k in (-1, 0, 1))
        while above > centre and at + 2 < len(CORNERS):
            at += 1
            below, centre, above = centre, above, self.fit(kind, CORNERS[at + 1])[0]
        while below > centre and at > 1:
            at -= 1
            below, centre, above = self.fit(kind, CORNERS[at - 1])[0], below, centre
        bend = 2 * centre - below - above
        move = np.clip((above - below) / (2 * bend), -1, 1) if bend > 0 else 0.0
        value = centre + move * (above - below) / 2 - move**2 * bend / 2
        return value, float(CORNERS[at] * (CORNERS[1] / CORNERS[0]) ** move)

    def likeliest(self, kind, start):
        """Return the same at the likeliest corner near `start`, within a factor of `STEP`."""
        found = minimize_scalar(
            lambda u: -self.fit(kind, np.exp(u))[0],
            bounds=np.log([start / STEP, min(start * STEP, HIGHEST)]),
            method="bounded",
            options={"xatol": 3e-3},
        )
        return self.fit(kind, np.exp(found.x))


def likeliest_corner(selection, low_pass, terms):
    r"""Return a LowPass at the likeliest corner c, with what N has in common with the corner.

    Along the ridge of the likelihood, where for each N the corner is the likeliest,

    .. math:: \ln c = \ln \hat c + b \ln(N/\hat N),
        \quad b = s \sigma_c^2 / (\sigma_N^2 + s^2 \sigma_c^2)

    with s the change of ln N with ln c, :math:`\sigma_N` the standard error of ln N at a known
    corner and :math:`\sigma_c` that of ln c.

    Takes a Selection behind the filter, and the supported terms.

    Returns
    -------
    low_pass : LowPass
    error : float
        Standard error of ln c.
    along : callable
        The selection on the ridge as a function of N over the likeliest.
    """

    @cache
    def behind(u):
        corner = min(float(np.exp(u)), HIGHEST)
        return selection.filtered(replace(low_pass, corner=corner))

    def value(u):
        return behind(u).fit(terms).value

    u = np.log(low_pass.corner)
    found = minimize_scalar(
        lambda x: -value(x), bounds=(u - 0.2, u + 0.2), method="bounded", options={"xatol": 1e-4}
    )
    u, step, drop = float(found.x), 1e-3, 0.0
    while drop < 0.1 and step < 0.3:
        step *= 2
        drop = -(value(u + step) + value(u - step) + 2 * found.fun) / 2
    error = float(step / np.sqrt(2 * max(drop, 1e-3)))
    below, centre, above = (behind(v).squares(terms)["N"] for v in (u - step, u, u + step))
    change = np.log(above / below) / (4 * step)
    best = behind(u)
    expected = best.units(terms) @ best.fit(terms).theta
    share = best.likelihood.error(best.unit("N"), expected) / (2 * centre)
    slope = change * error**2 / (share**2 + change**2 * error**2)
    corner = replace(low_pass, corner=min(float(np.exp(u)), HIGHEST))
    # in small steps, so that few gains are calculated
    grid = error / 8
    return corner, error, lambda ratio: behind(u + grid * round(slope * np.log(ratio) / grid))


def _score(selection):
    """Return the log-likelihood of the supported terms less the price of their parameters."""
    terms = selection.supported
    parameters = len(terms) + sum(not isinstance(term, str) for term in terms)
    return selection.fit(terms).value - PRICE * parameters
