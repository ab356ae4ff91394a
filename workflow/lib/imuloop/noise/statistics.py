"""Summary figures of a static record that people compare devices by."""

import numpy as np

# lengths of the consecutive means, s
MEANS = {"std_10s": 10.0, "std_100s": 100.0}


def summary(stretches, rate):
    """Return summary figures of one axis.

    Parameters
    ----------
    stretches : sequence of array_like, shape (n_s,)
        Clean output, any unit.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    dict
        mean, std, min, q25, median, q75, max and peak_to_peak of the samples; std_10s and
        std_100s, the standard deviation of consecutive 10 s and 100 s means. Unit of the output;
        None where a figure needs more data.
    """
    x = np.concatenate([np.asarray(s, dtype=float) for s in stretches])
    low, q25, median, q75, high = np.quantile(x, [0, 0.25, 0.5, 0.75, 1])
    figures = {
        "mean": x.mean(),
        "std": x.std(ddof=1) if len(x) > 1 else None,
        "min": low,
        "q25": q25,
        "median": median,
        "q75": q75,
        "max": high,
        "peak_to_peak": high - low,
    }
    for name, seconds in MEANS.items():
        means = consecutive_means(stretches, round(seconds * rate))
        figures[name] = means.std(ddof=1) if len(means) > 1 else None
    return {name: None if value is None else float(value) for name, value in figures.items()}


def consecutive_means(stretches, count):
    """Return means over `count` samples, one after the other, none over a stretch's end."""
    if count < 1:
        return np.empty(0)
    whole = [np.asarray(s)[: len(s) // count * count].reshape(-1, count) for s in stretches]
    return np.concatenate(whole).mean(axis=1) if sum(map(len, whole)) else np.empty(0)
