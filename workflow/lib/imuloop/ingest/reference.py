"""A reference for a log: attitudes and places of a body on the device, on the log's clock."""

import re
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from imuloop.core.errors import ImuloopError
from imuloop.core.rotation import prefix_product, step_vectors
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.ingest.attitudes import COMPARED, Reference, angles, at_instants, turns
from imuloop.ingest.columns import STAMP
from imuloop.ingest.conventions import LEAST, LENGTH, convention_faults, place_faults
from imuloop.ingest.formats import find_format
from imuloop.ingest.stamps import NANOSECONDS, stamp_values

# step of the grid on which the clocks are compared, s
STEP = 0.01
# markers are swapped if the attitude is farther than `SWAPPED`, rad, from its running median over
# `BLOCK`, s
SWAPPED, BLOCK = 0.2, 2.0


def beside(samples, files, declared, session, counts):
    """Return a reference at the times of n samples, its figures, and reasons against its use.

    The first result has the columns `ORIENTATION` (quaternion, body to world) and `POSITION`, m,
    (n,) each, a dict by name. They are not-a-number where the reference was lost. The second is the
    entry ``reference`` of quality.json. The third is a list of reasons why the reference cannot be
    used; if there are any, the first result is empty.

    Parameters
    ----------
    samples : dict
        Columns of the session's samples, (n,) by name.
    files : dict
        Path of each file by its role; without the role ``reference``, the log holds the reference.
    declared : dict
        Keys of the config about the reference: ``format``, ``columns``, ``units``, ``convention``,
        ``rate``.
    session : dict
        Keys of the config about the log: ``format``, ``columns``, ``units``, ``rate``.
    counts : Counts
        Counts of the log, which have the time of the first sample, ``start_ns`` and ``begin_s``,
        and the first time stamp, ``origin``.
    """
    t = samples[TIME]
    f, w = (np.column_stack([samples[c] for c in axes]) for axes in (ACCELERATION, ANGULAR_RATE))
    raw, figures = _read(files, declared, session, counts)
    reference, shift = _on_clock(raw, t, w)
    convention = declared["convention"]
    reasons, frame, residual = convention_faults(reference, t, w, convention)
    figures["clock"] = {"offset_s": shift, "own": abs(shift) > COMPARED}
    figures |= {"convention": convention, "unexplained": residual, "frame": frame.tolist()}
    if not reasons:
        if convention == "world_to_body":
            reference = replace(reference, q=reference.q * [1, -1, -1, -1])
        reference, swaps = _without_swaps(reference, t, w, frame)
        figures |= swaps | {"noise": _noise(reference)}
        unit = (declared.get("units") or {}).get("position", "m")
        reasons = place_faults(reference, t, f, frame, unit)
    if reasons:
        return {}, figures, reasons
    columns = at_instants(reference, t)
    return columns, figures | {"coverage": float(np.isfinite(columns["qw"]).mean())}, []


def read_series(path, log_format, columns):
    """Return the time stamps in a table of a reference, or None, and its numbers, (n, k).

    The time stamps are an Arrow array. `path` is the path of the table, and `log_format` the name
    of its format or None. `columns` are the declared columns ``time``, ``orientation`` and
    ``position``. The k numbers of each of n rows are the quaternion, then the place if it is
    declared: k is 4 or 7. Columns of sensors are not read.
    """
    read = find_format(log_format, {"log": path})[1]
    others = {
        f"reference.columns.{quantity}.{number}": column
        for quantity in ("orientation", "position")
        for number, column in enumerate(columns.get(quantity) or ())
    }
    none = dict.fromkeys(("acceleration", "angular_rate", "temperature"))
    declared = none | {"time": columns.get("time"), "others": others}
    table = read({"log": path}, declared).batch
    stamps = table[STAMP] if STAMP in table.schema.names else None
    values = [table[name].to_numpy(zero_copy_only=False) for name in others]
    return stamps, np.array(values, dtype=float).T


