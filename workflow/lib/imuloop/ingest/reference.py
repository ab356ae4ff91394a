"""A reference beside a log: attitudes and places of a body on the device, on the log's clock."""

import re
from dataclasses import replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.spatial.transform import Rotation

from imuloop.core.errors import ImuloopError
from imuloop.core.rotation import prefix_product, step_vectors
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.ingest.attitudes import COMPARED, Reference, angles, at_instants, turns
from imuloop.ingest.columns import STAMP
from imuloop.ingest.conventions import LENGTH, convention_faults, place_faults
from imuloop.ingest.formats import find_format
from imuloop.ingest.stamps import NANOSECONDS, stamp_values

# s; up to here clocks count as one
SAME_CLOCK = 0.1
# m; least leap of a place, and how many times what neighbours usually differ by
LEAP, TIMES = 0.02, 8.0
# rad; a marker that is taken for another turns the body by more, within blocks of so many s
SWAPPED, BLOCK = 0.2, 2.0


def beside(samples, file, log_file, declared, session, counts):
    """Return a reference at the samples' instants; its figures; and why it cannot be used, if so.

    It has the columns `ORIENTATION` (body to world) and `POSITION`, not-a-number where the
    reference was lost; none if it cannot be used.

    Parameters
    ----------
    samples : dict
        Columns of the session's samples.
    file, log_file : path-like
        File of the reference, which may be the log, and of the log.
    declared, session : dict
        What the config says of the reference and of the log: ``format``, ``columns``, ``units``,
        ``convention``, ``rate``.
    counts : Counts
        When the first sample was: ``start_ns`` where stamps are dates, ``begin_s``.
    """
    t = samples[TIME]
    f, w = (np.column_stack([samples[c] for c in axes]) for axes in (ACCELERATION, ANGULAR_RATE))
    raw, figures = _read(file, log_file, declared, session, counts)
    found, shift = _on_clock(raw, t, w)
    figures["clock"] = {"offset_s": shift, "own": abs(shift) > SAME_CLOCK}
    reasons, frame, residual = convention_faults(found, t, w, f, declared["convention"])
    figures |= {"unexplained": residual, "frame": frame}
    if reasons:
        return {}, figures, reasons
    if declared["convention"] == "world_to_body":
        found = replace(found, q=found.q * [1, -1, -1, -1])
    found, jumps = _without_jumps(found, t, w, np.array(frame))
    figures |= jumps | {"noise": _noise(found)}
    if reasons := place_faults(found, t, f, np.array(frame), declared):
        return {}, figures, reasons
    columns = at_instants(found, t)
    figures["coverage"] = float(np.isfinite(columns["qw"]).mean())
    return columns, figures, []


def read_series(path, log_format, columns):
    """Return the stamps of a table, None without, and numbers in columns of a reference, (n, k).

    `columns` are as declared, ``time``, ``orientation`` and ``position``; of two quantities that
    of ``orientation`` comes first. Nothing is read of sensors.
    """
    form = find_format(log_format, {"log": path})[1]
    others = {
        f"reference.columns.{quantity}.{number}": column
        for quantity in ("orientation", "position")
        for number, column in enumerate(columns.get(quantity) or ())
    }
    none = dict.fromkeys(("acceleration", "angular_rate", "temperature"))
    declared = none | {"time": columns.get("time"), "others": others}
    table = form.read({"log": path}, declared).batch
    stamps = table[STAMP] if STAMP in table.schema.names else None
    values = [table[name].to_numpy(zero_copy_only=False) for name in others]
    return stamps, np.array(values, dtype=float).T


