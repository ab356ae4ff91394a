"""A series without what noise explains: wavelet shrinkage, scale by scale."""

import numpy as np
import pywt

# four vanishing moments, nearly symmetric: a bend of third order leaves nothing, a step stays put
WAVELET = "sym4"
# fewest coefficients on a scale from which its noise can be told
FEWEST = 32


def smoothed(x):
    """Return a series from which the noise of every scale was shrunk away.

    On each scale the wavelet coefficients d are those of noise and of what changed. The noise's
    standard deviation is that of the median, ``σ = median |d| / 0.6745``; a coefficient then
    becomes ``sign(d) max(|d| - σ √(2 ln n), 0)``: of n values of noise none is likely to pass. With
    a σ for each scale flicker and random walk are shrunk as white noise is.

    Parameters
    ----------
    x : array_like, shape (n,)
        The series, evenly spaced, finite.

    Returns
    -------
    ndarray, shape (n,)

    References
    ----------
    Donoho, Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81 (1994);
    Johnstone, Silverman, "Wavelet threshold estimators for data with correlated noise", J. R.
    Statist. Soc. B 59 (1997), for a threshold on each scale.
    """
    x = np.asarray(x, float)
    levels = int(np.log2(max(len(x) / FEWEST, 1)))
    if not levels:
        return x
    rough, *details = pywt.wavedec(x, WAVELET, mode="symmetric", level=levels)
    bound = np.sqrt(2 * np.log(len(x))) / 0.6745
    # pywt's own has no value for zeros at a threshold of zero
    shrunk = [
        np.sign(d) * np.maximum(np.abs(d) - bound * np.median(np.abs(d)), 0.0) for d in details
    ]
    return pywt.waverec([rough, *shrunk], WAVELET, mode="symmetric")[: len(x)]