def _read(files, declared, session, counts):
    """Return a Reference from its file, with times from the first sample of the log, and figures.

    The figures are numbers of rows, of lost attitudes and of rows out of order, a dict. `files` are
    the paths of the files by role; without the role ``reference``, the log holds the reference.
    `declared` and `session` are the keys of the config about the reference and about the log, and
    `counts` are the Counts of the log. Raises an ImuloopError for a declaration that does not fit.
    """
    path, units = files.get("reference", files.get("log")), declared.get("units") or {}
    in_log = str(path) == str(files.get("log"))
    log_time = (session.get("columns") or {}).get("time")
    log_unit = (session.get("units") or {}).get("time", "s")
    columns = {"time": log_time if in_log else None} | declared["columns"]
    form = declared.get("format") or (session.get("format") if in_log else None)
    try:
        stamps, values = read_series(path, form, columns)
    except ImuloopError as error:
        raise type(error)(re.sub(r"\Acolumns", "reference.columns", str(error))) from error
    rate = declared.get("rate") or session.get("rate")
    if stamps is None and not rate:
        raise ImuloopError("reference.columns.time: missing; a reference without a rate needs it")
    if stamps is None:
        t = np.arange(len(values)) / rate
    else:
        stamps, readable, dates = stamp_values(stamps)
        tick = 1 if dates else NANOSECONDS.get(units.get("time", log_unit), 1)
        t = np.where(readable, stamps * float(tick), np.nan) / 1e9
        start = t[readable][:1].sum()
        if dates and counts.start_ns is not None:
            start = counts.start_ns / 1e9 - counts.begin_s
        elif log_time is not None and not in_log:
            # stamps of the same clock are counted from the first stamp of the log
            start = counts.origin * float(NANOSECONDS.get(log_unit, 1)) / 1e9
        t = t - start
    q, p = values[:, :4], values[:, 4:] * LENGTH[units.get("position", "m")]
    if not p.size:
        p = np.full((len(q), 3), np.nan)
    length = np.linalg.norm(q, axis=1)
    lost = ~(np.abs(length - 1) <= 0.1)
    q = np.where(lost[:, None], np.nan, q / length[:, None])
    _, order = np.unique(t, return_index=True)
    order = order[np.isfinite(t[order])]
    if np.isfinite(q[order, 0]).sum() < LEAST:
        raise ImuloopError(
            f"reference.columns.orientation: fewer than {LEAST} rows hold a unit quaternion"
        )
    figures = {"rows": len(q), "lost": int(lost.sum()), "out_of_order": len(q) - len(order)}
    return Reference(t[order] - counts.begin_s, q[order], p[order]), figures


def _on_clock(reference, t, w):
    """Return a Reference on the clock of the samples, and the offset added to its times, s.

    At the offset the magnitudes of the angular rates of reference and samples agree best.
    `reference` is the Reference on its own clock. `t` are the times of n samples, s, (n,), and `w`
    their angular rates, rad/s, (n, 3). If the offset is at most `COMPARED`, both are taken to have
    the same clock, and nothing is added: the diagnosis estimates so small an offset itself.
    """
    # loaded late, as few logs have a reference
    from scipy.signal import correlate, correlation_lags

    start, end, turn = turns(reference)
    grid = np.arange(min(t[0], start[0]), max(t[-1], end[-1]), STEP)
    count = max(1, round(COMPARED / np.median(np.diff(t))))
    by_gyroscope = uniform_filter1d(np.linalg.norm(w, axis=1), count, mode="constant")
    by_reference = np.linalg.norm(turn, axis=1) / (end - start)
    pair = []
    for times, rates in ((t, by_gyroscope), ((start + end) / 2, by_reference)):
        on_grid = np.interp(grid, times, rates, left=np.nan, right=np.nan)
        pair.append(np.nan_to_num(on_grid - np.nanmean(on_grid)))
    best = np.argmax(correlate(*pair, method="fft"))
    shift = correlation_lags(len(grid), len(grid))[best] * STEP
    if abs(shift) <= COMPARED:
        return reference, 0.0
    return replace(reference, t=reference.t + shift), float(shift)


