"""Poses and the rotations between them, gathered from the segments of all sessions."""

from dataclasses import dataclass, fields

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TEMPERATURE, TIME
from imuloop.core.segments import GAP, STATIC


@dataclass(frozen=True)
class Poses:
    """Means over static poses.

    Attributes
    ----------
    session : ndarray of int, shape (n,)
        Which session each pose belongs to.
    start_s, end_s : ndarray, shape (n,)
        First and last instant, s on the session's clock.
    duration_s : ndarray, shape (n,)
        Seconds at rest, less than end - start where a rest was interrupted.
    n : ndarray of int, shape (n,)
        Samples.
    f, w : ndarray, shape (n, 3)
        Mean specific force (m/s^2) and angular rate (rad/s), SI as logged.
    variance : ndarray, shape (n, 6)
        Sample variance of the six channels within the pose.
    temperature : ndarray, shape (n,), or None
        Mean temperature, degC; None unless every session logs one.
    """

    session: np.ndarray
    start_s: np.ndarray
    end_s: np.ndarray
    duration_s: np.ndarray
    n: np.ndarray
    f: np.ndarray
    w: np.ndarray
    variance: np.ndarray
    temperature: np.ndarray | None

    def __len__(self):
        return len(self.n)

    def select(self, keep):
        """Return the poses of an index or mask."""
        return selected(self, keep)

    @property
    def mid_s(self):
        """Middle of each pose, s."""
        return (self.start_s + self.end_s) / 2

    def mean_covariance(self, noise):
        """Return the covariance of the pose means that the noise model predicts.

        Sessions are independent. An axis whose noise is not known gets the white part alone, the
        variance within the pose over its samples.

        Parameters
        ----------
        noise : NoiseModel
            Noise of the device.

        Returns
        -------
        ndarray, shape (6, n, n)
            SI units squared, in the order ax … gz.
        """
        # loads for a fifth of a second, and who only gathers poses has no need of it
        from scipy.linalg import block_diag

        half = self.duration_s / 2
        windows = np.column_stack([self.mid_s - half, self.mid_s + half])
        parts = [
            noise.pose_mean_covariance(windows[self.session == s]) for s in np.unique(self.session)
        ]
        if not parts:
            return np.zeros((6, 0, 0))
        whole = np.array([block_diag(*(part[axis] for part in parts)) for axis in range(6)])
        for axis in range(6):
            if not np.any(whole[axis]):
                whole[axis] = np.diag(self.variance[:, axis] / self.n)
        return whole

    def unknown_noise(self, noise, channels):
        """Return why means of some channels cannot be weighted, or None if they can.

        Parameters
        ----------
        noise : NoiseModel
            Noise of the device.
        channels : tuple of str
            Channels of one sensor.
        """
        variance = np.diagonal(self.mean_covariance(noise), axis1=1, axis2=2)
        silent = [c for c, v in zip(CHANNELS, variance, strict=True) if not np.all(v > 0)]
        silent = [c for c in silent if c in channels]
        if not silent:
            return None
        return f"{', '.join(silent)} never changes within a pose: its noise is not known"


@dataclass(frozen=True)
class Rotations:
    """Angular rate between consecutive poses, padded to one length with steps of zero.

    Attributes
    ----------
    first : ndarray of int, shape (m,)
        Pose that each rotation starts from; it ends at the next.
    start_s, end_s : ndarray, shape (m,)
        First and last sample, s.
    t : ndarray, shape (m, k)
        Time of the samples, s.
    w, f : ndarray, shape (m, k, 3)
        Angular rate (rad/s) and specific force (m/s^2), SI as logged.
    temperature : ndarray, shape (m, k), or None
        Temperature, degC.
    """

    first: np.ndarray
    start_s: np.ndarray
    end_s: np.ndarray
    t: np.ndarray
    w: np.ndarray
    f: np.ndarray
    temperature: np.ndarray | None

    def __len__(self):
        return len(self.first)

    @property
    def steps(self):
        """Time steps, s, shape (m, k - 1); zero where padded."""
        return np.diff(self.t, axis=1)

    def select(self, keep):
        """Return the rotations of an index or mask."""
        return selected(self, keep)


