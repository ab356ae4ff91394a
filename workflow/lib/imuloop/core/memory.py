"""Functions of a log's past: lag, play, moving mean; and gaps of a slow channel."""

import numpy as np

from imuloop.core.gaps import gap_limit

# exponents that are summed at once: exp(±500) is far from the limits of a double
_SUMMED = 500.0
# after as many time constants nothing of the past is left in a double: exp(-50) = 2e-22
_FORGOTTEN = 50.0
# samples of a moving mean: of fewer, too little of what changes from one to the next is left
_FEWEST = 7
# steps of time that the usual one is found of
STEPS = 1 << 20
# s; a shift that is none
_INSTANT = 1e-6


def in_pieces(function):
    """Mark a function of a log's channels that may be evaluated piece by piece.

    It keeps what it needs of a piece for the next in ``channels.past``, and looks no further than
    its effect's `reach`.
    """
    function.in_pieces = True
    return function


def of_time(function):
    """Mark a function of a log's time stamps alone: a piece, or a single sample, is enough."""
    function.in_pieces = function.of_time = True
    return function


def usual_step(t):
    """Return the median step of time, s, of the first million."""
    return float(np.median(np.diff(t[:STEPS])))


def filled(t, values):
    """Fill NaNs: linear between neighbours, constant before the first and after the last.

    Of a channel that is logged more slowly than the others, or with gaps; t, values shape (n,).
    """
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    return np.interp(t, t[known], values[known])


def _before(past, t):
    """Return the index of the last sample that is kept of the time before `t`, or None."""
    if not past:
        return None
    last = np.searchsorted(past["t"], t[0]) - 1
    return last if last >= 0 else None


def first_order_lag(t, values, tau, past=None):
    """Return the response ``τ dy/dt = x - y`` of a first-order lag that starts at the first value.

    Exact for values on straight lines between the stamps, however far apart these are: over a
    step of r time constants, with a = exp(-r) and g = (1 - a)/r,
    ``y₁ = a y₀ + (g - a) x₀ + (1 - g) x₁``. Summed as ``y = e⁻ˢ Σ eˢ (…)``, s the time in units
    of τ, part after part.

    Takes increasing time, s, values, (n,) or (n, m), and τ, s. Of a log in pieces, each of which
    may begin with samples of the one before, `past` is empty at the first, then as this leaves it.
    """
    x = np.asarray(values, dtype=float).reshape(len(t), -1)
    rest, state = x[:1], 0.0
    last = _before(past, t)
    if last is not None:
        rest, state = past["rest"], past["y"][[last]] - past["rest"]
        t, x = np.append(past["t"][last], t), np.concatenate([past["x"][[last]], x])
    if past is not None:
        past.update(t=t, x=x, rest=rest)
    # less the log's first value, in which it starts at rest
    y, x = np.zeros_like(x), x - rest
    r = np.diff(t, prepend=t[:1])[:, None] / tau
    g = np.where(r > 0, -np.expm1(-r) / np.where(r > 0, r, 1.0), 1.0)
    r = np.minimum(r, _FORGOTTEN)
    added = (1 - g) * x
    added[1:] += (g - np.exp(-r))[1:] * x[:-1]
    s = np.cumsum(r)
    start, origin = 0, 0.0
    while start < len(s):
        end = np.searchsorted(s, origin + _SUMMED, side="right")
        end = max(end, start + 1)
        growth = np.exp(s[start:end] - origin)[:, None]
        y[start:end] = (state + np.cumsum(growth * added[start:end], axis=0)) / growth
        state, origin, start = y[end - 1], s[end - 1], end
    y += rest
    if past is not None:
        past["y"] = y
    return y[last is not None :].reshape(np.shape(values))


