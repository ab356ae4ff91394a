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
from imuloop.ingest.conventions import LENGTH, convention_faults, place_faults
from imuloop.ingest.formats import find_format
from imuloop.ingest.stamps import NANOSECONDS, stamp_values

# step of the grid on which the clocks are compared, s
STEP = 0.01
# a place leaps if its distance from the median of its neighbours exceeds `LEAP`, m, and `TIMES`
# times the usual distance
LEAP, TIMES = 0.02, 8.0
# markers are swapped if the attitude is farther than `SWAPPED`, rad, from its running median over
# `BLOCK`, s
SWAPPED, BLOCK = 0.2, 2.0


def beside(samples, files, declared, session, counts):
    """Return a reference at the instants of the samples, its figures, and reasons against its use.

    The first result has the columns `ORIENTATION` (body to world) and `POSITION`, (n,) each, a dict
    by name. They are not-a-number where the reference was lost. The dict is empty if there are
    reasons, a list of str, why the reference cannot be used.

    Parameters
    ----------
    samples : dict
        Columns of the session's samples.
    files : dict
        Path of each file by its role; without the role ``reference``, the log holds the reference.
    declared, session : dict
        Keys of the config about the reference and about the log: ``format``, ``columns``,
        ``units``, ``convention``, ``rate``.
    counts : Counts
        Counts of the log, for the time of the first sample, ``start_ns`` (if stamps are dates) and
        ``begin_s``, and for the first stamp, ``origin``.
    """
    t = samples[TIME]
    f, w = (np.column_stack([samples[c] for c in axes]) for axes in (ACCELERATION, ANGULAR_RATE))
    raw, figures = _read(files, declared, session, counts)
    found, shift = _on_clock(raw, t, w)
    reasons, frame, residual = convention_faults(found, t, w, f, declared["convention"])
    figures["clock"] = {"offset_s": shift, "own": abs(shift) > COMPARED}
    figures |= {"unexplained": residual, "frame": frame}
    if not reasons:
        if declared["convention"] == "world_to_body":
            found = replace(found, q=found.q * [1, -1, -1, -1])
        found, jumps = _without_jumps(found, t, w, np.array(frame))
        figures |= jumps | {"noise": _noise(found)}
        reasons = place_faults(found, t, f, np.array(frame), declared)
    if reasons:
        return {}, figures, reasons
    columns = at_instants(found, t)
    return columns, figures | {"coverage": float(np.isfinite(columns["qw"]).mean())}, []


