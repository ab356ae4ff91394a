"""Segment: the one entry of the stage, from samples to segments."""

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TIME
from imuloop.core.segments import DISTURBED, GAP, MOTION, STATIC, segment_table
from imuloop.segment.disturbance import disturbed_samples, undisturbed
from imuloop.segment.multiples import choose_multiples
from imuloop.segment.poses import number_poses
from imuloop.segment.static_detector import activity, detect_rests, rest_level
from imuloop.segment.stretches import unbroken


def segment_session(samples, kind, settings):
    """Return the segments of a session: static, motion, disturbed or gap.

    Every instant from the first sample to one step after the last belongs to exactly one row.
    Rests of a six-position or multi-position session come from the static detector with the
    multiples whose poses calibrate best; those of a static session are what the disturbance
    detector leaves. A gap lasts from one step after the last sample before it to the next sample.

    Parameters
    ----------
    samples : DataFrame
        Samples of the session, SI.
    kind : str
        "static", "six_position" or "multi_position".
    settings : SegmentSettings
        What is asked of a rest.

    Returns
    -------
    segments : DataFrame
        As `imuloop.core.segments.segment_table` gives it.
    metadata : dict
        Level of rest and how it was found, the multiples and the table they were chosen from,
        number of rests dropped as too short, gaps and, of a static session, the scales searched.
    """
    t = samples[TIME].to_numpy()
    stretches, step = unbroken(t, settings.gap_factor)
    if kind == "static":
        x = samples[list(CHANNELS)].to_numpy()
        disturbed, metadata = disturbed_samples(x, stretches, step, settings)
        rests = undisturbed(disturbed, stretches)
        between = DISTURBED
    else:
        rests, metadata = _find_rests(samples, stretches, step, settings)
        between = MOTION
    f = samples[list(ACCELERATION)].to_numpy()
    w = samples[list(ANGULAR_RATE)].to_numpy()
    poses = number_poses(t, f, w, rests, stretches, settings)

    edges, kinds, numbers = [], [], []

    def append(first, last, kind, pose=-1):
        if last > first:
            edges.append((first, last))
            kinds.append(kind)
            numbers.append(pose)

    # one step after the last sample before a gap, or at the end, its stretch ends
    ends = t[stretches[:, 1] - 1] + step
    stretch_of = np.searchsorted(stretches[:, 0], rests[:, 0], side="right") - 1
    for n, (i, j) in enumerate(stretches):
        now = t[i]
        for k in np.flatnonzero(stretch_of == n):
            first, last = rests[k]
            append(now, t[first], between)
            now = ends[n] if last == j else t[last]
            append(t[first], now, STATIC, int(poses[k]))
        append(now, ends[n], between)
        if n + 1 < len(stretches):
            append(ends[n], t[stretches[n + 1, 0]], GAP)
    start, end = np.array(edges).reshape(-1, 2).T
    metadata |= {
        "kind": kind,
        "step_s": step,
        "gaps": max(len(stretches) - 1, 0),
        "poses": int(poses[-1]) + 1 if len(poses) else 0,
    }
    return segment_table(samples, start, end, kinds, numbers), metadata


def _find_rests(samples, stretches, step, settings):
    window = max(2, round(settings.window_s / step))
    moving = activity(samples, stretches, window)
    level = rest_level(samples, moving, step, settings)
    if level is None:
        return np.empty((0, 2), dtype=int), {
            "level": None,
            "multiples": None,
            "choice": [],
            "short_rests": 0,
        }

    def detect(multiples):
        return detect_rests(moving, level, multiples, stretches, step, settings)

    multiples, choice = choose_multiples(
        samples[list(ACCELERATION)].to_numpy(), lambda pair: detect(pair)[0], settings
    )
    # where no pair finds a rest long enough, the widest says how many were too short
    widest = (max(settings.accelerometer_multiples), max(settings.gyroscope_multiples))
    rests, short = detect(multiples or widest)
    return rests, {
        "level": {
            "source": level.source,
            "duration_s": level.duration_s,
            "accelerometer_variance": level.accelerometer,
            "gyroscope_variance": level.gyroscope,
            "rate": level.rate.tolist(),
        },
        "multiples": None if multiples is None else list(multiples),
        "choice": choice,
        "short_rests": short,
    }