def _read(file, log_file, declared, session, counts):
    """Return the Reference as it is in the file, its clock from the first sample, and figures."""
    columns, units = dict(declared["columns"]), declared.get("units") or {}
    same, own_time = str(file) == str(log_file), (session.get("columns") or {}).get("time")
    columns.setdefault("time", own_time if same else None)
    form = declared.get("format") or (session.get("format") if same else None)
    try:
        stamps, values = read_series(file, form, columns)
    except ImuloopError as error:
        raise type(error)(re.sub(r"\Acolumns", "reference.columns", str(error))) from error
    count, rate = len(values), declared.get("rate") or session.get("rate")
    if stamps is not None:
        stamps, readable, dates = stamp_values(stamps)
        own_unit = (session.get("units") or {}).get("time", "s")
        unit = NANOSECONDS.get(units.get("time", own_unit), 1)
        t = np.where(readable, stamps * (1.0 if dates else float(unit)), np.nan) / 1e9
        start = t[np.isfinite(t)][:1].sum()
        if dates and counts.start_ns is not None:
            start = counts.start_ns / 1e9 - counts.begin_s
        elif not same and own_time is not None:
            # stamps of one clock begin where the log's do
            own, _ = read_series(log_file, session.get("format"), {"time": own_time})
            own, sound, _ = stamp_values(own)
            start = float(own[sound][:1].sum()) * NANOSECONDS.get(own_unit, 1) / 1e9
        t = t - start
    elif rate:
        t = np.arange(count) / rate
    else:
        raise ImuloopError("reference.columns.time: missing; a reference without a rate needs it")
    t = t - counts.begin_s
    q = values[:, :4].copy()
    p = np.full((count, 3), np.nan) if values.shape[1] == 4 else values[:, 4:]
    p = p * LENGTH[units.get("position", "m")]
    length = np.linalg.norm(q, axis=1)
    lost = ~np.isfinite(length)
    odd = ~lost & (np.abs(length - 1) > 0.1)
    q[odd | lost] = np.nan
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    order = np.flatnonzero(np.isfinite(t))
    order = order[np.argsort(t[order], kind="stable")]
    order = order[np.diff(t[order], prepend=-np.inf) > 0]
    figures = {
        "rows": count,
        "lost": int(lost.sum()),
        "no_rotation": int(odd.sum()),
        "out_of_order": int(count - len(order)),
        "convention": declared["convention"],
    }
    if (~(odd | lost)[order]).sum() < 100:
        raise ImuloopError(
            "reference.columns.orientation: fewer than 100 rows hold a unit quaternion"
        )
    return Reference(t[order], q[order], p[order]), figures


def _on_clock(reference, t, w):
    """Return the reference on the samples' clock, and its offset, s: where rates look alike.

    The clocks are one where the best offset is below `SAME_CLOCK`; what is left of it is for the
    diagnosis.
    """
    start, end, turn = turns(reference)
    step = 0.01
    grid = np.arange(min(t[0], start[0]), max(t[-1], end[-1]), step)
    size = np.linalg.norm(turn, axis=1) / (end - start)
    own = np.linalg.norm(w, axis=1)
    own = np.convolve(
        own, np.ones(n := max(1, round(COMPARED / np.median(np.diff(t))))) / n, "same"
    )
    pair = []
    for at, values in (((start + end) / 2, size), (t, own)):
        on_grid = np.interp(grid, at, values, left=np.nan, right=np.nan)
        pair.append(np.nan_to_num(on_grid - np.nanmean(on_grid)))
    # the correlation at all shifts
    size = next_fast_len(2 * len(grid), real=True)
    alike = irfft(rfft(pair[1], size) * rfft(pair[0][::-1], size), size)[: 2 * len(grid) - 1]
    best = int(np.argmax(alike))
    shift = (best + 1 - len(grid)) * step
    if abs(shift) <= SAME_CLOCK:
        return reference, 0.0
    near = alike.take([best - 1, best, best + 1], mode="clip")
    bend = near[0] - 2 * near[1] + near[2]
    shift += step * (near[0] - near[2]) / (2 * bend) if bend < 0 else 0.0
    return replace(reference, t=reference.t + shift), float(shift)


