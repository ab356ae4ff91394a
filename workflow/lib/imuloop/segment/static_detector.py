"""Static detector: rests by windowed variance and mean rate of both sensors."""

from dataclasses import dataclass

import numpy as np

from imuloop.segment.stretches import runs
from imuloop.segment.windows import DECIDING, rounding_variance, sliding_statistics

# samples of a rest: the variance of fewer says nothing of its mean's error
FEWEST_SAMPLES = 4


@dataclass(frozen=True)
class Activity:
    """How much moves about each sample.

    Attributes
    ----------
    accelerometer, gyroscope : ndarray, shape (n,)
        Sum of the three windowed variances, (m/s²)² and (rad/s)²; infinite where no whole window
        fits between two gaps, the accelerometer's also where it reads zero on all axes. The paper
        takes the root of the sum of their squares, which depends on how the sensor's frame lies;
        the sum does not, and a multiple of it means the same.
    rate : tuple of 3 ndarray, shape (n,)
        Windowed mean angular rate about each axis, rad/s.
    window : int
        Samples in a window.
    """

    accelerometer: np.ndarray
    gyroscope: np.ndarray
    rate: tuple
    window: int


@dataclass(frozen=True)
class RestLevel:
    """What the windows show when the device rests.

    Attributes
    ----------
    accelerometer, gyroscope : float
        Sum of the three variances, (m/s²)² and (rad/s)².
    rate : ndarray, shape (3,)
        Mean angular rate, rad/s: the bias.
    source : str
        "initial rest" or "quietest windows".
    duration_s : float
        Length of the initial rest used, s; 0 where there is none.
    """

    accelerometer: float
    gyroscope: float
    rate: np.ndarray
    source: str
    duration_s: float


def activity(force, rate, stretches, window):
    """Return the activity of a session; no window reaches across a gap.

    Parameters
    ----------
    force, rate : ndarray, shape (3, n)
        Specific force, m/s², and angular rate, rad/s.
    stretches : array_like of int, shape (k, 2)
        Stretches without a gap.
    window : int
        Window length, samples.
    """
    variances = np.full((2, force.shape[1]), np.inf)
    means = np.zeros_like(rate)
    for i, j in stretches:
        if j - i < window:
            continue
        # one axis at a time, as a log of hours takes memory
        variances[:, i:j] = 0.0
        for f, w, mean in zip(force, rate, means, strict=True):
            variances[0, i:j] += sliding_statistics(f[i:j], window)[1]
            mean[i:j], variance = sliding_statistics(w[i:j], window)
            variances[1, i:j] += variance
    # one that reads zero was not read: at rest it feels gravity
    variances[0, ~force.any(axis=0)] = np.inf
    return Activity(*variances, means, window)


def rest_level(force, rate, moving, step, settings):
    """Return the level of rest of a session.

    The quiet level of a sensor is the 5 % quantile of its windowed variance, the median of the
    quietest tenth: right as long as a tenth of the log is at rest. If the log's windows stay
    within the largest accelerometer multiple of the quiet level, both sensors together, for ten
    windows from its first sample, it begins with a rest; that rest, up to where it ends or to
    `initial_rest_s`, then sets the level as in the paper. If not, the quiet level is the level.
    No level is below the variance of rounding. The bias is the median over all windows that are
    at rest by this level, whatever their attitude.

    Parameters
    ----------
    force, rate : ndarray, shape (3, n)
        Specific force, m/s², and angular rate, rad/s.
    moving : Activity
        Its activity.
    step : float
        Median step of time, s.
    settings : SegmentSettings
        Window, longest initial rest, multiples.

    Returns
    -------
    RestLevel or None
        None where no whole window fits into the log.

    References
    ----------
    Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
    without external equipments", ICRA 2014, section IV-A.
    """
    whole = np.isfinite(moving.accelerometer)
    if not whole.any():
        return None
    sensors = (moving.accelerometer, force), (moving.gyroscope, rate)
    floors = [3 * rounding_variance(x[:, :DECIDING].T) for _, x in sensors]
    levels = [
        max(np.quantile(v[whole], 0.05), floor)
        for (v, _), floor in zip(sensors, floors, strict=True)
    ]

    factor = max(settings.accelerometer_multiples)
    quiet = (moving.accelerometer <= factor * levels[0]) & (moving.gyroscope <= factor * levels[1])
    length = int(np.argmin(quiet)) if not quiet.all() else len(quiet)
    length = min(length, round(settings.initial_rest_s / step))
    source = "quietest windows"
    if length >= 10 * moving.window:
        source = "initial rest"
        levels = [
            max(x[:, :length].var(axis=1).sum(), floor)
            for (_, x), floor in zip(sensors, floors, strict=True)
        ]
        quiet = (moving.accelerometer <= factor * levels[0]) & (
            moving.gyroscope <= factor * levels[1]
        )
    return RestLevel(
        accelerometer=float(levels[0]),
        gyroscope=float(levels[1]),
        rate=np.array([np.median(r[quiet]) for r in moving.rate]) if quiet.any() else np.zeros(3),
        source=source,
        duration_s=length * step if source == "initial rest" else 0.0,
    )


def slow(moving, level, settings):
    """Tell whether the windowed mean rate about each sample is that of rest, shape (n,)."""
    away = sum((r - bias) ** 2 for r, bias in zip(moving.rate, level.rate, strict=True))
    return np.sqrt(away) <= settings.rate_tolerance


def detect_rests(moving, level, is_slow, multiples, stretches, step, settings):
    """Return the rests of a session for a pair of multiples.

    A sample is at rest if the windowed variances of both sensors are within
    their multiples of the level, and the windowed mean rate is within `rate_tolerance` of the
    bias: a slow turn about the vertical shows in nothing else. Edges that touch motion are
    trimmed.

    Parameters
    ----------
    moving, level : Activity, RestLevel
        Of the session.
    is_slow : ndarray of bool, shape (n,)
        Of the session, from `slow`.
    multiples : pair of float
        Of the accelerometer's and the gyroscope's variance at rest.
    stretches : array_like of int, shape (k, 2)
        Stretches without a gap.
    step : float
        Median step of time, s.
    settings : SegmentSettings
        Tolerance, trim, shortest rest.

    Returns
    -------
    rests : ndarray of int, shape (m, 2)
        Half-open ranges of samples, in order of time.
    short : int
        Number of rests dropped because they are shorter than asked.
    """
    still = (moving.accelerometer <= multiples[0] * level.accelerometer) & (
        moving.gyroscope <= multiples[1] * level.gyroscope
    )
    still &= is_slow
    trim = round(settings.trim_s / step)
    rests = [np.empty((0, 2), dtype=int)]
    for i, j in stretches:
        found = runs(still[i:j]) + i
        found[found[:, 0] > i, 0] += trim
        found[found[:, 1] < j, 1] -= trim
        rests.append(found)
    rests = np.concatenate(rests)
    samples = np.diff(rests, axis=1).ravel()
    long_enough = samples * step >= settings.shortest_rest_s - step / 2
    long_enough &= samples >= FEWEST_SAMPLES
    return rests[long_enough], int(np.sum(~long_enough))
