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
    sums_over,
)
from imuloop.core.segments import DISTURBED, GAP, MOTION, STATIC, segment_table
from imuloop.core.stretches import lengths, merged, unbroken, without
from imuloop.segment.attitudes import attitudes, expected_error
from imuloop.segment.disturbance import undisturbed_ranges
from imuloop.segment.held import held_rests, sways, unite
from imuloop.segment.poses import number_poses
from imuloop.segment.static_detector import (
    MULTIPLES,
    activity,
    detect_rests,
    moves,
    rates_at_rest,
    widen_rests,
)
from imuloop.segment.steady import unsteady_samples
from imuloop.segment.tilt import tilts, without_tilts

# number of rests dropped as too short from which on shorter settings are tried, and the divisors
LEAST_SHORT, SHORTER = 5, {"window_s": 2, "shortest_rest_s": 4}
# number of attitudes that are enough to determine an accelerometer's nine parameters, and to check
# them
ENOUGH = 12
# largest ratio of the expected errors of a calibration with steady rests only and with all rests
DEAREST = 2.0
# ratio of the expected errors with rests in the hand and without them, below which they are added
WORTH_HOLDING = 0.95
# largest share of clipped samples of a rest whose mean is used: the mean is then wrong by 0.3 % of
# the standard deviation of the noise
LEAST_RAILED = 0.01
# kinds of sessions whose rests are attitudes
ATTITUDES = ("six_position", "multi_position", "reference_motion")


def segment_session(samples, kind, settings, rails=None, stuck=()):
    """Return the table of segments of a session, and metadata.

    A segment is static, motion, disturbed or a gap. Every instant from the first sample to one step
    after the last belongs to exactly one segment.

    - In a static session, in which the device should lie still, a rest is a range without a
      disturbance and without a slow tilt. If the device moves most of the time, rests are found as
      in other sessions.
    - In other sessions, rests are found by the static detector; ranges in which the device turns
      slowly or trembles are removed. Rests in the hand are added if they improve the calibration.
    - In a session of attitudes, such as ``six_position``, a rest with a clipped specific force is
      disturbed.
    - A gap begins one step after the last sample before it and ends with the next sample. A span in
      which a channel is stuck at one value is a gap, too.

    Parameters
    ----------
    samples : Samples or DataFrame
        The samples of the session, SI.
    kind : str
        Kind of the session, such as ``static`` or ``six_position``.
    settings : SegmentSettings
        Conditions for a rest and for a disturbance.
    rails : dict, optional
        Ends of the measuring range of each channel, (low, high) by name, at which samples are
        clipped; None for an end that no sample reaches.
    stuck : array_like, shape (n, 2), optional
        Start and end of the spans in which a channel is stuck, s.

    Returns
    -------
    DataFrame
        For each segment its start and end, s, kind, number of the pose, number of samples, tilt,
        rad, and mean and standard deviation of each channel, SI.
    dict
        ``poses`` is the number of poses. If rests are found as ranges without a disturbance, there
        is also ``slow_tilts``, the number of slow tilts that are cut out of them. If rests are
        found by the static detector, there are four more keys: ``short_rests`` is the number of
        still stretches that are too short to be rests; ``tilted_rests`` is the number of rests in
        which the device tilts; ``hand_held`` is whether some rests are in the hand; ``shorter`` is
        a dict of the shorter durations that replaced those of the settings, or None if none were
        replaced. A session of attitudes with `rails` also has ``railed_rests``, the number of rests
        with a clipped specific force.
    """
    rows = Samples(samples)
    # ranges of samples between long gaps, and the same without the spans that are stuck
    whole, step = unbroken(rows)
    stuck_rows = np.searchsorted(rows[TIME], np.reshape(stuck, (-1, 2)))
    stretches = without(whole, merged(stuck_rows + np.array([0, 1])))
    # a log without specific force has no attitudes: rests are ranges without a disturbance
    has_force = holds(rows, "accelerometer")
    at_rest = kind == "static" or not has_force
    moving = at_rest and moves(rows, stretches, step, settings)
    # disturbances of a moving device cannot be told from motion: its segments are rests and motion
    has_motion = has_force and (moving or not at_rest)
    if has_motion:
        rests, tilt, metadata = _find_rests(rows, stretches, step, settings)
        if moving:
            # only rests without a tilt count, which are on a support; if most of their time is
            # motion, too, the session has no rests
            rests, tilt = rests[tilt == 0], tilt[tilt == 0]
            if moves(rows, rests, step, settings):
                rests, tilt = rests[:0], tilt[:0]
    else:
        # without specific force, a moving device has no rests
        rests = _between_disturbances(rows, stretches[: 0 if moving else None], step, settings)
        tilted = tilts(rows, rests, step)
        if len(tilted):
            rests = without(rests, tilted)
            rests = rests[lengths(rests) * step >= settings.shortest_static_s - step / 2]
        tilt, metadata = np.zeros(len(rests)), {"slow_tilts": len(tilted)}
    railed = np.zeros(len(rests), dtype=bool)
    if rails and kind in ATTITUDES:
        clipped = at_rail(rows, rails, ACCELERATION).astype(float)
        railed = sums_over(clipped, rests) / lengths(rests) > LEAST_RAILED
        metadata["railed_rests"] = int(railed.sum())
    kinds = np.where(railed, DISTURBED, STATIC).astype(object)
    others = MOTION if has_motion else DISTURBED
    table = _divide(rows, step, whole, stretches, rests, kinds, others)
    is_rest, rests = table["kind"] == STATIC, rests[~railed]
    poses = number_poses(rows, rests, table[is_rest], stretches)
    table.loc[is_rest, "pose"] = poses
    table.loc[is_rest, "tilt_rad"] = tilt[~railed]
    return table, metadata | {"poses": int(poses.max(initial=-1)) + 1}


