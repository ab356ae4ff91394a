"""Summary figures of a static record, by which devices are compared."""

import numpy as np

from imuloop.core.samples import ACCELERATION, CHANNELS

# attitudes of sessions whose mean specific force may be compared, rad
SAME_ATTITUDE = np.radians(1.0)
# lengths of the consecutive means, s
MEANS = {"std_10s": 10.0, "std_100s": 100.0}


def summary(stretches, rate):
    """Return summary figures of one axis of clean output, any unit.

    mean and std of the samples; std_10s and std_100s, the standard deviation of means in turn over
    10 s and 100 s. None where a figure needs more data.
    """
    x = np.concatenate(stretches)
    figures = {"mean": x.mean(), "std": x.std(ddof=1) if len(x) > 1 else None}
    for name, seconds in MEANS.items():
        means = consecutive_means(stretches, round(seconds * rate))
        figures[name] = means.std(ddof=1) if len(means) > 1 else None
    return {name: None if value is None else float(value) for name, value in figures.items()}


def consecutive_means(stretches, count):
    """Return means over `count` samples, one after the other, none over a stretch's end."""
    whole = [x[: len(x) // count * count] for x in stretches] if count else []
    return np.concatenate([[], *(x.reshape(-1, count).mean(axis=1) for x in whole)])


def repeatability(means):
    """Return the scatter of the mean output over sessions.

    The sample standard deviation of the means of the static sessions. Gravity enters the
    accelerometer's mean with the attitude, so its axes count only where all sessions point the
    same way within 1 degree; what is left of that, g times the difference in angle, is part of
    the figure. Earth's rate enters the gyroscope's mean likewise, with 7.3e-5 rad/s at most.

    Takes for each static session the mean of each axis, SI. Gives for each axis `std` and the
    number of `sessions`, None for the accelerometer's where attitudes differ; None as a whole with
    fewer than two sessions. An axis that a session lacks has no figure.
    """
    if len(means) < 2:
        return None
    f = np.array([[each.get(axis, 0.0) for axis in ACCELERATION] for each in means.values()])
    # not from the cosine, whose digits end at 1e-8 rad; a force of zero points nowhere
    angle = np.arctan2(np.linalg.norm(np.cross(f[:, None], f), axis=-1), f @ f.T)
    comparable = f.any(axis=1).all() and np.all(angle <= SAME_ATTITUDE)
    figures = {}
    for axis in (a for a in CHANNELS if all(a in each for each in means.values())):
        own = np.array([each[axis] for each in means.values()])
        known = comparable or axis not in ACCELERATION
        figures[axis] = {"std": float(own.std(ddof=1)), "sessions": len(own)} if known else None
    return figures