def _without_swaps(reference, t, w, frame):
    """Return a Reference without attitudes in which one marker is taken for another, and counts.

    Let q be the attitude of the `reference` and G the attitude by the gyroscope. Then q Gᵀ, by
    which they differ, drifts only slowly. While markers are swapped, q Gᵀ is off its running median
    over `BLOCK` s by more than `SWAPPED`, rad. Such attitudes and places become not-a-number. The
    counts are a dict: ``swaps`` is the number of times that markers begin to be swapped, and
    ``swapped`` the number of attitudes without a value for this reason. `t` are the times of n
    samples, s, (n,), `w` their angular rates, rad/s, (n, 3), and `frame` rotates from the axes of
    the sensor to the axes of the reference, (3, 3).
    """
    start, end, turn = turns(reference)
    bias = np.median((angles(t, w, start, end) - turn @ frame) / (end - start)[:, None], axis=0)
    steps = Rotation.from_rotvec(step_vectors((w - bias) @ frame.T, np.diff(t)))
    turned = np.vstack([[1, 0, 0, 0], prefix_product(steps.as_quat(scalar_first=True))])
    rows = np.flatnonzero(reference.has_attitude & (reference.t >= t[0]) & (reference.t <= t[-1]))
    by_gyroscope = Slerp(t, Rotation.from_quat(turned, scalar_first=True))(reference.t[rows])
    drift = Rotation.from_quat(reference.q[rows], scalar_first=True) * by_gyroscope.inv()
    usual = max(3, round(BLOCK / np.median(np.diff(reference.t))))
    entries = drift.as_matrix().reshape(-1, 9).T
    # matrices that are an angle apart differ by 2 √2 sin(angle / 2)
    away = np.hypot.reduce([x - median_filter(x, usual) for x in entries])
    away = away > 2**1.5 * np.sin(SWAPPED / 2)
    q, p = reference.q.copy(), reference.p.copy()
    q[rows[away]], p[rows[away]] = np.nan, np.nan
    swaps = int((np.diff(away.astype(int)) == 1).sum())
    figures = {"swaps": swaps, "swapped": int(away.sum())}
    return replace(reference, q=q, p=p), figures


def _noise(reference):
    """Return the standard deviations of the white noise of a Reference, a dict.

    `reference` is the Reference. The key ``orientation`` is for the attitude, rad, and ``position``
    for the place, m. With too few samples the value of ``orientation`` is 0, and the value of
    ``position`` is None.
    """
    t, has_attitude, has_place = reference.t, reference.has_attitude, reference.has_place
    attitude = Rotation.from_quat(reference.q[has_attitude], scalar_first=True)
    turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    return {
        "orientation": _white_noise(t[has_attitude], turn) or 0.0,
        "position": _white_noise(t[has_place], np.diff(reference.p[has_place], axis=0)),
    }


def _white_noise(t, change):
    """Return the standard deviation σ of the white noise in n values, None if there are too few.

    `t` are the times of the values, s, (n,), and `change` is the change from each value to the next
    one on three axes, (n - 1, 3), in the unit of σ. White noise gives third differences of the
    values the variance 20 σ²; motion is smooth over three steps and adds little. So σ is the median
    magnitude of the third differences over 0.6745 √20. Only evenly spaced values are used.
    """
    steps = np.diff(t)
    if len(steps) < 3:
        return None
    even = np.abs(steps / np.median(steps) - 1) < 0.1
    third = np.diff(change, 2, axis=0)[even[:-2] & even[1:-1] & even[2:]]
    return float(np.median(np.abs(third)) / 0.6745 / 20**0.5) if third.size else None
