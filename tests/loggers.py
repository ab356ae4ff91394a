"""What a logger does to a log: it loses samples and stamps them late."""

import numpy as np

from imuloop.core.samples import TIME


def lose(log, share, rng, lengths=(1,)):
    """Return a log without some of its samples, lost anywhere; the first and last one stay.

    `share` is the share of samples that are lost, less where losses fall together, in stretches of
    one or the other of the `lengths`.
    """
    keep = np.ones(len(log), dtype=bool)
    for at in rng.integers(0, len(log), round(share * len(log) / np.mean(lengths))):
        keep[at : at + rng.choice(lengths)] = False
    keep[[0, -1]] = True
    return log[keep].reset_index(drop=True)


def stamp_late(log, std, rng):
    """Return a log whose stamps are off by normal errors of a standard deviation, s."""
    return log.assign(**{TIME: log[TIME] + rng.normal(0, std, len(log))})
