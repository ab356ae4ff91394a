"""Segment: the one entry of the stage, from samples to segments."""

from dataclasses import replace

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TIME
from imuloop.core.segments import DISTURBED, GAP, MOTION, STATIC, segment_table
from imuloop.segment.disturbance import disturbed_samples, undisturbed
from imuloop.segment.multiples import choose_multiples
from imuloop.segment.poses import number_poses
from imuloop.segment.static_detector import activity, detect_rests, rest_level
from imuloop.segment.steady import unsteady_samples
from imuloop.segment.stretches import unbroken

# a calibration this much less certain, by its expected error, is too dear for steady rests
DEAREST = 2.0


def segment_session(samples, kind, settings):
    """Return the segments of a session: static, motion, disturbed or gap.

    Every instant from the first sample to one step after the last belongs to exactly one row.
    Rests of a six-position or multi-position session come from the static detector with the
    multiples whose poses calibrate best, less what turns slowly or trembles in the hand; those of
    a static session are what the disturbance detector leaves. A gap lasts from one step after the
    last sample before it to the next sample.

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
        number of rests dropped as too short, `unsteady`: what turned or trembled (`_losses`), gaps
        and, of a static session, the scales searched.
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
            "unsteady": None,
        }
    f = samples[list(ACCELERATION)].to_numpy()
    w = samples[list(ANGULAR_RATE)].to_numpy()

    def choose(moving):
        def detect(pair):
            return detect_rests(moving, level, pair, stretches, step, settings)[0]

        return choose_multiples(f, detect, settings)

    # where no pair finds a rest long enough, the widest says how many were too short
    widest = (max(settings.accelerometer_multiples), max(settings.gyroscope_multiples))
    rests, _ = detect_rests(moving, level, widest, stretches, step, settings)
    unsteady = unsteady_samples(w, rests, step, settings)
    steady = replace(moving, accelerometer=np.where(unsteady.either, np.inf, moving.accelerometer))
    multiples, choice = choose(moving)
    rests, short = detect_rests(moving, level, multiples or widest, stretches, step, settings)
    every = rests
    steady_multiples, steady_choice = choose(steady)
    # without its unsteady rests a session may no longer determine a calibration
    applied = steady_multiples and _lowest(steady_choice) <= DEAREST * _lowest(choice)
    if applied:
        multiples, choice = steady_multiples, steady_choice
        rests, _ = detect_rests(steady, level, multiples, stretches, step, settings)
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
        "unsteady": {"applied": bool(applied), **_losses(unsteady, every, rests, step)},
    }


def _lowest(choice):
    return min((row["expected_error"] for row in choice), default=np.inf)


def _losses(unsteady, every, left, step):
    """Return what turned or trembled in all rests of the detector, and what it cost.

    Number of rests `dropped_turning`, `dropped_trembling` (by which of the two lasted longer) and
    `cut`, shortened or split; `turning_s` and `trembling_s` of all rests, s, which may overlap; the
    bounds of `Unsteady`. Where `applied` is false, nothing was dropped: see `DEAREST`.
    """
    counts = dict.fromkeys(("dropped_turning", "dropped_trembling", "cut"), 0)
    turning = trembling = 0
    for i, j in every:
        turns, trembles = unsteady.turning[i:j].sum(), unsteady.trembling[i:j].sum()
        turning += int(turns)
        trembling += int(trembles)
        if turns or trembles:
            kept = np.any((left[:, 0] < j) & (left[:, 1] > i))
            cause = "turning" if turns >= trembles else "trembling"
            counts["cut" if kept else f"dropped_{cause}"] += 1
    return {
        **counts,
        "turning_s": turning * step,
        "trembling_s": trembling * step,
        "turning_bounds": unsteady.turning_bounds,
        "trembling_bound": unsteady.trembling_bound,
    }
