"""Segment: the one entry of the stage, from samples to segments."""

from dataclasses import asdict, replace

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TIME, Samples
from imuloop.core.segments import DISTURBED, GAP, MOTION, STATIC, segment_table
from imuloop.segment.disturbance import undisturbed
from imuloop.segment.multiples import attitudes, choose_multiples, cumulative
from imuloop.segment.poses import number_poses
from imuloop.segment.settings import SegmentSettings
from imuloop.segment.static_detector import (
    activity,
    detect_rests,
    rest_level,
    turns_slowly,
    widened,
)
from imuloop.segment.steady import unsteady_samples
from imuloop.segment.stretches import lengths, unbroken, without
from imuloop.segment.tilt import steady_rests, tilts

# rests that are dropped as too short, at least so many and this share of those kept, make it worth
# to look what shorter settings would bring: parts of window_s and shortest_rest_s
LEAST_SHORT, SHORT_SHARE = 5, 0.25
SHORTER = ((1, 0.5), (0.5, 0.5), (0.5, 0.25), (0.25, 0.25))
# attitudes that are worth another setting, and a part of the most that is as good
WORTHWHILE, ALMOST = 1.2, 0.95
# a calibration this much less certain, by its expected error, is too dear for steady rests
DEAREST = 2.0
# multiples of the level and of `rate_tolerance` within which a hand may hold a device, looked at
# where steadier rests give a calibration with more than this error, of g
HAND_MULTIPLES, HAND_RATE, UNCERTAIN = ((20, 50, 100, 200), (1000, 3000)), 3.0, 2e-4
# share of the rests that tilt where a hand holds the device
HELD = 0.5


def segment_session(samples, kind, settings, threads=1):
    """Return the segments of a session: static, motion, disturbed or gap.

    Every instant from the first sample to one step after the last belongs to exactly one row.
    Rests of a six-position or multi-position session come from the static detector with the
    multiples whose poses calibrate best, less what turns slowly or trembles in the hand; those of
    a static session are what the disturbance detector and slow tilts leave. A gap lasts from one
    step after the last sample before it to the next sample. Of a file few row groups are held at
    once where the session is static, else six columns.

    Takes Samples or a DataFrame, SI, the session's kind, SegmentSettings, and how many threads may
    work at once. Gives a `segment_table` and a dict of metadata: level of rest and how it was
    found, the multiples and the table they were chosen from, number of rests dropped as too short,
    what `shorter` settings would bring, gaps and, of a static session, slow tilts.
    """
    rows = Samples(samples)
    stretches, step = unbroken(rows, settings.gap_factor)
    tilt = 0.0
    if kind == "static":
        rests = undisturbed(rows, stretches, step, settings, threads)
        tilted = tilts(rows, rests, step)
        metadata = {"slow_tilts": len(tilted)}
        if len(tilted):
            rests = without(rests, tilted)
            rests = rests[lengths(rests) * step >= settings.shortest_static_s - step / 2]
    else:
        rests, tilt, metadata = _find_rests(rows, stretches, step, settings)

    edges = np.union1d(stretches, rests)
    ranges = np.column_stack([edges[:-1], edges[1:]])
    between = DISTURBED if kind == "static" else MOTION
    kinds = np.where(np.isin(edges[:-1], rests[:, 0]), STATIC, between)
    # a gap is a row without samples
    gaps = stretches[1:, 0]
    at = np.searchsorted(edges, gaps)
    ranges, kinds = np.insert(ranges, at, gaps[:, None], axis=0), np.insert(kinds, at, GAP)
    is_rest, is_gap = kinds == STATIC, kinds == GAP
    # a stretch ends one step after its last sample, and a gap with the next one
    t = rows[TIME]
    ends = dict(zip(stretches[:, 1], t[stretches[:, 1] - 1] + step, strict=True))
    start = t[np.where(is_gap, 0, ranges[:, 0])]
    start[is_gap] = [ends[j] for j in ranges[is_gap, 0]]
    end = np.append(start[1:], [ends[j] for j in stretches[-1:, 1]])

    table = segment_table(rows, start, end, kinds, np.full(len(start), -1))
    poses = number_poses(rows, ranges[is_rest], table[is_rest], stretches, settings)
    table.loc[is_rest, "pose"] = poses
    table.loc[is_rest, "tilt_rad"] = tilt
    metadata |= {
        "kind": kind,
        "step_s": step,
        "gaps": max(len(stretches) - 1, 0),
        "poses": int(poses.max(initial=-1)) + 1,
    }
    return table, metadata


def no_segments(kind):
    """Return the segments of a session of a kind that has none, as `segment_session` does."""
    return segment_session({name: [] for name in (TIME, *CHANNELS)}, kind, SegmentSettings())


