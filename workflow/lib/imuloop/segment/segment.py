"""The segment stage: from samples to segments."""

from dataclasses import replace

import numpy as np

from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    CHANNELS,
    OWN_TIME,
    TIME,
    Samples,
    at_rail,
    holds,
    own_rows,
)
from imuloop.core.segments import DISTURBED, GAP, MOTION, STATIC, segment_table
from imuloop.core.stretches import lengths, merged, unbroken, without
from imuloop.segment.attitudes import attitudes, expected_error
from imuloop.segment.disturbance import undisturbed
from imuloop.segment.held import held_rests, sways, united
from imuloop.segment.poses import number_poses
from imuloop.segment.static_detector import (
    MULTIPLES,
    activity,
    detect_rests,
    moves,
    rates_at_rest,
    widened,
)
from imuloop.segment.steady import unsteady_samples
from imuloop.segment.tilt import tilts, without_tilts

# rests that are dropped as too short, at least so many and this share of those kept, make it worth
# to look what shorter settings would bring
LEAST_SHORT, SHORT_SHARE = 5, 0.25
# attitudes, of those found, that are worth another setting
WORTHWHILE = 1.2
# attitudes that determine an accelerometer's nine parameters, with one for a check
ENOUGH = 12
# a calibration this much less certain, by its expected error, is too dear for steady rests
DEAREST = 2.0
# expected error with rests in the hand, of that without, below which they are worth it
WORTH_HOLDING = 0.95
# share of a rest's samples at the end of the range up to which its mean is a mean: what the noise
# has beyond is 0.3 % of its standard deviation
LEAST_RAILED = 0.01
# sessions whose rests are attitudes that the specific force is taken at
ATTITUDES = ("six_position", "multi_position", "reference_motion")


def segment_session(samples, kind, settings, rails=None, stuck=()):
    """Return the segments of a session: static, motion, disturbed or gap.

    Every instant from the first sample to one step after the last belongs to exactly one row.
    Rests of a six-position or multi-position session come from the static detector, less what turns
    slowly or trembles; those in the hand (`held`) join them where a calibration gains by it. Those
    of a static session are what the disturbance detector and slow tilts leave. If the device moves
    most of the time, the rests of a static session come from the static detector, too. A rest at
    which the accelerometer is at the end of its range is no attitude, but disturbed. A gap lasts
    from one step after the last sample before it to the next sample, or as long as a channel is
    stuck at one value.

    Takes Samples or a DataFrame, SI, the session's kind, SegmentSettings, the `rails` of
    `core.samples.at_rail`, and the spans in which a channel is stuck, (n, 2), s. Gives a
    `segment_table` and a dict of metadata: the number of poses; of a static session that of slow
    tilts; of others the rests dropped as too short, those at the end of the range and those that
    tilt, whether some are in the hand, and what `shorter` settings would bring, or have brought.
    """
    rows = Samples(samples)
    whole, step = unbroken(rows)
    stretches = whole
    if len(stuck):
        first, last = np.searchsorted(rows[TIME], np.transpose(stuck))
        stretches = without(whole, merged(np.column_stack([first, last + 1])))
    # without specific force there is no attitude, and rests are stretches without a disturbance
    posed = kind != "static" and holds(rows, "accelerometer")
    moving = not posed and moves(rows, stretches, step, settings)
    # no disturbance stands out from motion: rests are found as in other sessions
    posed = posed or (moving and holds(rows, "accelerometer"))
    if posed:
        rests, tilt, metadata = _find_rests(rows, stretches, step, settings)
        if moving:
            # on a support it does not tilt; without a gyroscope turns show in the force alone
            rests = rests[tilt == 0]
            rests = rests[: 0 if moves(rows, rests, step, settings) else None]
            tilt = np.zeros(len(rests))
    else:
        rests = _between_disturbances(rows, stretches[: 0 if moving else None], step, settings)
        tilted = tilts(rows, rests, step)
        if len(tilted):
            rests = without(rests, tilted)
            rests = rests[lengths(rests) * step >= settings.shortest_static_s - step / 2]
        tilt, metadata = np.zeros(len(rests)), {"slow_tilts": len(tilted)}
    railed = np.zeros(len(rests), dtype=bool)
    if rails and kind in ATTITUDES:
        railed = _at_rail(rows, rests, rails)
        metadata["railed_rests"] = int(railed.sum())

    t, edges = rows[TIME], np.union1d(np.concatenate([whole, stretches]), rests)
    between = MOTION if posed else DISTURBED
    kinds = np.where(np.isin(edges[:-1], rests[:, 0]), STATIC, between)
    kinds = np.where(np.isin(edges[:-1], rests[railed, 0]), DISTURBED, kinds)
    rests, tilt = rests[~railed], tilt[~railed]
    if len(stuck):
        hung = without(whole, merged(stretches)) if len(stretches) else whole
        kinds = np.where(np.isin(edges[:-1], hung[:, 0]), GAP, kinds)
    # a stretch ends one step after its last sample
    first, last = edges[:-1], np.isin(edges[1:], whole[:, 1])
    end = np.where(last, t[edges[1:] - 1] + step, t[np.minimum(edges[1:], len(t) - 1)])
    # a gap is a row without samples, from there to the next one
    gaps = np.flatnonzero(last[:-1]) + 1
    start, end = np.insert(t[first], gaps, end[gaps - 1]), np.insert(end, gaps, t[first[gaps]])
    kinds = np.insert(kinds, gaps, GAP)

    table = segment_table(rows, start, end, kinds, np.full(len(start), -1))
    is_rest = kinds == STATIC
    poses = number_poses(rows, rests, table[is_rest], stretches)
    table.loc[is_rest, "pose"] = poses
    table.loc[is_rest, "tilt_rad"] = tilt
    return table, metadata | {"poses": int(poses.max(initial=-1)) + 1}


