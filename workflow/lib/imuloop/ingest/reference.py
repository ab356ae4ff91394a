"""A reference beside a log: attitudes and places of a body on the device, on the log's clock."""

import json
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from imuloop.core.errors import ImuloopError
from imuloop.core.rotation import prefix_product, step_vectors
from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    METADATA_KEY,
    ORIENTATION,
    POSITION,
    TIME,
    read_columns,
)
from imuloop.ingest import delimited, matlab
from imuloop.ingest.columns import position
from imuloop.ingest.formats import find_format
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.stamps import NANOSECONDS, stamp_array, stamp_values
from imuloop.ingest.text_layout import find_layout

# m in each unit of a position
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
# s; up to here lost samples are bridged by a cubic, and clocks count as one
BRIDGED, SAME_CLOCK = 0.05, 0.1
# s over which turns are compared, and share of them that may be left where a convention fits
COMPARED, FITS = 0.1, 0.3
# cosine of the angle between two worlds from which on they are one
ALONG = 0.95
# m; least leap of a place, and how many times what neighbours usually differ by
LEAP, TIMES = 0.02, 8.0
# rad; a marker that is taken for another turns the body by more, within blocks of so many s
SWAPPED, BLOCK = 0.2, 2.0
# to 10 % the two scales of a sensor and its reference may differ
SCALE = 0.1
DEGREE = 180 / np.pi


@dataclass(frozen=True)
class Reference:
    """A reference: t, s, (n,), quaternions q, (n, 4), scalar first, and places p, m, (n, 3)."""

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray

    @property
    def known(self):
        """Which samples have an attitude."""
        return np.isfinite(self.q[:, 0])

    def without(self, cut):
        """Return the same with what is cut as not-a-number."""
        q, p = self.q.copy(), self.p.copy()
        q[cut], p[cut] = np.nan, np.nan
        return replace(self, q=q, p=p)


def attach(samples_path, file, log_file, declared, session, counts):
    """Add a reference to samples.parquet; return its figures, and why it cannot be used, if so.

    Columns `ORIENTATION` (body to world) and `POSITION`, at the samples' instants, not-a-number
    where the reference was lost.

    Parameters
    ----------
    samples_path : path-like
        Samples of the session, which are written again.
    file, log_file : path-like
        File of the reference, which may be the log, and of the log.
    declared, session : dict
        What the config says of the reference and of the log: ``format``, ``columns``, ``units``,
        ``convention``, ``rate``.
    counts : Counts
        When the first sample was: ``start_ns`` where stamps are dates, ``begin_s``.
    """
    table = pq.read_table(samples_path)
    samples = read_columns(samples_path, (TIME, *ACCELERATION, *ANGULAR_RATE))
    t, w = samples[TIME], np.column_stack([samples[c] for c in ANGULAR_RATE])
    raw, figures = _read(file, log_file, declared, session, counts)
    found, shift = _on_clock(raw, t, w)
    figures["clock"] = {"offset_s": shift, "own": abs(shift) > SAME_CLOCK}
    f = np.column_stack([samples[c] for c in ACCELERATION])
    reasons, frame, residual = _conventions(found, t, w, f, declared["convention"])
    figures |= {"unexplained": residual, "frame": frame}
    if not reasons:
        if declared["convention"] == "world_to_body":
            found = replace(found, q=found.q * [1, -1, -1, -1])
        found, jumps = _without_jumps(found, t, w, np.array(frame))
        figures |= jumps | {"noise": _noise(found)}
        reasons = _places(found, t, f, np.array(frame), declared)
    if not reasons:
        columns = at_instants(found, t)
        figures["coverage"] = float(np.isfinite(columns["qw"]).mean())
        for name, values in columns.items():
            table = table.append_column(name, pa.array(values, pa.float64()))
        known = table.schema.metadata
        known = {
            **known,
            METADATA_KEY: json.dumps(json.loads(known[METADATA_KEY]) | {"reference": figures}),
        }
        pq.write_table(
            table.replace_schema_metadata(known),
            samples_path,
            compression="zstd",
            row_group_size=1 << 17,
        )
    return figures, reasons


