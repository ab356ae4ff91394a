"""Filters of the columns of a whole log: lag, play, moving mean, rate of change."""

from functools import partial

import numpy as np

from imuloop.core.gaps import gap_limit

# exponents that are summed at once: exp(±500) is far from the limits of a double
_SUMMED = 500.0
# samples that are summed at once: a processor's cache holds them
_BLOCK = 1 << 16
# samples of a moving mean: of fewer, too little of what changes from one to the next is left
_FEWEST = 7
# s; a shift that is none
_INSTANT = 1e-6


def usual_step(t):
    """Return the median step of time, s."""
    return float(np.median(np.diff(t)))


def first_order_lag(t, values, tau):
    """Return the response ``τ dy/dt = x - y`` of a first-order lag that starts at the first value.

    Exact for values on straight lines between the stamps, however far apart these are: over a
    step of r time constants, with a = exp(-r), g = (1 - a)/r and d = y - x,
    ``d₁ = a d₀ - g (x₁ - x₀)``. Summed as ``d = e⁻ˢ (d₀ - Σ eˢ g Δx)``, s the time in units of τ,
    block after block. Takes increasing time, s, values, (n,) or (n, m), and τ, s.
    """
    x = np.asarray(values, dtype=float).reshape(len(t), -1)
    d, start = np.zeros_like(x), 1
    while start < len(t):
        end = np.searchsorted(t, t[start - 1] + _SUMMED * tau, side="right")
        end = max(min(end, start + _BLOCK), start + 1)
        r = np.diff(t[start - 1 : end])[:, None] / tau
        g = np.where(r > 0, -np.expm1(-r) / np.where(r > 0, r, 1.0), 1.0)
        # after a longer step nothing is left of what was before
        growth = np.exp(np.minimum((t[start:end] - t[start - 1]) / tau, _SUMMED))[:, None]
        added = np.cumsum(growth * g * np.diff(x[start - 1 : end], axis=0), axis=0)
        d[start:end] = (d[start - 1] - added) / growth
        start = end
    return (x + d).reshape(np.shape(values))


def play(values, half_width):
    """Return the play operator: a point dragged by walls `half_width` to either side.

    ``p₁ = min(max(p₀, x - w), x + w)``, p = x at the start.

    References
    ----------
    M. Brokate, J. Sprekels, Hysteresis and Phase Transitions, Springer 1996.
    """
    low, high = values - half_width, values + half_width
    # clamps one after the other are one clamp: that up to each sample of √n stretches side by side
    count = max(int(np.sqrt(len(values))), 1)
    more = -len(values) % count
    low, high = (np.pad(x, (0, more)).reshape(-1, count).T for x in (low, high))
    lower, upper = low.copy(), high.copy()
    for k in range(1, count):
        for ends in (lower, upper):
            ends[k] = np.minimum(np.maximum(ends[k - 1], low[k]), high[k])
    starts, at = [], next(iter(values), 0.0)
    for first, last in zip(lower[-1].tolist(), upper[-1].tolist(), strict=True):
        starts.append(at)
        at = min(max(at, first), last)
    return np.minimum(np.maximum(starts, lower), upper).T.ravel()[: len(values)]


def fast_part(t, values, period):
    """Return values less a moving mean that is taken twice: a high-pass.

    At a frequency f, ``1 - sinc²(f period)`` of it is left: half at 0.44/period, within 5 % all
    above 1/period; of what moves evenly, nothing. Takes increasing time, s, values, (n, m), and the
    length of the mean, s.
    """
    # loaded late: few effects ask for it
    from scipy.ndimage import uniform_filter1d

    step = usual_step(t) if len(t) > 1 else period
    half = max(_FEWEST // 2, round(period / step / 2))
    # from the first value on, so that sums keep their digits
    values = values - values[:1]
    # the ends are held beyond the log
    mean = partial(uniform_filter1d, size=2 * half + 1, axis=0, mode="nearest")
    return values - mean(mean(values))


def slope(t, values):
    """Return the rate of change of values, (n, m), by the parabola through each and its neighbours.

    A central difference: of a sine of frequency f it gives ``sinc(2 f Δt)``, 98 % at a twentieth of
    the sampling rate. Zero of a single sample.
    """
    return np.gradient(values, t, axis=0) if len(t) > 1 else np.zeros_like(values)


def secant(t, values, seconds):
    """Return the mean rate of change of values, (n, m), from each sample to `seconds` after it.

    Between two samples values are the cubic that has their `slope` (Catmull and Rom): midway it
    errs by 0.02 % on a sine of a twentieth of the sampling rate, by 0.4 % on one of a tenth. Where
    that instant lies in a gap or beyond the log, and where there is no shift, it is the slope.
    `seconds` may differ from sample to sample, (n,).
    """
    change, seconds = slope(t, values), np.broadcast_to(seconds, np.shape(t))
    if len(t) < 2 or np.all(np.abs(seconds) < _INSTANT):
        return change
    k = np.clip(np.searchsorted(t, t + seconds, side="right") - 1, 0, len(t) - 2)
    h = (t[k + 1] - t[k])[:, None]
    s = (t + seconds - t[k])[:, None] / h
    shifted = (1 - s) ** 2 * ((1 + 2 * s) * values[k] + h * s * change[k])
    shifted += s**2 * ((3 - 2 * s) * values[k + 1] - h * (1 - s) * change[k + 1])
    whole = (s >= 0) & (s <= 1) & (h <= gap_limit(usual_step(t)))
    moved = (np.abs(seconds) >= _INSTANT)[:, None]
    by = np.where(moved, seconds[:, None], 1.0)
    return np.where(whole & moved, (shifted - values) / by, change)


def moving_mean(t, values, width):
    """Return the mean of values, (n, m), over the last `width` s, fewer at the log's start."""
    sums = np.zeros((len(t) + 1, values.shape[1]))
    np.cumsum(values, axis=0, out=sums[1:])
    first = np.searchsorted(t, t - width)
    return (sums[1:] - sums[first]) / (np.arange(1, len(t) + 1) - first)[:, None]