def selected(table, keep):
    """Return a copy of a dataclass of arrays with the chosen rows."""
    columns = {f.name: getattr(table, f.name) for f in fields(table)}
    return type(table)(**{k: None if v is None else v[keep] for k, v in columns.items()})


def gather_poses(segments):
    """Return the poses of several sessions; rests that share a number are one pose.

    Parameters
    ----------
    segments : sequence of DataFrame
        Segments of each session.

    Returns
    -------
    Poses
        In order of session and time.
    """
    rows = []
    for session, table in enumerate(segments):
        static = table[(table["kind"] == STATIC) & (table["pose"] >= 0)]
        rows += [(session, group) for _, group in static.groupby("pose", sort=True)]

    def pooled(column):
        means = [np.average(g[column], weights=g["n"]) for _, g in rows]
        return np.array(means, dtype=float)

    def vectors(channels):
        return np.array([pooled(f"{c}_mean") for c in channels]).T.reshape(len(rows), len(channels))

    variance = [[np.average(g[f"{c}_std"] ** 2, weights=g["n"]) for c in CHANNELS] for _, g in rows]
    return Poses(
        session=np.array([s for s, _ in rows], dtype=int),
        start_s=np.array([g["start_s"].min() for _, g in rows]),
        end_s=np.array([g["end_s"].max() for _, g in rows]),
        duration_s=np.array([(g["end_s"] - g["start_s"]).sum() for _, g in rows]),
        n=np.array([g["n"].sum() for _, g in rows], dtype=int),
        f=vectors(ACCELERATION),
        w=vectors(ANGULAR_RATE),
        variance=np.array(variance).reshape(len(rows), len(CHANNELS)),
        temperature=None,
    )


def gather_rotations(poses, samples, segments, longest_s):
    """Return the rotations between consecutive poses of the same session.

    A rotation runs from the last sample of a pose to the first of the next. It is left out where
    it lasts longer than asked or a gap interrupts it.

    Parameters
    ----------
    poses : Poses
        Poses of the sessions.
    samples, segments : sequence of DataFrame
        Samples and segments of each session.
    longest_s : float
        Seconds.

    Returns
    -------
    Rotations
        In the order of the poses.
    """
    pieces = []
    for k in range(len(poses) - 1):
        session = poses.session[k]
        if poses.session[k + 1] != session:
            continue
        start, end = poses.end_s[k], poses.start_s[k + 1]
        table, log = segments[session], samples[session]
        gaps = table[table["kind"] == GAP]
        if end - start > longest_s or ((gaps["start_s"] < end) & (gaps["end_s"] > start)).any():
            continue
        t = log[TIME].to_numpy()
        # `end_s` is open: the pose's last sample is the one before it
        piece = slice(np.searchsorted(t, start) - 1, np.searchsorted(t, end) + 1)
        pieces.append((k, log.iloc[piece]))
    length = max((len(p) for _, p in pieces), default=2)

    def padded(columns):
        # the last sample repeated: steps of zero, rates that are finite
        arrays = [p[columns].to_numpy() for _, p in pieces]
        arrays = [np.concatenate([a, np.repeat(a[-1:], length - len(a), axis=0)]) for a in arrays]
        shape = (len(pieces), length) + ((len(columns),) if isinstance(columns, list) else ())
        return np.array(arrays, dtype=float).reshape(shape)

    t = padded(TIME)
    return Rotations(
        first=np.array([k for k, _ in pieces], dtype=int),
        start_s=t[:, 0],
        end_s=t[:, -1],
        t=t,
        w=padded(list(ANGULAR_RATE)),
        f=padded(list(ACCELERATION)),
        temperature=padded(TEMPERATURE) if poses.temperature is not None else None,
    )