def read_series(path, log_format, columns):
    """Return the stamps of a table, an Arrow array or None, and the numbers of a reference, (n, k).

    `path` is the path of the table, and `log_format` the name of its format or None. `columns` are
    the declared columns ``time``, ``orientation`` and ``position``. The k numbers of a row are the
    quaternion, then the place. Sensors are not read.
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
    """Return the Reference as it is in its file, with times from the first sample, and figures.

    `files` are the paths by role. `declared` and `session` are the keys of the config about the
    reference and about the log, and `counts` are the Counts of the log. Raises an ImuloopError for
    a declaration that does not fit.
    """
    file, units = files.get("reference", files.get("log")), declared.get("units") or {}
    same = str(file) == str(files.get("log"))
    own_time = (session.get("columns") or {}).get("time")
    own_unit = (session.get("units") or {}).get("time", "s")
    columns = {"time": own_time if same else None} | declared["columns"]
    form = declared.get("format") or (session.get("format") if same else None)
    try:
        stamps, values = read_series(file, form, columns)
    except ImuloopError as error:
        raise type(error)(re.sub(r"\Acolumns", "reference.columns", str(error))) from error
    rate = declared.get("rate") or session.get("rate")
    if stamps is None and not rate:
        raise ImuloopError("reference.columns.time: missing; a reference without a rate needs it")
    if stamps is None:
        t = np.arange(len(values)) / rate
    else:
        stamps, readable, dates = stamp_values(stamps)
        tick = 1 if dates else NANOSECONDS.get(units.get("time", own_unit), 1)
        t = np.where(readable, stamps * float(tick), np.nan) / 1e9
        start = t[readable][:1].sum()
        if dates and counts.start_ns is not None:
            start = counts.start_ns / 1e9 - counts.begin_s
        elif not same and own_time is not None:
            # stamps of the same clock are counted from the first stamp of the log
            start = counts.origin * float(NANOSECONDS.get(own_unit, 1)) / 1e9
        t = t - start
    q, p = values[:, :4], np.full((len(values), 3), np.nan)
    if values.shape[1] > 4:
        p = values[:, 4:] * LENGTH[units.get("position", "m")]
    length = np.linalg.norm(q, axis=1)
    lost = ~np.isfinite(length)
    odd = ~lost & (np.abs(length - 1) > 0.1)
    q = np.where((odd | lost)[:, None], np.nan, q / length[:, None])
    order = np.argsort(t, kind="stable")[: np.isfinite(t).sum()]
    order = order[np.diff(t[order], prepend=-np.inf) > 0]
    if np.isfinite(q[order, 0]).sum() < 100:
        raise ImuloopError(
            "reference.columns.orientation: fewer than 100 rows hold a unit quaternion"
        )
    figures = {"rows": len(q), "lost": int(lost.sum()), "no_rotation": int(odd.sum())}
    figures |= {"out_of_order": len(q) - len(order), "convention": declared["convention"]}
    return Reference(t[order] - counts.begin_s, q[order], p[order]), figures


def _on_clock(reference, t, w):
    """Return the Reference on the clock of the samples, and the offset that was added, s.

    At the offset the magnitudes of the angular rates of reference and samples agree best. `t` are
    the times of the samples, s, (n,), and `w` their angular rates, rad/s, (n, 3). If the offset is
    at most `COMPARED`, both have the same clock and 0 is added; the diagnosis estimates such an
    offset.
    """
    # loaded late, as few logs have a reference
    from scipy.signal import correlate, correlation_lags

    start, end, turn = turns(reference)
    grid = np.arange(min(t[0], start[0]), max(t[-1], end[-1]), STEP)
    size = np.linalg.norm(turn, axis=1) / (end - start)
    count = max(1, round(COMPARED / np.median(np.diff(t))))
    own = uniform_filter1d(np.linalg.norm(w, axis=1), count, mode="constant")
    pair = []
    for times, rates in ((t, own), ((start + end) / 2, size)):
        on_grid = np.interp(grid, times, rates, left=np.nan, right=np.nan)
        pair.append(np.nan_to_num(on_grid - np.nanmean(on_grid)))
    alike = correlate(*pair, method="fft")
    best = int(np.argmax(alike))
    shift = correlation_lags(len(grid), len(grid))[best] * STEP
    if abs(shift) <= COMPARED:
        return reference, 0.0
    below, peak, above = alike.take([best - 1, best, best + 1], mode="clip")
    bend = below - 2 * peak + above
    shift += STEP * (below - above) / (2 * bend) if bend < 0 else 0.0
    return replace(reference, t=reference.t + shift), float(shift)


def _without_jumps(reference, t, w, frame):
    """Return the Reference without swaps of markers and leaps of places, and figures on them.

    Let q be the attitude of the reference and G the attitude by the gyroscope. Then q Gᵀ drifts
    slowly. While one marker is taken for another, q Gᵀ is off its running median over `BLOCK` s.
    `t` are the times of the samples, s, (n,), `w` their angular rates, rad/s, (n, 3), and `frame`
    rotates from the axes of the sensor to the axes of the reference.
    """
    start, end, turn = turns(reference)
    bias = np.median((angles(t, w, start, end) - turn @ frame) / (end - start)[:, None], axis=0)
    steps = Rotation.from_rotvec(step_vectors((w - bias) @ frame.T, np.diff(t)))
    own = np.vstack([[1, 0, 0, 0], prefix_product(steps.as_quat(scalar_first=True))])
    at = np.flatnonzero(reference.known & (reference.t >= t[0]) & (reference.t <= t[-1]))
    carried = Slerp(t, Rotation.from_quat(own, scalar_first=True))(reference.t[at])
    off = Rotation.from_quat(reference.q[at], scalar_first=True) * carried.inv()
    usual = max(3, round(BLOCK / np.median(np.diff(reference.t))))
    # matrices that are an angle apart differ by 2 √2 sin(angle / 2)
    away = np.hypot.reduce([x - median_filter(x, usual) for x in off.as_matrix().reshape(-1, 9).T])
    away = away > 2**1.5 * np.sin(SWAPPED / 2)
    cut = np.zeros(len(reference.t), bool)
    cut[at[away]] = True
    # a place leaps if it lies off the median of its neighbours
    known = np.flatnonzero(np.isfinite(reference.p[:, 0]) & ~cut)
    p = reference.p[known]
    off = np.linalg.norm(p - median_filter(p, (5, 1)), axis=1)
    leaps = known[off > max(TIMES * np.median(off), LEAP)] if len(known) else known
    q, p = reference.q.copy(), reference.p.copy()
    q[cut], p[cut], p[leaps] = np.nan, np.nan, np.nan
    swaps = int((np.diff(away.astype(int)) == 1).sum())
    figures = {"swaps": swaps, "swapped": int(cut.sum()), "leaps": len(leaps)}
    return replace(reference, q=q, p=p), figures


def _noise(reference):
    """Return the standard deviation of white noise of attitude, rad, and of place, m or None.

    The result is a dict. White noise with the standard deviation σ gives third differences the
    variance 20 σ²; motion is smooth over three steps and adds little.
    """

    def size(known, difference):
        """Return σ from the median of third differences, or None if there are none.

        Each is over four evenly spaced samples. `known` is the mask of usable samples, and
        ``difference(a, b)`` returns the change from samples a to samples b, (k, 3).
        """
        at = np.flatnonzero(known)
        steps = np.diff(reference.t[at])
        if len(steps) < 3:
            return None
        even = np.abs(steps / np.median(steps) - 1) < 0.1
        first = np.flatnonzero(even[:-2] & even[1:-1] & even[2:])
        step = np.array([difference(at[first + k], at[first + k + 1]) for k in range(3)])
        third = np.abs(step[0] - 2 * step[1] + step[2])
        return float(np.median(third) / 0.6745 / 20**0.5) if third.size else None

    rotation = Rotation.from_quat(np.nan_to_num(reference.q, nan=1.0), scalar_first=True)
    of_attitude = size(reference.known, lambda a, b: (rotation[a].inv() * rotation[b]).as_rotvec())
    of_place = size(reference.placed, lambda a, b: reference.p[b] - reference.p[a])
    return {"orientation": of_attitude or 0.0, "position": of_place}
