"""Summary figures of a static record, by which devices are compared."""

import numpy as np

# durations of the means, s
MEANS = {"std_10s": 10.0, "std_100s": 100.0}


def summary(stretches, rate):
    """Return summary figures of one axis, in the unit of the axis.

    Parameters
    ----------
    stretches : sequence of ndarray
        Output in each clean stretch.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    dict of str to float or None
        ``mean`` and ``std`` of the samples; ``std_10s`` and ``std_100s``, the standard deviations
        of consecutive means over 10 s and over 100 s. None where a figure needs more data.
    """
    x = np.concatenate(stretches)
    values = {"std": x}
    for name, seconds in MEANS.items():
        count = max(round(seconds * rate), 1)
        full = [part[: len(part) // count * count] for part in stretches]
        values[name] = np.concatenate([part.reshape(-1, count).mean(axis=1) for part in full])
    std = {name: float(v.std(ddof=1)) if len(v) > 1 else None for name, v in values.items()}
    return {"mean": float(x.mean())} | std