def play(values, half_width, t=None, past=None):
    """Return the play operator: a point dragged by walls `half_width` to either side.

    ``p₁ = min(max(p₀, x - w), x + w)``, p = x at the start. Time and `past` are as of
    `first_order_lag`.

    References
    ----------
    M. Brokate, J. Sprekels, Hysteresis and Phase Transitions, Springer 1996.
    """
    last = _before(past, t)
    at = next(iter(values[:1] if last is None else past["p"][last:]), 0.0)
    low, high = values - half_width, values + half_width
    # clamps one after the other are one clamp: that up to each sample of √n stretches side by side
    count = max(int(np.sqrt(len(values))), 1)
    more = -len(values) % count
    low, high = (np.pad(x, (0, more)).reshape(-1, count).T for x in (low, high))
    lower, upper = low.copy(), high.copy()
    for k in range(1, count):
        for ends in (lower, upper):
            ends[k] = np.minimum(np.maximum(ends[k - 1], low[k]), high[k])
    starts = []
    for first, last in zip(lower[-1].tolist(), upper[-1].tolist(), strict=True):
        starts.append(at)
        at = min(max(at, first), last)
    p = np.minimum(np.maximum(starts, lower), upper).T.ravel()[: len(values)]
    if past is not None:
        past.update(t=t, p=p)
    return p


def fast_part(t, values, period, step=None):
    """Return values less a moving mean that is taken twice: a high-pass.

    At a frequency f, ``1 - sinc²(f period)`` of it is left: half at 0.44/period, within 5 % all
    above 1/period; of what moves evenly, nothing. Takes increasing time, s, values, (n, m), the
    length of the mean, s, and the median step of the whole log, s, of which this is a piece.
    """
    if step is None:
        step = usual_step(t) if len(t) > 1 else period
    half = max(_FEWEST // 2, round(period / step / 2))
    # from the first value on, so that sums keep their digits
    values = values - values[:1]
    mean, size = values, 2 * half + 1
    for _ in range(2):
        # the ends are held beyond the log
        sums = np.cumsum(np.pad(mean, ((half + 1, half), (0, 0)), mode="edge"), axis=0)
        mean = (sums[size:] - sums[:-size]) / size
    return values - mean


def slope(t, values):
    """Return the rate of change of values, (n, m), by the parabola through each and its neighbours.

    A central difference: of a sine of frequency f it gives ``sinc(2 f Δt)``, 98 % at a twentieth of
    the sampling rate. Zero of a single sample.
    """
    return np.gradient(values, t, axis=0) if len(t) > 1 else np.zeros_like(values)


def secant(t, values, seconds, step=None):
    """Return the mean rate of change of values, (n, m), from each sample to `seconds` after it.

    Between two samples values are the cubic that has their `slope` (Catmull and Rom): midway it
    errs by 0.02 % on a sine of a twentieth of the sampling rate, by 0.4 % on one of a tenth. Where
    that instant lies in a gap or beyond the log, and where there is no shift, it is the slope.
    `step` is the median one of the whole log, s, of which this is a piece; `seconds` may differ
    from sample to sample, (n,).
    """
    change, seconds = slope(t, values), np.broadcast_to(seconds, np.shape(t))
    if len(t) < 2 or np.all(np.abs(seconds) < _INSTANT):
        return change
    k = np.clip(np.searchsorted(t, t + seconds, side="right") - 1, 0, len(t) - 2)
    h = (t[k + 1] - t[k])[:, None]
    s = (t + seconds - t[k])[:, None] / h
    shifted = (1 - s) ** 2 * ((1 + 2 * s) * values[k] + h * s * change[k])
    shifted += s**2 * ((3 - 2 * s) * values[k + 1] - h * (1 - s) * change[k + 1])
    whole = (s >= 0) & (s <= 1) & (h <= gap_limit(step or usual_step(t)))
    moved = (np.abs(seconds) >= _INSTANT)[:, None]
    by = np.where(moved, seconds[:, None], 1.0)
    return np.where(whole & moved, (shifted - values) / by, change)


def moving_mean(t, values, width):
    """Return the mean of values, (n, m), over the last `width` s, fewer at the log's start."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    last, first = np.arange(1, len(t) + 1), np.searchsorted(t, t - width)
    return (sums[last] - sums[first]) / (last - first)[:, None]