def _divide(rows, step, whole, stretches, rests, kinds, others):
    """Return the table of the segments into which its rests divide a session, a DataFrame.

    Parameters
    ----------
    rows : Samples
        The samples of the session.
    step : float
        Median time step, s.
    whole : ndarray of int, shape (k, 2)
        Ranges of samples between long gaps.
    stretches : ndarray of int, shape (l, 2)
        The same ranges without the spans in which a channel is stuck at one value. These spans
        become gaps, too.
    rests : ndarray of int, shape (m, 2)
        Ranges of samples of the rests, which lie within the stretches.
    kinds : ndarray of str, shape (m,)
        Kind of each rest: static, or disturbed if it is clipped.
    others : str
        Kind of the segments between the rests.
    """
    t = rows[TIME]
    # the segments lie between neighbouring edges
    edges = np.union1d(np.concatenate([whole, stretches]), rests)
    kind = np.full(len(edges[1:]), others, object)
    kind[np.searchsorted(edges, rests[:, 0])] = kinds
    stuck = without(whole, merged(stretches))
    kind[np.searchsorted(edges, stuck[:, 0])] = GAP
    # a segment ends where the next one starts; before a long gap, and at the end of the log, it
    # ends one step after its last sample
    start, ends_at_gap = t[edges[:-1]], np.isin(edges[1:], whole[:, 1])
    next_start = t[np.minimum(edges[1:], len(t) - 1)]
    end = np.where(ends_at_gap, t[edges[1:] - 1] + step, next_start)
    # a long gap becomes a segment without samples, up to the start of the next segment
    gaps = np.flatnonzero(ends_at_gap[:-1]) + 1
    gap_end = start[gaps]
    start, end = np.insert(start, gaps, end[gaps - 1]), np.insert(end, gaps, gap_end)
    return segment_table(rows, start, end, np.insert(kind, gaps, GAP), np.full(len(start), -1))


def _between_disturbances(rows, stretches, step, settings):
    """Return the ranges of rows in which a device at rest is not disturbed, (k, 2).

    If the sensors have two clocks, several rows repeat a sample of the slower sensor, so its noise
    is not independent from row to row. The search then uses one value for each of these samples:
    the mean of the rows that hold it.

    Parameters
    ----------
    rows : Samples
        The samples of the session.
    stretches : ndarray of int, shape (m, 2)
        Ranges of rows that are searched.
    step : float
        Median time step, s.
    settings : SegmentSettings
        Conditions for a disturbance.
    """
    x = rows.read(CHANNELS, 0, len(rows))
    stamps = next((name for name in OWN_TIME.values() if name in rows), None)
    if stamps is None:
        return undisturbed_ranges(x, stretches, step, settings)
    # each sample of the slower sensor is in the rows from one edge to the next
    first = own_rows(rows[stamps])
    edges = np.append(first, len(rows))
    means = np.add.reduceat(x, first, axis=1) / np.diff(edges)
    # ranges of rows become ranges of the slower sensor's samples, and the result ranges of rows
    stretches, step = np.searchsorted(first, stretches), np.median(np.diff(rows[TIME][first]))
    return edges[undisturbed_ranges(means, stretches, step, settings)]


