"""Filters of columns of a whole log: lag, hysteresis, moving mean, rate of change."""

from functools import partial

import numpy as np

from imuloop.core.gaps import gap_limit

# largest exponent in a block: exp(±500) is far from the limits of a double
_SUMMED = 500.0
# most samples in a block: they fit in the cache of a processor
_BLOCK = 1 << 16
# fewest samples of a moving mean: shorter ones remove too much of the fast changes
_FEWEST = 7
# time shift below which it is taken as zero, s
_INSTANT = 1e-6


def usual_step(t):
    """Return the median time step, s, of the n times `t`, s, (n,)."""
    return float(np.median(np.diff(t)))


def first_order_lag(t, values, tau):
    """Return the response y of a first-order lag, ``τ dy/dt = x - y``, in the shape of `values`.

    x are the `values`, (n,) or (n, m) for m signals, at the increasing times `t`, (n,), s. The time
    constant τ is `tau`, s. y starts at the first value.

    The result is exact if x is linear between the samples, for steps of any length. Let d = y - x.
    From the start of a step, index 0, to its end, index 1, d becomes ``d₁ = a d₀ - g (x₁ - x₀)``.
    If the step lasts r time constants, a = exp(-r) and g = (1 - a)/r. The sum over many steps is
    ``d = e⁻ˢ (d₀ - Σ eˢ g Δx)``, with the time s in units of τ. It is computed in blocks so that eˢ
    does not overflow.
    """
    x = np.asarray(values, dtype=float).reshape(len(t), -1)
    d, start = np.zeros_like(x), 1
    while start < len(t):
        # the block has the samples from `start` to before `end`, at least one
        end = np.searchsorted(t, t[start - 1] + _SUMMED * tau, side="right")
        end = max(min(end, start + _BLOCK), start + 1)
        r = np.diff(t[start - 1 : end])[:, None] / tau
        # 1 for a step of length zero
        g = np.where(r > 0, -np.expm1(-r) / np.where(r > 0, r, 1.0), 1.0)
        # eˢ; after a step too long for a block, the response has forgotten everything before it,
        # and so the exponent may be cut
        growth = np.exp(np.minimum((t[start:end] - t[start - 1]) / tau, _SUMMED))[:, None]
        added = np.cumsum(growth * g * np.diff(x[start - 1 : end], axis=0), axis=0)
        d[start:end] = (d[start - 1] - added) / growth
        start = end
    return (x + d).reshape(np.shape(values))


def play(values, half_width):
    """Return the play operator p of n values x, (n,), a model of hysteresis.

    x are the `values`, (n,). p is a point that is dragged by two walls, which lie at the distance
    w, `half_width`, on either side of x. From one sample to the next, ``p₁ = min(max(p₀, x - w), x
    + w)``. p starts at the first value.

    Two such clamps in a row equal one clamp with other limits. So the values are cut into about √n
    stretches of consecutive samples. For all stretches at once, the clamps from the start of a
    stretch to each of its samples are combined. Then the point is carried from stretch to stretch.

    References
    ----------
    M. Brokate, J. Sprekels, Hysteresis and Phase Transitions, Springer 1996.
    """
    count = max(int(np.sqrt(len(values))), 1)
    # (count, number of stretches): the walls at each sample of each stretch; copies of the last
    # value fill the last stretch
    padded = np.pad(values, (0, -len(values) % count), mode="edge").reshape(-1, count).T
    low, high = padded - half_width, padded + half_width
    # limits of the point at each sample by all walls since the start of its stretch
    lower, upper = low.copy(), high.copy()
    for k in range(1, count):
        lower[k] = np.clip(lower[k - 1], low[k], high[k])
        upper[k] = np.clip(upper[k - 1], low[k], high[k])
    # the point at the start of each stretch
    starts, point = [], values[0]
    for last_lower, last_upper in zip(lower[-1].tolist(), upper[-1].tolist(), strict=True):
        starts.append(point)
        point = min(max(point, last_lower), last_upper)
    return np.clip(starts, lower, upper).T.ravel()[: len(values)]


def fast_part(t, values, period):
    """Return the fast changes of values, (n, m): a high-pass filter removes their slow part.

    The slow part is the moving mean, taken twice, over `period`, s. `t`, (n,), are increasing
    times, s, and `values`, (n, m), are m signals. The gain at a frequency f is ``1 - sinc²(f
    period)``. It is a half at f = 0.44/period, and differs from one by less than 5 % at all f above
    1/period. A linear change is slow at any rate, and is removed.
    """
    # loaded late, as few effects need it
    from scipy.ndimage import uniform_filter1d

    step = usual_step(t) if len(t) > 1 else period
    half = max(_FEWEST // 2, round(period / step / 2))
    # values relative to the first one, so that sums keep their digits
    values = values - values[:1]
    # before and after the log, the first and the last value are repeated
    mean = partial(uniform_filter1d, size=2 * half + 1, axis=0, mode="nearest")
    return values - mean(mean(values))


def slope(t, values):
    """Return the rate of change of values, per second, (n, m).

    `values`, (n, m), are m signals at the times `t`, (n,), s. The rate is the derivative of the
    parabola through each value and its two neighbours. For a sine of frequency f and a time step
    Δt, the result is the true rate times ``sinc(2 f Δt)``: 98 % at a twentieth of the sampling
    rate. The rate is zero for a single sample.
    """
    return np.gradient(values, t, axis=0) if len(t) > 1 else np.zeros_like(values)


def secant(t, values, seconds):
    """Return the mean rate of change of values from each time t to t + `seconds`, (n, m).

    It is per second. `values`, (n, m), are m signals at the increasing times `t`, (n,), s.
    `seconds` may be negative. The values at t + `seconds` are interpolated by the cubic that has
    the `slope` at the samples on both sides (Catmull and Rom). Midway between two samples the
    interpolated values are wrong by 0.02 % for a sine of a twentieth of the sampling rate, and by
    0.4 % for a tenth. The result is the `slope` at t if `seconds` is zero, or if t + `seconds` lies
    in a gap or outside the log.
    """
    change = slope(t, values)
    if len(t) < 2 or abs(seconds) < _INSTANT:
        return change
    # the shifted time lies between the samples k and k + 1, at the share s of the step h
    k = np.clip(np.searchsorted(t, t + seconds, side="right") - 1, 0, len(t) - 2)
    h = (t[k + 1] - t[k])[:, None]
    s = (t + seconds - t[k])[:, None] / h
    shifted = (1 - s) ** 2 * ((1 + 2 * s) * values[k] + h * s * change[k])
    shifted += s**2 * ((3 - 2 * s) * values[k + 1] - h * (1 - s) * change[k + 1])
    inside = (s >= 0) & (s <= 1) & (h <= gap_limit(usual_step(t)))
    return np.where(inside, (shifted - values) / seconds, change)


def moving_mean(t, values, width):
    """Return the mean of values over the `width` seconds before each time, (n, m).

    `values`, (n, m), are m signals at the times `t`, (n,), s. Near the start of the log the mean is
    over the samples since the start.
    """
    # a sum over samples is the difference of two sums since the start
    sums = np.zeros((len(t) + 1, values.shape[1]))
    np.cumsum(values, axis=0, out=sums[1:])
    first, end = np.searchsorted(t, t - width), np.arange(1, len(t) + 1)
    return (sums[end] - sums[first]) / (end - first)[:, None]
