"""Blocks of rows at rest: the noise of an axis in bands, an axis without."""

import numpy as np

# blocks for spectra: rows per block, blocks per row group, blocks needed
BLOCK, BLOCKS, LEAST_BLOCKS = 256, 64, 4
# share of Nyquist of the bands compared: drift and motion, noise, noise near Nyquist
LOW, MIDDLE, HIGH = (1 / 64, 1 / 16), (1 / 16, 1 / 4), (3 / 4, 1)
# the noise near Nyquist is lacking below this share; a log with more drift is moving
LACKING_SHARE, MOST_DRIFT = 0.05, 10.0
# an axis is silent at rest where it never changes in this share of the quieter blocks
SILENT_SHARE = 0.8


def blocks(x):
    """Return a few whole blocks of rows, evenly spread, shape (n, BLOCK)."""
    found = x[: len(x) // BLOCK * BLOCK].reshape(-1, BLOCK)
    return found[:: max(-(-len(found) // BLOCKS), 1)]


def bands(blocks):
    """Return variance and the mean power in the bands of each block, shape (4, n)."""
    away = blocks - blocks.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(away * np.hanning(BLOCK), axis=1)) ** 2
    top = BLOCK // 2
    bands = [power[:, int(a * top) : int(b * top)].mean(axis=1) for a, b in (LOW, MIDDLE, HIGH)]
    return np.array([away.var(axis=1), *bands])


def lacking(found):
    """Return the noise near Nyquist as a share of that below; None where nothing rests."""
    variance, low, middle, high = found[:, np.isfinite(found).all(axis=0) & (found[0] > 0)]
    if len(variance) < LEAST_BLOCKS:
        return None
    quiet = np.argsort(variance)[: max(len(variance) // 4, LEAST_BLOCKS)]
    if not middle[quiet].sum() or low[quiet].sum() > MOST_DRIFT * middle[quiet].sum():
        return None
    return float(high[quiet].sum() / middle[quiet].sum())


def silent(variance, spread):
    """Tell whether an axis hardly ever changes while the force does not move."""
    quiet = spread <= np.median(spread) if len(spread) >= LEAST_BLOCKS else spread < 0
    return bool((variance[quiet] == 0).sum() > SILENT_SHARE * quiet.sum())
