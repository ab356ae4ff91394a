"""Wavelet coefficients of long logs.

A coefficient of a scale of w samples depends on 3 w − 2 of them. Those that reach beyond an end of
their range are left out.
"""

import numpy as np

# Daubechies' filters of four taps: with two vanishing moments, a straight drift leaves nothing
LOW = np.array([1, 3, 3, 1]) / np.sqrt(32) + np.array([-1, -1, 1, 1]) * np.sqrt(3 / 32)
HIGH = np.array([-1, 1, -1, 1]) * LOW[::-1]
# scales, samples, on which each coefficient begins a scale after the one before
FINE = (2, 4, 8, 16, 32)
# on coarser scales coefficients begin so many samples apart, so that no step falls between two;
# of a day at 1 kHz they are 130 MB
SPACING = FINE[-1]


def fine_details(x, levels):
    """Return first sample and details on each of the first scales of `FINE`, and the smooth rest.

    Of a range, (channels, n); coefficient k ends with sample w (k + 1) of it.
    """
    smooth, details = x, []
    for width in FINE[:levels]:
        # the first ones reach beyond the beginning
        first = 1 if width == 2 else 2
        own = slice(first, x.shape[1] // width)
        # an output for each second sample; before the beginning there are zeros
        count, padded = smooth.shape[1] // 2, np.pad(smooth, ((0, 0), (2, 0)))
        detail, smooth = _filtered([padded[:, k::2][:, :count] for k in (3, 2, 1, 0)])
        details.append((width * first - 2 * (width - 1), detail[:, own]))
    return details, smooth[:, own]


def coarse_details(smooth, width):
    """Return the details of a scale above `FINE`, `SPACING` apart, and its own smooth sequence.

    Takes the smooth sequence of the scale below, of one range, (channels, n); the taps of the
    filters are half a scale apart. The first coefficient begins with the third sample of the range.
    """
    apart = width // (2 * SPACING)
    count = max(smooth.shape[1] - 3 * apart, 0)
    return _filtered([smooth[:, k * apart :][:, :count] for k in (3, 2, 1, 0)])


def _filtered(taps):
    """Return details and smooth sequence of the samples at each tap of the filters."""
    return tuple(
        sum(factor * tap for factor, tap in zip(filter_, taps, strict=True))
        for filter_ in (HIGH, LOW)
    )