def read_series(path, log_format, names, quantity):
    """Return columns of a table by name or number: an array each; None of a name that is None."""
    form = find_format(log_format, {"log": path})[0]
    wanted = [name for name in names if name is not None]
    if form == "matlab":
        series = matlab.variables(path)[0]
        known = list(series)
        chosen = [series[known[position(quantity, n, known, True)]] for n in wanted]
        longest = {len(x) for x in chosen}
        if len(longest) > 1:
            raise ImuloopError(f"{quantity}: its columns differ in length")
    elif form == "parquet":
        known = pq.read_schema(path).names
        labels = [known[position(quantity, n, known, True)] for n in wanted]
        chosen = [pq.read_table(path, columns=[n])[n].combine_chunks() for n in labels]
        chosen = [c if i == 0 else c.to_numpy(zero_copy_only=False) for i, c in enumerate(chosen)]
    elif form in ("csv", "tsv"):
        layout = find_layout(path)
        places = [position(quantity, n, layout.names, layout.headed) for n in wanted]
        stamps = int(names[0] is not None)
        batches = delimited.text_batches(path, layout, places, 1 << 16, RawLog(), stamps=stamps)
        parts = [pa.Table.from_batches([b]) for b in batches]
        joined = [
            pa.concat_arrays([p.column(i).chunk(0) for p in parts]) for i in range(len(places))
        ]
        chosen = [
            c if i < stamps else c.to_numpy(zero_copy_only=False) for i, c in enumerate(joined)
        ]
    else:
        raise ImuloopError(f"format: a reference is read from csv, parquet or matlab, not {form}")
    chosen = iter(chosen)
    return [None if name is None else next(chosen) for name in names]


def _read(file, log_file, declared, session, counts):
    """Return the Reference as it is in the file, its clock from the first sample, and figures."""
    columns, units = declared["columns"], declared.get("units") or {}
    same, own_time = str(file) == str(log_file), (session.get("columns") or {}).get("time")
    time = columns.get("time", own_time if same else None)
    names = [time, *columns["orientation"], *columns.get("position", ())]
    form = declared.get("format") or (session.get("format") if same else None)
    stamps, *values = read_series(file, form, names, "reference.columns")
    count, rate = len(values[0]), declared.get("rate") or session.get("rate")
    if stamps is not None:
        stamps, readable, dates = stamp_values(stamp_array(pa.array(stamps)))
        own_unit = (session.get("units") or {}).get("time", "s")
        unit = NANOSECONDS.get(units.get("time", own_unit), 1)
        t = np.where(readable, stamps * (1.0 if dates else float(unit)), np.nan) / 1e9
        start = t[np.isfinite(t)][:1].sum()
        if dates and counts.start_ns is not None:
            start = counts.start_ns / 1e9 - counts.begin_s
        elif not same and own_time is not None:
            # stamps of one clock begin where the log's do
            own = read_series(log_file, session.get("format"), [own_time], "columns.time")[0]
            own, sound, _ = stamp_values(stamp_array(pa.array(own)))
            start = float(own[sound][:1].sum()) * NANOSECONDS.get(own_unit, 1) / 1e9
        t = t - start
    elif rate:
        t = np.arange(count) / rate
    else:
        raise ImuloopError("reference.columns.time: missing; a reference without a rate needs it")
    t = t - counts.begin_s
    q = np.column_stack(values[:4]).astype(float)
    p = np.column_stack(values[4:]).astype(float) if values[4:] else np.full((count, 3), np.nan)
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


def turns(reference, seconds=COMPARED):
    """Return times of start and end, s, and rotation vectors between, rad on body axes, (m, 3)."""
    known = np.flatnonzero(reference.known)
    t = reference.t[known]
    last = np.searchsorted(t, t + seconds)
    first = np.flatnonzero(last < len(t))
    last = last[first]
    near = t[last] - t[first] < 1.5 * seconds
    first, last = first[near], last[near]
    rotation = Rotation.from_quat(reference.q[known][:, [1, 2, 3, 0]])
    return t[first], t[last], (rotation[first].inv() * rotation[last]).as_rotvec()