def _between_disturbances(rows, stretches, step, settings):
    """Return the ranges between disturbances; of two clocks in rows of the slower sensor's samples.

    Beside each is the mean of the faster sensor meanwhile. Values that are held over several rows
    would look like noise that comes and goes.
    """
    x = rows.read(CHANNELS, 0, len(rows))
    own = next((name for name in OWN_TIME.values() if name in rows), None)
    if own is None:
        return undisturbed(x, stretches, step, settings)
    t, first = rows[TIME], own_rows(rows[own])
    edges = np.append(first, len(rows))
    means, step = np.add.reduceat(x, first, axis=1) / np.diff(edges), np.median(np.diff(t[first]))
    return edges[undisturbed(means, np.searchsorted(first, stretches), step, settings)]


def _at_rail(rows, rests, rails):
    """Return at which rests the specific force is at the end of its range, (n,) of bool."""
    names = (TIME, *ACCELERATION)
    logs = (dict(zip(names, rows.read(names, *rest), strict=True)) for rest in rests.tolist())
    shares = [at_rail(log, rails, ACCELERATION).mean() for log in logs]
    return np.array(shares, dtype=float) > LEAST_RAILED


def _find_rests(rows, stretches, step, settings):
    """Return the rests of a session, the tilt within each, rad, and the metadata.

    By shorter settings where those asked for find too few to calibrate by, and the shorter enough.
    """
    f, w = (rows.read(axes, 0, len(rows)) for axes in (ACCELERATION, ANGULAR_RATE))
    log, shorter = (f, w, stretches, step), None
    rests, tilt, held, short = _rests_by(log, settings)
    if short >= LEAST_SHORT and short > SHORT_SHARE * len(rests):
        shorter = _shorter(log, rests, settings)
    if shorter and shorter["taken"]:
        changed = {key: shorter[key] for key in ("window_s", "shortest_rest_s")}
        rests, tilt, held, short = _rests_by(log, replace(settings, **changed))
    return (
        rests,
        tilt,
        {
            "short_rests": short,
            "hand_held": held,
            "tilted_rests": int((tilt > 0).sum()),
            "shorter": shorter,
        },
    )


def _rests_by(log, settings):
    """Return rests, the tilt within each, whether some are in the hand, and how many too short."""
    f, w, stretches, step = log
    detected, steady, bias, short = _detected(log, settings)
    if not len(detected):
        return detected, np.zeros(0), False, short
    least = expected_error(attitudes(f, detected))
    # without its unsteady rests a session may no longer determine a calibration
    for still, most in ((steady, DEAREST * least), (detected, np.inf)):
        rests, tilt = without_tilts(f, w, widened(f, w, still, stretches, step), bias, step)
        found = rests, tilt, False, short
        error = expected_error(attitudes(f, rests))
        every, held = united(rests, held_rests(w, stretches, step, bias, settings.shortest_rest_s))
        with_held = expected_error(attitudes(f, every))
        if held.any() and with_held < WORTH_HOLDING * error:
            swaying = np.zeros(len(every))
            swaying[held] = sways(w, every[held], bias, step)
            swaying[~held] = tilt[np.isin(rests[:, 0], every[~held, 0])]
            error, found = with_held, (every, swaying, True, short)
        if error <= most:
            return found


def _detected(log, settings):
    """Return the rests of a session, those that are steady, the bias, and how many are too short.

    The variance is compared in `static_detector`, the mean rate with its level here.
    """
    f, w, stretches, step = log
    moving = activity(f, w, stretches, max(2, round(settings.window_s / step)))
    biases = rates_at_rest(moving, settings)
    still = moving.within(MULTIPLES) & (moving.away(biases) <= settings.rate_tolerance)
    rests, short = detect_rests(still, stretches, step, settings)
    still &= ~unsteady_samples(w, rests, step, settings)
    return rests, detect_rests(still, stretches, step, settings)[0], biases[0], short


def _shorter(log, rests, settings):
    """Return settings of shorter rests, how many attitudes they bring, and if they are taken.

    None where they bring hardly more.
    """
    shorter = {"window_s": settings.window_s / 2, "shortest_rest_s": settings.shortest_rest_s / 4}
    _, steady, *_ = _detected(log, replace(settings, **shorter))
    now, then = (len(attitudes(log[0], x)) for x in (rests, steady))
    if then < WORTHWHILE * max(now, 1):
        return None
    return {**shorter, "attitudes": then, "now": now, "taken": now < ENOUGH <= then}
