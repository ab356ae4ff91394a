"""Wavelet coefficients of long logs, piece by piece on the fine scales.

Coefficient k of level j depends on 3·2ʲ − 2 samples, from 2ʲk − 2(2ʲ − 1) of its range on, and
ends with sample 2ʲ(k + 1). Those that reach beyond an end of the range are left out. Details are
pairs of coefficients, (channels, m), and the first sample that the first one depends on; the next
one's is a scale later.
"""

import pywt

from imuloop.core.samples import ROWS

# two vanishing moments: a straight drift leaves nothing
WAVELET = pywt.Wavelet("db2")
# scales of more samples than this are transformed at every shift by half the scale below, so that
# no step falls between two coefficients; their smooth sequences of a day at 1 kHz are 130 MB
DENSE = 32
FINE = [2, 4, 8, 16, 32]
# samples before a piece on which its coefficients depend
_BEFORE = 3 * DENSE


def pieces(ranges):
    """Yield the pieces that ranges are worked on in: range, begin and end, first sample to read."""
    for i, j in ranges:
        for a in range(i, j, ROWS):
            yield i, j, a, min(a + ROWS, j), max(i, a - _BEFORE)


def whole(piece, width):
    """Return the first and one after the last coefficient of a scale that ends in a piece.

    Counted from the first sample that is read.
    """
    i, _, a, b, begin = piece
    # the first of a range does not reach before it
    at_start = 1 if width == 2 else 2
    first = _BEFORE // width if a > i else at_start
    return first, max((b - begin) // width, first)


def fine_details(x, piece, widths):
    """Return the details of a piece on each of the first scales of `FINE`, and its smooth sequence.

    Takes the samples of the piece, with those before it, (channels, n). The smooth sequence is what
    the piece adds to that of its range; None where it is too short.
    """
    i, j, a, b, begin = piece
    smooth, details = x, []
    for width in widths:
        first, last = whole(piece, width)
        if smooth is None or smooth.shape[1] < WAVELET.dec_len:
            smooth = None
            details.append((x[:, :0], 0))
            continue
        smooth, detail = pywt.dwt(smooth, WAVELET, mode="zero", axis=1)
        details.append((detail[:, first:last], begin + width * first - 2 * (width - 1)))
    if smooth is not None and widths:
        smooth = smooth[:, first if a > i else 0 : last if b < j else None]
    return details, smooth


def coarse_details(sequences, width):
    """Return the details of a scale above `DENSE`, and the smooth sequences of the next one.

    Sequences are lists of range, shift and smooth sequence of the scale below; the list is emptied,
    as it is no longer needed.
    """
    details, halved = [], []
    sequences.reverse()
    while sequences:
        i, j, shift, smooth = sequences.pop()
        for extra in (0, 1):
            if smooth.shape[1] - extra < WAVELET.dec_len:
                continue
            begin = shift + extra * width // 2
            half, detail = pywt.dwt(smooth[:, extra:], WAVELET, mode="zero", axis=1)
            halved.append((i, j, begin, half))
            # before the range's own first sample no shifted sequence begins
            first = max(-((begin - 2 * (width - 1)) // width), 0)
            last = min((j - i - begin) // width, detail.shape[1])
            if last > first:
                details.append((detail[:, first:last], i + begin + width * (first - 2) + 2))
    return details, halved
