"""The motion that the devices of a board share: calibrated, on one clock."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.ndimage import binary_dilation
from scipy.signal import correlate

from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME, read_columns, read_samples
from imuloop.core.segments import MOTION, STATIC
from imuloop.ingest.quality import CLIPPED_SHARE

# steps; a cubic bridges a lost sample, not two in a row
BRIDGED = 2.5
# samples on either side of one that is clipped or lost, of which a slope is not known
BESIDE = 7
# s; a shorter rest of all devices is none
SHORTEST_REST = 0.5
# s; of a longer move the turn is not compared
LONGEST_S = 30.0
# of the magnitudes of two angular rates: chips of one board have above 0.99
LEAST_CORRELATION = 0.8
# of a step; clocks that are nearer are one
SAME_CLOCK = 0.05


@dataclass(frozen=True)
class Shared:
    """Specific force and angular rate of k devices at n times, each on its device's own axes.

    `t`, s, (n,); `f`, m/s^2, and `w`, rad/s, (k, n, 3); `moving`, where all move and none is
    clipped or lost, (n,); `rests`, first row and end of each rest of all, (r, 2); `moves`, numbers
    of the rests that a whole move follows, (m,).
    """

    t: np.ndarray
    f: np.ndarray
    w: np.ndarray
    moving: np.ndarray
    rests: np.ndarray
    moves: np.ndarray

    def at_rest(self, values):
        """Return the means of values, (k, n, 3), over the rests, (k, r, 3)."""
        return np.stack([values[:, i:j].mean(axis=1) for i, j in self.rests], axis=1)


def read_shared(session, devices, calibrations):
    """Return the Shared motion of a session of devices (`imuloop.chain.Device`).

    An ImuloopError says why the devices share none.
    """
    logs = [_log(*each, session) for each in zip(devices, calibrations, strict=True)]
    times = [logs[0][0], *(log[0] + _offset(logs[0], log) for log in logs[1:])]
    t = times[0][(times[0] >= max(own[0] for own in times))]
    t = t[t <= min(own[-1] for own in times)]
    pairs = list(zip(times, logs, strict=True))
    values = np.array([CubicSpline(own, log[1])(t) for own, log in pairs])
    # a time between two samples is what both are
    flags = [[np.interp(t, own, flag) == 1 for flag in log[2]] for own, log in pairs]
    still, moving, whole = np.all(flags, axis=0)
    rests = np.flatnonzero(np.diff(np.pad(still, 1).astype(int))).reshape(-1, 2)
    rests = rests[t[rests[:, 1] - 1] - t[rests[:, 0]] >= SHORTEST_REST]
    moving &= ~binary_dilation(~whole, iterations=BESIDE)
    if len(rests) < 2 or not moving.any():
        raise ImuloopError("no rests of all devices with motion between")
    ends = zip(rests[:-1, 1] - 1, rests[1:, 0], strict=True)
    moves = [m for m, (i, j) in enumerate(ends) if whole[i:j].all() and t[j] - t[i] <= LONGEST_S]
    return Shared(t, values[..., :3], values[..., 3:], moving, rests, np.array(moves, int))


def _log(device, calibration, session):
    """Return time, six calibrated channels, where it is still, in motion, whole; start, name."""
    files = device.sessions[session]
    quality, table = read_json(files["quality"]), read_columns(files["segments"])
    if quality["status"] != "ok" or not len(table["kind"]):
        raise ImuloopError(f"{device.name} has no log that can be used")
    samples = read_samples(files["samples"])
    t, steps = samples[TIME].to_numpy(), np.diff(samples[TIME])
    whole = ~np.append(steps > BRIDGED * np.median(steps), False)
    for quantity, names in (("acceleration", ACCELERATION), ("angular_rate", ANGULAR_RATE)):
        most = CLIPPED_SHARE * device.full_scale.get(quantity, np.inf)
        whole &= (samples[list(names)].abs() < most).all(axis=1).to_numpy()
    kind = table["kind"][np.searchsorted(table["end_s"][:-1], t, side="right")]
    values = calibration.apply(samples)[[*ACCELERATION, *ANGULAR_RATE]].to_numpy()
    return t, values, (kind == STATIC, kind == MOTION, whole), quality["start"], device.name


def _offset(first, other):
    """Return what is to be added to another log's time, s.

    By the dates at which both start, where they have one, and by the magnitude of the angular rate,
    which is the same on all axes: a counter does not say when it began.
    """
    apart = 0.0
    if first[3] and other[3]:
        apart = (pd.Timestamp(other[3]) - pd.Timestamp(first[3])).total_seconds()
    t, late, step = first[0], other[0] + apart, np.median(np.diff(first[0]))
    grid = np.arange(max(t[0], late[0]), min(t[-1], late[-1]), step)
    if len(grid) < 2:
        raise ImuloopError(f"{other[4]} and {first[4]} were not recorded at the same time")
    x, y = (
        np.interp(grid, own, np.linalg.norm(log[1][:, 3:], axis=1))
        for own, log in ((t, first), (late, other))
    )
    x, y = x - x.mean(), y - y.mean()
    both = np.pad(correlate(x, y), 1)
    k = both.argmax()
    if not both[k] > LEAST_CORRELATION * np.sqrt(x @ x * (y @ y)):
        raise ImuloopError(f"{other[4]} and {first[4]} do not turn alike, if at all")
    before, most, after = both[k - 1 : k + 2]
    part = (before - after) / (before - 2 * most + after) / 2
    return apart + (k - len(grid) + (part if abs(part) > SAME_CLOCK else 0.0)) * step