def _find_rests(rows, stretches, step, settings):
    """Return the rests of a session, the tilt within each, rad, and the metadata."""
    f, w = (rows.read(axes, 0, len(rows)) for axes in (ACCELERATION, ANGULAR_RATE))
    rests, metadata = _detected(f, w, stretches, step, settings)
    found, tilt, metadata = _steady(f, w, rests, stretches, step, metadata)
    metadata |= {"shorter": None, "hand_held": False}
    if len(rests) and (certain := _lowest(metadata["choice"])) > UNCERTAIN:
        by_hand, more = _detected(f, w, stretches, step, _of_a_hand(settings))
        if DEAREST * _lowest(more["choice"]) < certain:
            held, sway, more = _steady(f, w, by_hand, stretches, step, more)
            # what only moves slowly turns by more than what it tilts
            if np.mean(sway > 0) > HELD:
                rests, found, tilt = by_hand, held, sway
                metadata |= more | {"hand_held": True}
    short = metadata["short_rests"]
    if short < LEAST_SHORT or short <= SHORT_SHARE * len(rests):
        return found, tilt, metadata
    total, tried, kept = cumulative(f), [], found
    now = len(attitudes(total, rests, settings.same_attitude))
    for window, shortest in SHORTER:
        each = {
            "window_s": window * settings.window_s,
            "shortest_rest_s": shortest * settings.shortest_rest_s,
        }
        found, _ = _detected(f, w, stretches, step, replace(settings, **each))
        found = len(attitudes(total, found, settings.same_attitude))
        tried.append({**each, "attitudes": found, "now": now})
    most = max(each["attitudes"] for each in tried)
    if most >= WORTHWHILE * max(now, 1):
        # the longest that find nearly as many
        good = (each for each in tried if each["attitudes"] >= ALMOST * most)
        metadata["shorter"] = next(good)
    return kept, tilt, metadata


def _steady(f, w, rests, stretches, step, metadata):
    """Return rests without the ends that tilt, the tilt within each, and the metadata with both."""
    if not len(rests):
        return rests, np.zeros(0), metadata | {"settling_s": 0.0, "tilted_rests": 0}
    wide = widened(f, w, rests, stretches, step)
    found, tilt = steady_rests(f, w, wide, metadata["level"]["rate"], step)
    cut = float((lengths(wide) - lengths(found)).sum() * step)
    return found, tilt, metadata | {"settling_s": cut, "tilted_rests": int((tilt > 0).sum())}


def _of_a_hand(settings):
    """Return the settings that find the rests of a device held in the hand."""
    force, rate = HAND_MULTIPLES
    return replace(
        settings,
        accelerometer_multiples=(*settings.accelerometer_multiples, *force),
        gyroscope_multiples=(*settings.gyroscope_multiples, *rate),
        rate_tolerance=HAND_RATE * settings.rate_tolerance,
    )


def _detected(f, w, stretches, step, settings):
    """Return the rests of a session by its specific force and angular rate, and the metadata."""
    moving = activity(f, w, stretches, max(2, round(settings.window_s / step)))
    level = rest_level(f, w, moving, step, settings)
    if level is None:
        nothing = {"level": None, "multiples": None, "choice": [], "short_rests": 0}
        return np.empty((0, 2), dtype=int), nothing
    variances = level.accelerometer_variance, level.gyroscope_variance

    def found(may_rest, multiples):
        still = moving.within(multiples, variances) & may_rest
        return detect_rests(still, stretches, step, settings)

    def choose(may_rest):
        return choose_multiples(f, lambda pair: found(may_rest, pair)[0], settings)

    may_rest = turns_slowly(moving, level.rate, settings.rate_tolerance)
    # where no pair finds a rest long enough, the widest says how many were too short
    widest = (max(settings.accelerometer_multiples), max(settings.gyroscope_multiples))
    steady = may_rest & ~unsteady_samples(w, found(may_rest, widest)[0], step, settings)
    multiples, choice = choose(may_rest)
    rests, short = found(may_rest, multiples or widest)
    steady_multiples, steady_choice = choose(steady)
    # without its unsteady rests a session may no longer determine a calibration
    if steady_multiples and _lowest(steady_choice) <= DEAREST * _lowest(choice):
        multiples, choice = steady_multiples, steady_choice
        rests, _ = found(steady, multiples)
    return rests, {
        "level": asdict(level),
        "multiples": None if multiples is None else list(multiples),
        "choice": choice,
        "short_rests": short,
    }


def _lowest(choice):
    return min((row["expected_error"] for row in choice), default=np.inf)
