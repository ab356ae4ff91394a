"""Logs as a host stamps them: a sensor that samples evenly, losses, transfers and delays."""

import numpy as np

from imuloop.core.samples import CHANNELS
from ingest.logs import brief

# s that a host needs for a row
ROW = 2e-5


def every(count, packet=1):
    """Lose each `count`-th packet."""
    return lambda index, rng: index // packet % count == count // 2


def at_random(share, packet=1):
    """Lose a share of the packets."""
    return lambda index, rng: (rng.random(index[-1] // packet + 1) < share)[index // packet]


def polled(interval):
    """A host asks at even intervals, as over USB."""
    return lambda t, rng: np.ceil(t / interval) * interval


def normal(std):
    return lambda t, rng: np.sort(t + rng.normal(0, std, len(t)))


def exponential(mean):
    """A delay of each transfer; none overtakes another."""
    return lambda t, rng: np.maximum.accumulate(t + rng.exponential(mean, len(t)))


def stalls(mean, share, long):
    """A host that is busy now and then; what waits comes at once."""

    def delayed(t, rng):
        late = rng.exponential(mean, len(t)) + (rng.random(len(t)) < share) * long
        return np.maximum.accumulate(t + late)

    return delayed


def stamped(rate, seconds, seed, *, delay=None, loss=None, packet=1, spacing=0.0):
    """Return a log at rest and the numbers of its samples.

    Parameters
    ----------
    rate, seconds : float
        Of the sensor, Hz, and the length of the log.
    delay : callable, optional
        From times of packets to those at which the host gets them, s.
    loss : callable, optional
        From sample numbers to which of them are lost. Neither the first packet nor the last ones.
    packet : int
        Samples of a packet. It is sent with its last one.
    spacing : float
        Seconds between the stamps of a packet's rows; without it they share one.
    """
    rng = np.random.default_rng(seed)
    index = np.arange(int(rate * seconds) // packet * packet)
    keep = np.ones(len(index), dtype=bool)
    if loss:
        keep[packet : -9 * packet] = ~loss(index, rng)[packet : -9 * packet]
    kept = index[keep]
    packets, of = np.unique(kept // packet, return_inverse=True)
    arrived = ((packets + 1) * packet - 1) / rate
    t = (delay(arrived, rng) if delay else arrived)[of]
    if packet == 1 or spacing:
        busy = ROW * np.arange(len(t))
        t = np.maximum.accumulate(t + spacing * (kept % packet) - busy) + busy
    log = brief(2).iloc[[0]].sample(len(kept), replace=True, random_state=0, ignore_index=True)
    log[[*CHANNELS]] += rng.normal(size=(len(kept), 6)) * ([0.02] * 3 + [0.002] * 3)
    return log.assign(t=np.round(t, 7)), kept
