"""Wavelet coefficients piece by piece against those of a transform of the whole."""

import numpy as np
import pytest

from imuloop.segment import wavelets
from imuloop.segment.wavelets import (
    FINE,
    SPACING,
    coarse_details,
    fine_details,
    pieces,
)


def coefficients(x, ranges, levels):
    """Return scale -> {first sample: coefficient} of samples of shape (k, n)."""
    found, smooth = {2**level: {} for level in range(1, levels + 1)}, {}
    for start, begin, end, before in pieces(ranges):
        details, rest = fine_details(x[:, begin:end], before, len(FINE))
        for width, (first, detail) in zip(FINE, details, strict=True):
            found[width].update(each(detail, begin + first, width))
        smooth.setdefault(start, []).append(rest)
    for start, parts in smooth.items():
        rest = np.hstack(parts)
        for width in [2**level for level in range(6, levels + 1)]:
            detail, rest = coarse_details(rest, width)
            found[width].update(each(detail, start + 2, SPACING))
    return found


def each(detail, first, step):
    return {first + k * step: c for k, c in enumerate(detail.T)}


def transform(x):
    """Return smooth and detail of samples, shape (k, n), by the filters of four taps of Daubechies.

    Daubechies, "Ten lectures on wavelets", 1992, table 6.1.
    """
    low = np.array([1 - 3**0.5, 3 - 3**0.5, 3 + 3**0.5, 1 + 3**0.5]) / 2**2.5
    high = low[::-1] * [-1, 1, -1, 1]
    return [np.array([np.convolve(row, taps)[1::2] for row in x]) for taps in (low, high)]


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(wavelets, "ROWS", 128)


@pytest.mark.parametrize("n", [1, 5, 97, 128, 129, 256, 257, 1025])
def test_pieces_give_what_the_whole_gives(n):
    x = np.random.default_rng(n).normal(size=(2, n + 7))
    found, smooth, width = coefficients(x, [(7, n + 7)], 5), x[:, 7:], 1
    while width < SPACING:
        width *= 2
        if smooth.shape[1] < 4:
            assert not found[width]
            continue
        smooth, detail = transform(smooth)
        start = width * np.arange(detail.shape[1]) - 2 * (width - 1)
        inside = (start >= 0) & (start + 3 * width - 2 <= n)
        assert list(found[width]) == (7 + start[inside]).tolist()
        of_the_whole = detail[:, inside].T.tolist()
        np.testing.assert_allclose(list(found[width].values()), of_the_whole, rtol=0, atol=1e-13)


def test_coefficients_depend_on_the_samples_that_they_claim():
    x = np.random.default_rng(10).normal(size=(6, 1000))
    ranges = [(3, 411), (500, 1000)]
    before = coefficients(x, ranges, 7)
    x[:, 600:620] += 1
    x[:, 411:500] = np.nan
    for width, changed in coefficients(x, ranges, 7).items():
        assert list(changed) == list(before[width])
        first = np.array(list(changed))
        touched = [np.any(changed[k] != before[width][k]) for k in changed]
        allowed = (first + 3 * width - 2 > 600) & (first < 620)
        assert not np.any(touched & ~allowed)
        assert width == 2 or np.any(touched)
        # orthonormal: the variance of white noise is kept on every scale
        if len(changed) > 100:
            assert np.mean(np.square(list(before[width].values()))) == pytest.approx(1, abs=0.2)


def test_long_scales_are_dense_and_a_straight_drift_leaves_nothing():
    drift = np.linspace(0, 100, 2000) * np.arange(1, 7)[:, None]
    for width, found in coefficients(drift, [(0, 2000)], 8).items():
        np.testing.assert_allclose(list(found.values()), 0, atol=1e-8)
        if width > SPACING:
            # transformed at every shift by half of the scale below
            starts = np.sort(list(found))
            assert np.all(np.diff(starts) == SPACING)
            assert starts[0] < SPACING and 2000 - (starts[-1] + 3 * width - 2) < SPACING