def _angles(t, w, start, end):
    """Return the integral of the angular rate from start to end, (m, 3)."""
    steps = np.diff(t)[:, None] * (w[1:] + w[:-1]) / 2
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    ends = (np.column_stack([np.interp(x, t, c) for c in total.T]) for x in (start, end))
    first, last = ends
    return last - first


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
    n = 1 << int(np.ceil(np.log2(2 * len(grid))))
    product_ = np.fft.rfft(pair[1], n) * np.conj(np.fft.rfft(pair[0], n))
    alike = np.fft.irfft(product_, n)
    best = int(np.argmax(alike))
    shift = (best if best < n // 2 else best - n) * step
    if abs(shift) <= SAME_CLOCK:
        return reference, 0.0
    near = alike[[best - 1, best, (best + 1) % n]]
    bend = near[0] - 2 * near[1] + near[2]
    shift += step * (near[0] - near[2]) / (2 * bend) if bend < 0 else 0.0
    return replace(reference, t=reference.t + shift), float(shift)


def _frame(turn, angle):
    """Return the rotation that takes the sensor's turns to the reference's, and what it leaves.

    Least squares of the vectors (Kabsch), the worst tenth left out the second time; the share of
    the reference's turns that is left, root mean square.
    """
    keep = np.ones(len(turn), bool)
    for _ in range(2):
        u, _, v = np.linalg.svd(turn[keep].T @ angle[keep])
        frame = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
        left = np.linalg.norm(turn - angle @ frame.T, axis=1)
        keep = left <= np.quantile(left, 0.9)
    return frame, float(np.sqrt((left[keep] ** 2).mean() / (turn[keep] ** 2).sum(axis=1).mean()))


def _conventions(reference, t, w, f, declared):
    """Return why the attitudes do not fit the angular rate, the frame, and the share that is left.

    Both conventions and orders of the quaternion are tried: what fits is said. Turns alone cannot
    tell a wrong order from other axes of body and world: the right one has the places' axes, or, if
    there are none, the sensor's.
    """
    found = {}
    for order, convention in product(("wxyz", "xyzw"), ("body_to_world", "world_to_body")):
        q = reference.q if order == "wxyz" else reference.q[:, [3, 0, 1, 2]]
        q = q * [1, -1, -1, -1] if convention == "world_to_body" else q
        start, end, turn = turns(replace(reference, q=q))
        inside = (start >= t[0]) & (end <= t[-1])
        if inside.sum() < 50:
            why = "the reference's clock overlaps with that of the log for less than 50 samples"
            return [f"reference: {why}"], np.eye(3).tolist(), 1.0
        angle = _angles(t, w, start[inside], end[inside])
        # noise and swaps lengthen turns: the median of those that are long
        lengths = [np.linalg.norm(v, axis=1) for v in (turn[inside], angle)]
        long = lengths[1] >= np.median(lengths[1])
        size = np.median(lengths[0][long] / np.maximum(lengths[1][long], 1e-12))
        frame, left = _frame(turn[inside], angle * size)
        gain = _gain(replace(reference, q=q), t, f, frame) if left < FITS else None
        axes = -1.0 if gain is None else _alike_axes(gain)
        found[order, convention] = left, size, frame, axes, np.trace(frame)
    left, size, frame, axes, _ = found["wxyz", declared]
    fitting = [key for key in found if found[key][0] < FITS]
    best = max(fitting, key=lambda key: found[key][3:], default=None)
    turned = best and -1 < axes < ALONG < found[best][3]
    if left > FITS or turned:
        why = f"read as {declared} it leaves {left:.0%} of the turns of the gyroscope unexplained"
        if left < FITS:
            why = f"read as {declared} its axes of the world are not those of the places"
        if best:
            order, convention = best
            say = [f"name its columns in the order w, x, y, z: they are {order}"] * (
                order != "wxyz"
            )
            say += [f"declare convention: {convention}"] * (convention != declared)
            why += f", as {order}, {convention} it fits: {' and '.join(say)}"
        else:
            why += ", and no other convention or order of the quaternion fits"
        return [f"reference.orientation: {why}"], frame.tolist(), left
    for factor, text in ((DEGREE, "deg/s taken for rad/s"), (1 / DEGREE, "rad/s for deg/s")):
        if abs(size * factor - 1) < SCALE:
            why = (
                f"its turns are {size:.3g} times those of the gyroscope: units.angular_rate, {text}"
            )
            return [f"reference.orientation: {why}"], frame.tolist(), left
    if abs(size - 1) > SCALE:
        why = f"its turns are {size:.3g} times those of the gyroscope: wrong unit or full scale"
        return [f"reference.orientation: {why}"], frame.tolist(), left
    return [], frame.tolist(), left


def _without_jumps(reference, t, w, frame):
    """Return the reference without swaps of markers and leaps, and how much was cut.

    With G the attitude by the gyroscope, q Gᵀ drifts slowly; while one marker is taken for another
    it is off. Of blocks of `BLOCK` s that of most samples is right.
    """
    start, end, turn = turns(reference)
    bias = np.median((_angles(t, w, start, end) - turn @ frame) / (end - start)[:, None], axis=0)
    steps = Rotation.from_rotvec(step_vectors((w - bias) @ frame.T, np.diff(t)))
    after = prefix_product(steps.as_quat()[:, [3, 0, 1, 2]])
    at = np.flatnonzero(reference.known & (reference.t >= t[0]) & (reference.t <= t[-1]))
    near = np.clip(np.searchsorted(t, reference.t[at]) - 1, 0, len(after) - 1)
    late = (reference.t[at] - t[near + 1])[:, None] * ((w[near] - bias) @ frame.T)
    carried = Rotation.from_quat(after[near][:, [1, 2, 3, 0]]) * Rotation.from_rotvec(late)
    off = (Rotation.from_quat(reference.q[at][:, [1, 2, 3, 0]]) * carried.inv()).as_quat()
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
    rotation = Rotation.from_quat(np.nan_to_num(reference.q, nan=1.0)[:, [1, 2, 3, 0]])
    step = [(rotation[at[k]].inv() * rotation[at[k + 1]]).as_rotvec() for k in range(3)]
    p = reference.p[even(np.isfinite(reference.p[:, 0]))]
    third = p[0] - 3 * p[1] + 3 * p[2] - p[3]
    attitude = size(step[0] - 2 * step[1] + step[2])
    return {"orientation": attitude or 0.0, "position": size(third)}


def _gain(reference, t, f, frame):
    """Return what takes specific force in the world to the places' second difference, (3, 3).

    None where places or motion are too few.
    """
    columns = at_instants(reference, t)
    q, p = (np.column_stack([columns[c] for c in names]) for names in (ORIENTATION, POSITION))
    step = float(np.median(np.diff(t)))
    k = max(1, round(0.2 / step))
    whole = np.isfinite(p[:, 0]) & np.isfinite(q[:, 0])
    middle = np.arange(k, len(t) - k, max(1, k // 2))
    middle = middle[whole[middle] & whole[middle - k] & whole[middle + k]]
    second = (p[middle - k] - 2 * p[middle] + p[middle + k]) / (k * step) ** 2
    force = np.full((len(t), 3), np.nan)
    if whole.any():
        force[whole] = Rotation.from_quat(q[whole][:, [1, 2, 3, 0]]).apply(f[whole] @ frame.T)
    weight = np.concatenate([np.arange(1, k + 1), np.arange(k - 1, 0, -1)]) / k**2
    pushed = np.column_stack([np.convolve(c, weight, "valid") for c in force.T])[middle - k + 1]
    sound = np.isfinite(pushed[:, 0])
    if sound.sum() < 50:
        return None
    pushed, second = (x[sound] - np.median(x[sound], axis=0) for x in (pushed, second))
    gain = np.linalg.lstsq(pushed, second, rcond=None)[0].T
    left = np.sqrt(((second - pushed @ gain.T) ** 2).sum() / (second**2).sum())
    # hardly any motion, or an arm: nothing is said
    return gain if left < 2 * FITS else None


def _alike_axes(gain):
    """Return the cosine of the angle between the axes of force and places."""
    size = np.linalg.det(gain)
    return (np.trace(gain) / np.cbrt(size) - 1) / 2


def _places(reference, t, f, frame, declared):
    """Return why the places do not fit specific force, carried by the attitudes."""
    gain = _gain(reference, t, f, frame)
    if gain is None:
        return []
    size = np.cbrt(np.linalg.det(gain))
    unit = (declared.get("units") or {}).get("position", "m")
    for scale in (1e3, 1e2, 1e-3, 1e-2, 10.0, 0.1):
        if abs(abs(size) / scale - 1) < 3 * SCALE:
            fits = next((u for u, m in LENGTH.items() if np.isclose(m * scale, LENGTH[unit])), None)
            say = f": declare units.position: {fits}" if fits else ""
            return [f"reference.position: {scale:g} times as far as specific force says{say}"]
    if size > 0 and _alike_axes(gain) < ALONG:
        angle = np.degrees(np.arccos(np.clip(_alike_axes(gain), -1, 1)))
        return [f"reference.position: its axes are {angle:.0f} degrees from those of orientation"]
    if size < 0:
        why = "accelerates against specific force: it is mirrored; change the sign of one axis"
        return [f"reference.position: {why}, or of orientation's vector part"]
    return []


def at_instants(reference, t):
    """Return the reference at instants, s, by column: cubics between samples, over short losses."""
    found = {name: np.full(len(t), np.nan) for name in (*ORIENTATION, *POSITION)}
    known = np.flatnonzero(reference.known)
    q = reference.q[known]
    # of the two quaternions of an attitude that near the one before
    q = q * np.cumprod(np.append(1, np.where((q[1:] * q[:-1]).sum(axis=1) < 0, -1, 1)))[:, None]
    places = np.flatnonzero(np.isfinite(reference.p[:, 0]))
    for names, at, values in (
        (ORIENTATION, known, q),
        (POSITION, places, reference.p[places]),
    ):
        times = reference.t[at]
        usual = np.median(np.diff(reference.t))
        breaks = np.flatnonzero(np.diff(times) > max(BRIDGED, 1.5 * usual)) + 1
        for part in np.split(np.arange(len(at)), breaks):
            if len(part) < 4:
                continue
            own = times[part]
            inside = np.flatnonzero((t >= own[0] - 1e-9) & (t <= own[-1] + 1e-9))
            value = CubicSpline(own, values[part])(t[inside])
            if names is ORIENTATION:
                value = value / np.linalg.norm(value, axis=1, keepdims=True)
            for name, column in zip(names, value.T, strict=True):
                found[name][inside] = column
    return found
