"""Clean stretches of a device's sessions, from which its noise is estimated."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.gaps import lost_samples
from imuloop.core.samples import (
    OWN_TIME,
    SENSORS,
    TEMPERATURE,
    TIME,
    Samples,
    holds,
    on_own_clock,
    read_columns,
)
from imuloop.core.segments import DISTURBED, MOTION, STATIC, power_cycles
from imuloop.noise.sampling import SPARSEST, Sampling

# sessions pool into one estimate where their rates agree within this share
RATE_TOLERANCE = 0.01
# samples whose median interval is the usual one
PART = 1 << 20
# what is worth a note: missing samples, share, and a change of temperature, K
LOST, TEMPERATURE_RANGE = 1e-3, 2.0


@dataclass(frozen=True)
class RecordedSession:
    """One session of a device: name, kind, samples in SI and segments by column.

    `samples` is empty where the session was rejected.
    """

    name: str
    kind: str
    samples: object
    segments: object

    @property
    def static(self):
        """Whether it is a static session, in which the device did not move."""
        return self.kind == "static" and MOTION not in np.asarray(self.segments["kind"])


@dataclass(frozen=True)
class Record:
    """Stretches of a session, one power cycle after the other (`core.segments.power_cycles`).

    For each the `slices` of its samples, and the `samplings`, where in time they lie; `lost` are
    the samples missing in gaps of a few, share of those there.
    """

    session: RecordedSession
    slices: tuple[tuple[slice, ...], ...]
    samplings: tuple[Sampling, ...]
    lost: float

    @property
    def rate(self):
        """Mean sampling rate, Hz."""
        return self.samplings[0].rate

    @property
    def lengths(self):
        """Samples of each stretch, gaps of a few samples closed up, shape (s,)."""
        return np.concatenate([sampling.closed_up().lengths for sampling in self.samplings])

    def signals(self, name):
        """Return the Signals of a column; the values of a lone stretch are a view."""
        x = np.asarray(self.session.samples[name])
        each = ([x[s] for s in slices] for slices in self.slices)
        values = (np.concatenate(parts) if len(parts) > 1 else parts[0] for parts in each)
        return [s.with_values(v) for s, v in zip(self.samplings, values, strict=True)]


def read_recorded(name, files):
    """Return the RecordedSession of a session from its kind and its files, by name."""
    segments = read_columns(files["segments"])
    return RecordedSession(name, files["kind"], Samples(files["samples"]), segments)


def closed_up(signals):
    """Return the values of the stretches of Signals, gaps of a few samples closed up."""
    return [x for signal in signals for x in signal.closed_up().split(signal.values)]


def record_of(session):
    """Return the Record of all rests of a session with two samples or more; None without any.

    A stretch of a static session has the level of the one before it, unless a disturbance lies
    between; the rests of other sessions have their own levels. A lost sample ends a stretch.
    """
    kind, rest = np.asarray(session.segments["kind"]), _steadiest(session.segments)
    used = np.flatnonzero(rest)
    start, end = (np.asarray(session.segments[c], float)[used] for c in ("start_s", "end_s"))
    cycle, level = power_cycles(session.segments)[used], np.arange(len(used))
    if session.static:
        # the disturbances before each
        level = np.cumsum(kind == DISTURBED)[used]
    t = np.asarray(session.samples[TIME])
    first, last = np.searchsorted(t, start), np.searchsorted(t, end)
    kept = last - first > 1
    first, last, level, cycle = first[kept], last[kept], level[kept], cycle[kept]
    if not len(first):
        return None
    seconds, count = (t[last - 1] - t[first]).sum(), (last - first).sum()
    first, last, stretch, lost, steps = _split_at_losses(t, first, last)
    rate, level, cycle = float(steps / seconds), level[stretch], cycle[stretch]
    samplings, slices = [], []
    for k in np.unique(cycle):
        i, j = first[cycle == k], last[cycle == k]
        start, before = np.rint((t[i] - t[i[0]]) * rate).astype(int), np.cumsum(j - i) - (j - i)
        # stamps that scatter must not lay one stretch over another
        start = before + np.maximum.accumulate(start - before)
        samplings.append(Sampling(rate, start, j - i, level[cycle == k]))
        slices.append(tuple(map(slice, i.tolist(), j.tolist())))
    return Record(session, tuple(slices), tuple(samplings), float(lost / count))


def _steadiest(segments):
    """Return the rests whose noise is that of the sensors, (n,).

    All of them, unless the device tilts in some. Then those in which it lies still, or else the
    third in which it tilts least, and of these no rest shorter than half the longest: a small tilt
    is not seen, and looks like a walk.
    """
    rest = np.asarray(segments["kind"]) == STATIC
    tilt = np.where(rest, np.asarray(segments["tilt_rad"], dtype=float), 0.0)
    if not tilt.any():
        return rest
    steady = rest & (tilt == 0)
    if not steady.any():
        steady = rest & (tilt <= np.quantile(tilt[rest], 1 / 3))
    seconds = np.asarray(segments["end_s"], float) - np.asarray(segments["start_s"], float)
    return steady & (seconds >= seconds[steady].max() / 2)


def _split_at_losses(t, first, last):
    """Return stretches split where samples are missing, and the stretch each is part of.

    Then the samples missing, and the steps of the clock in all stretches.
    """
    longest = np.argmax(last - first)
    usual = np.median(np.diff(t[first[longest] : last[longest]][:PART]))
    cuts, lost, count = [], 0, 0
    for i, j in zip(first, last, strict=True):
        steps = np.diff(t[i:j])
        missing = lost_samples(steps, usual)
        cuts.append(i + 1 + np.flatnonzero(missing))
        lost += int(missing.sum())
        # a late stamp that looks like a loss is made good by the short step after it
        count += int(np.rint(steps / usual).sum()) if len(cuts[-1]) else len(steps)
    starts = np.sort(np.concatenate([first, *cuts]))
    stretch = np.searchsorted(first, starts, side="right") - 1
    ends = np.minimum(np.append(starts[1:], last[-1]), last[stretch])
    return starts, ends, stretch, lost, count


def records_by_sensor(sessions, notes):
    """Return the `used_records` of each sensor that has any, on its own clock where it has one.

    Takes the arguments of `used_records`. The sensors share their records if all logs hold both and
    have one clock.
    """
    held = {s: [each for each in sessions if holds(each.samples, s)] for s in SENSORS}
    held = {sensor: own for sensor, own in held.items() if own}
    two_clocks = any(own in s.samples for s in sessions for own in OWN_TIME.values())
    if not two_clocks and (len(held) < 2 or all(len(o) == len(sessions) for o in held.values())):
        records = used_records(next(iter(held.values()), []), notes)
        return dict.fromkeys(held, records) if records else {}
    found, said = {}, {sensor: [] for sensor in SENSORS}
    for sensor, own in held.items():
        own = [replace(s, samples=on_own_clock(s.samples, sensor)) for s in own]
        found[sensor] = used_records(own, said[sensor])
    both = [note for note in said["accelerometer"] if note in said["gyroscope"]]
    notes += both
    notes += [f"{s}: {note}" for s, own in said.items() for note in own if note not in both]
    return {sensor: records for sensor, records in found.items() if records}


def used_records(sessions, notes):
    """Return the Records of one rate to use: of static sessions, else of all with a rest.

    Notes are added on what is left out, and on what a reader of the coefficients must know.
    """
    static = [session for session in sessions if session.static]
    found = [record_of(session) if len(session.samples) else None for session in static]
    notes += [
        f"static session {session.name} holds no rest and is left out"
        for session, record in zip(static, found, strict=True)
        if record is None
    ]
    if not any(found):
        found = [record_of(s) for s in sessions if not s.static and len(s.samples)]
        if any(found):
            count = sum(len(record.lengths) for record in found if record)
            seconds = max(record.lengths.max() / record.rate for record in found if record)
            notes.append(
                f"no static record: from all {count} rests, the longest of {seconds:.3g} s; what "
                f"changes the output over more than {seconds / 3:.2g} s (flicker, walk, ramp) is "
                "not seen there and only limited from above"
            )
    records = [record for record in found if record]
    largest, kept = max(records, key=lambda record: record.lengths.sum(), default=None), []
    for record in records:
        if abs(record.rate / largest.rate - 1) <= RATE_TOLERANCE:
            kept.append(record)
        else:
            notes.append(
                f"session {record.session.name} has {record.rate:.4g} Hz and is left out beside "
                f"{largest.session.name} with {largest.rate:.4g} Hz"
            )
    for record in kept:
        notes += [f"session {record.session.name}: {note}" for note in _conditions(record)]
    return kept


def _conditions(record):
    """Yield notes on the gaps and the temperature of a record."""
    if jumps := len(record.samplings) - 1:
        yield (
            f"{jumps} gap(s) longer than all that was recorded; noise is not followed across, "
            "each side is a record of its own"
        )
    if any(sampling.is_sparse for sampling in record.samplings):
        yield f"gaps leave less than 1/{SPARSEST} of the time: no lines are sought"
    if record.lost > LOST:
        yield (
            f"{100 * record.lost:.2g} % of the samples are missing, a few at a time; the gaps are "
            "closed up, so that K, R and correlation times may be off by as much"
        )
    if TEMPERATURE in record.session.samples:
        values = np.concatenate([signal.values for signal in record.signals(TEMPERATURE)])
        low, high = np.fmin.reduce(values), np.fmax.reduce(values)
        if high - low > TEMPERATURE_RANGE:
            yield (
                f"temperature went from {low:.1f} to {high:.1f} degC; B, K and R hold the bias' "
                "dependence on it"
            )