def _find_rests(rows, stretches, step, settings):
    """Return the rests of a session with motion, (m, 2), the tilt in each, rad, (m,), and metadata.

    A still stretch is a range in which the device does not move. Some are too short to be rests. If
    there are at least `LEAST_SHORT` such stretches, and the rests have fewer than `ENOUGH`
    attitudes, the search is repeated with shorter durations. The rests of the second search are
    used if they have at least `ENOUGH` attitudes, else those of the first.

    Parameters
    ----------
    rows : Samples
        The samples of the session.
    stretches : ndarray of int, shape (k, 2)
        Ranges of rows between long gaps.
    step : float
        Median time step, s.
    settings : SegmentSettings
        Conditions for a rest.

    Returns
    -------
    rests, tilt : ndarray, shape (m, 2), (m,)
        Half-open ranges of rows of the rests, and the tilt in each, rad; 0 if it is not
        significant.
    metadata : dict
        ``short_rests``: number of still stretches that are too short to be rests. ``tilted_rests``:
        number of rests with a tilt. ``hand_held``: whether some rests are in the hand. ``shorter``:
        a dict of the shorter durations that were used, or None if those of the settings were used.
    """
    f, w = (rows.read(axes, 0, len(rows)) for axes in (ACCELERATION, ANGULAR_RATE))
    log, shorter = (f, w, stretches, step), None
    rests, tilt, in_hand, short = _choose_rests(log, settings)
    if short >= LEAST_SHORT and len(attitudes(f, rests)) < ENOUGH:
        changed = {key: getattr(settings, key) / ratio for key, ratio in SHORTER.items()}
        more_rests, more_tilt, more_in_hand, _ = _choose_rests(log, replace(settings, **changed))
        if len(attitudes(f, more_rests)) >= ENOUGH:
            rests, tilt, in_hand, shorter = more_rests, more_tilt, more_in_hand, changed
    # the tilt of a rest is exactly zero unless it is significant
    counts = {"short_rests": short, "hand_held": in_hand, "tilted_rests": int((tilt > 0).sum())}
    return rests, tilt, counts | {"shorter": shorter}


def _choose_rests(log, settings):
    """Return the rests of a session with which the calibration is expected to be best.

    Steady rests are preferred: rests without the parts in which the device turns slowly or
    trembles. All rests are used if the steady ones are too few, that is, if the expected error of a
    calibration with them is more than `DEAREST` times as large as with all rests. Rests in the hand
    are added if they reduce the expected error to less than the share `WORTH_HOLDING` of the error
    without them.

    Parameters
    ----------
    log : tuple
        Specific force, m/s², (3, n), angular rate, rad/s, (3, n), the ranges of samples between
        long gaps, (k, 2), and the time step, s.
    settings : SegmentSettings
        Conditions for a rest.

    Returns
    -------
    rests, tilt : ndarray, shape (m, 2), (m,)
        Half-open ranges of samples of the chosen rests, and the tilt in each, rad; 0 if it is not
        significant.
    in_hand : bool
        Whether some of them are in the hand.
    short : int
        Number of still stretches that are too short to be rests.
    """
    f, w, stretches, step = log
    detected, steady, bias, short = _detect(log, settings)
    if not len(detected):
        return detected, np.zeros(0), False, short
    by_hand = held_rests(w, stretches, step, bias, settings.shortest_rest_s)
    largest_error = DEAREST * expected_error(attitudes(f, detected))
    for on_support, limit in ((steady, largest_error), (detected, np.inf)):
        wider = widen_rests(f, w, on_support, stretches, step)
        rests, tilt = without_tilts(f, w, wider, bias, step)
        error, in_hand = expected_error(attitudes(f, rests)), False
        all_rests, is_held = unite(rests, by_hand)
        error_with_held = expected_error(attitudes(f, all_rests))
        if is_held.any() and error_with_held < WORTH_HOLDING * error:
            all_tilts = np.zeros(len(all_rests))
            all_tilts[is_held] = sways(w, all_rests[is_held], bias, step)
            all_tilts[~is_held] = tilt[np.isin(rests[:, 0], all_rests[~is_held, 0])]
            rests, tilt, error, in_hand = all_rests, all_tilts, error_with_held, True
        if error <= limit:
            return rests, tilt, in_hand, short


def _detect(log, settings):
    """Return all rests of a session, the steady rests, the bias, and a count of short stretches.

    Parameters
    ----------
    log : tuple
        Specific force, m/s², (3, n), angular rate, rad/s, (3, n), the ranges of samples between
        long gaps, (k, 2), and the time step, s.
    settings : SegmentSettings
        Conditions for a rest.

    Returns
    -------
    rests : ndarray of int, shape (m, 2)
        Ranges of samples in which the variances of both sensors are near their levels at rest and
        the angular rate is near a bias.
    steady : ndarray of int, shape (l, 2)
        The same rests without the parts in which the device turns slowly or trembles.
    bias : ndarray, shape (3,)
        Bias of the gyroscope: the median of the angular rate at rest, rad/s. If the bias jumps
        during the session, it is the bias that lasts longer.
    short : int
        Number of still stretches that are too short to be rests.
    """
    f, w, stretches, step = log
    windows = activity(f, w, stretches, max(2, round(settings.window_s / step)))
    # one bias, or two if it jumps during the session; the first is the median of all quiet windows
    biases = rates_at_rest(windows, settings)
    # variances within multiples of the levels at rest, and mean rate near the nearest bias
    still = windows.within(MULTIPLES) & (windows.away(biases) <= settings.rate_tolerance)
    rests, short = detect_rests(still, stretches, step, settings)
    still &= ~unsteady_samples(w, rests, step, settings)
    steady, _ = detect_rests(still, stretches, step, settings)
    return rests, steady, biases[0], short