def _without_jumps(reference, t, w, frame):
    """Return the reference without swaps of markers and leaps, and how much was cut.

    With G the attitude by the gyroscope, q Gᵀ drifts slowly; while one marker is taken for another
    it is off. Of blocks of `BLOCK` s that of most samples is right.
    """
    start, end, turn = turns(reference)
    bias = np.median((angles(t, w, start, end) - turn @ frame) / (end - start)[:, None], axis=0)
    steps = Rotation.from_rotvec(step_vectors((w - bias) @ frame.T, np.diff(t)))
    after = prefix_product(steps.as_quat(scalar_first=True))
    at = np.flatnonzero(reference.known & (reference.t >= t[0]) & (reference.t <= t[-1]))
    near = np.clip(np.searchsorted(t, reference.t[at]) - 1, 0, len(after) - 1)
    late = (reference.t[at] - t[near + 1])[:, None] * ((w[near] - bias) @ frame.T)
    carried = Rotation.from_quat(after[near], scalar_first=True) * Rotation.from_rotvec(late)
    off = (Rotation.from_quat(reference.q[at], scalar_first=True) * carried.inv()).as_quat()
    block = (reference.t[at] / BLOCK).astype(int)
    size = np.zeros(len(at))
    for k in np.unique(block):
        own = block == k
        # to the sample with the most others near it
        some = off[own][:: max(1, own.sum() // 100)]
        alike = np.abs(some @ some.T) > np.cos(SWAPPED / 4)
        middle = some[alike.sum(axis=1).argmax()]
        size[own] = 2 * np.arccos(np.minimum(np.abs(off[own] @ middle), 1))
    away = size > SWAPPED
    cut = np.zeros(len(reference.t), bool)
    cut[at[away]] = True
    swapped, swaps = int(cut.sum()), int((np.diff(away.astype(int)) == 1).sum())
    # a place that lies off the median of its neighbours
    p = reference.p
    leaps = np.zeros(len(p), bool)
    known = np.flatnonzero(np.isfinite(p[:, 0]) & ~cut)
    if len(known) > 5:
        near = np.lib.stride_tricks.sliding_window_view(p[known], 5, axis=0)
        off = np.linalg.norm(p[known][2:-2] - np.median(near, axis=2), axis=1)
        leaps[known[2:-2][off > max(TIMES * np.median(off), LEAP)]] = True
    reference = reference.without(cut)
    p = reference.p.copy()
    p[leaps] = np.nan
    figures = {"swaps": swaps, "swapped": swapped, "leaps": int(leaps.sum())}
    return replace(reference, p=p), figures


def _noise(reference):
    """Return the white noise of attitude, rad, and of place, m or null, by third differences.

    Of white noise σ they have the variance 20 σ²; motion is smooth over three steps.
    """

    def even(known):
        """Return four samples on end each, where their steps are alike, (4, m)."""
        at = np.flatnonzero(known)
        steps = np.diff(reference.t[at])
        usual = np.abs(steps / np.median(steps) - 1) < 0.1 if len(steps) else np.zeros(0, bool)
        first = np.flatnonzero(usual[:-2] & usual[1:-1] & usual[2:]) if len(usual) > 2 else []
        return np.array([at[np.asarray(first, int) + k] for k in range(4)])

    def size(third):
        """Return σ by the median of third differences; None without any."""
        return float(np.median(np.abs(third)) / 0.6745 / 20**0.5) if len(third) else None

    at = even(reference.known)
    rotation = Rotation.from_quat(np.nan_to_num(reference.q, nan=1.0), scalar_first=True)
    step = [(rotation[at[k]].inv() * rotation[at[k + 1]]).as_rotvec() for k in range(3)]
    p = reference.p[even(np.isfinite(reference.p[:, 0]))]
    third = p[0] - 3 * p[1] + 3 * p[2] - p[3]
    attitude = size(step[0] - 2 * step[1] + step[2])
    return {"orientation": attitude or 0.0, "position": size(third)}
