"""Clean stretches of a device's sessions, from which its noise is estimated."""

from dataclasses import dataclass, replace
from itertools import pairwise

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
# the usual step of time is the median of so many at most
PART = 1 << 20
# least share of missing samples, and least change of temperature, K, that are worth a note
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
    """Stretches of a session, one power cycle after the other (`core.segments.power_cycles`)."""

    session: RecordedSession
    rows: tuple[np.ndarray, ...]  # first row of each stretch, (s,), for each power cycle
    samplings: tuple[Sampling, ...]  # when the stretches were sampled, for each power cycle
    lost: float  # number of samples missing in gaps of a few, share of those that are there

    @property
    def rate(self):
        """Mean sampling rate, Hz."""
        return self.samplings[0].rate

    @property
    def lengths(self):
        """Samples of each stretch, shape (s,); gaps of a few samples end no stretch."""
        return np.concatenate([sampling.closed_up().lengths for sampling in self.samplings])

    def signals(self, name):
        """Return the Signal of a column for each power cycle."""
        x = np.asarray(self.session.samples[name])
        return [
            s.with_values(np.concatenate([x[i:j] for i, j in zip(r, r + s.lengths, strict=True)]))
            for r, s in zip(self.rows, self.samplings, strict=True)
        ]

    def stretches(self, name):
        """Return the values of a column in each stretch; gaps of a few samples end no stretch."""
        return [x for s in self.signals(name) for x in s.closed_up().split(s.values)]


def read_recorded(name, files):
    """Return the RecordedSession of a session from its kind and its files, by name."""
    segments = read_columns(files["segments"])
    return RecordedSession(name, files["kind"], Samples(files["samples"]), segments)


def record_of(session):
    """Return the Record of all rests of a session with two samples or more; None without any.

    A rest of a static session has the level of the rest before it, unless a disturbance lies
    between. Each rest of another session has its own level. A lost sample ends a stretch.
    """
    if not len(session.samples):
        return None
    segments, t = session.segments, np.asarray(session.samples[TIME])
    first, last = (np.searchsorted(t, np.asarray(segments[c], float)) for c in ("start_s", "end_s"))
    used = np.flatnonzero(_steadiest(segments) & (last - first > 1))
    if not len(used):
        return None
    disturbances = np.cumsum(np.asarray(segments["kind"]) == DISTURBED)
    level = disturbances if session.static else np.arange(len(first))
    first, last = first[used], last[used]
    seconds, count = (t[last - 1] - t[first]).sum(), (last - first).sum()
    first, last, rest, lost, steps = _split_at_losses(t, first, last)
    rate, cycle = float(steps / seconds), power_cycles(segments)[used][rest]
    rows, samplings = [], []
    for k in np.unique(cycle):
        i, lengths = first[cycle == k], (last - first)[cycle == k]
        start, before = np.rint((t[i] - t[i[0]]) * rate).astype(int), np.cumsum(lengths) - lengths
        # time stamps that scatter must not lay one stretch over another
        start = before + np.maximum.accumulate(start - before)
        levels = np.unique(level[used][rest][cycle == k], return_inverse=True)[1]
        samplings.append(Sampling(rate, start, lengths, levels))
        rows.append(i)
    return Record(session, tuple(rows), tuple(samplings), float(lost / count))


def _steadiest(segments):
    """Return which segments are rests whose noise is that of the sensors, a mask, (n,).

    These are all rests, unless the device tilts in some. Then they are those in which it lies
    still, or else the third in which it tilts least. Of these, rests shorter than half the longest
    are left out: a small tilt is not seen in them and looks like a walk.
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
    """Return stretches that end where samples are missing, and what is missing.

    Takes the time stamps, (n,), and the first and last row (half-open) of each rest. Returns the
    same of each stretch, the index of its rest, the number of missing samples, and the number of
    steps of the clock in all rests.
    """
    longest = np.argmax(last - first)
    usual = np.median(np.diff(t[first[longest] : last[longest]][:PART]))
    stretches, lost, count = [], 0, 0
    for rest, (i, j) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        steps = np.diff(t[i:j])
        missing = lost_samples(steps, usual)
        edges = [i, *(i + 1 + np.flatnonzero(missing)).tolist(), j]
        stretches += [(*ends, rest) for ends in pairwise(edges)]
        lost += int(missing.sum())
        # a late time stamp looks like a loss; the short step after it makes up for it
        count += int(np.rint(steps / usual).sum()) if missing.any() else len(steps)
    return (*np.transpose(stretches), lost, count)


def records_by_sensor(sessions, notes):
    """Return the Records to use, a list of pairs: a tuple of sensors, and what they share.

    Sensors share their Records if all logs hold both and have one clock. A sensor without a rest is
    in no pair. Takes a list of RecordedSessions, and a list of notes, to which it adds those of
    `used_records`.
    """
    holders = {s: [each for each in sessions if holds(each.samples, s)] for s in SENSORS}
    holders = {sensor: own for sensor, own in holders.items() if own}
    if not holders:
        return []
    two_clocks = any(own in s.samples for s in sessions for own in OWN_TIME.values())
    shared = not two_clocks and all(len(own) == len(sessions) for own in holders.values())
    groups = [tuple(holders)] if shared else [(sensor,) for sensor in holders]
    found, sensors_by_note = [], {}
    for sensor, *others in groups:
        own = [replace(s, samples=on_own_clock(s.samples, sensor)) for s in holders[sensor]]
        records, new = used_records(own)
        if records:
            found.append(((sensor, *others), records))
        for note in new:
            sensors_by_note.setdefault(note, []).append(sensor)
    for note, sensors in sensors_by_note.items():
        notes.append(note if len(sensors) == len(groups) else f"{sensors[0]}: {note}")
    return found


def used_records(sessions):
    """Return the Records to use, and notes on them, lists.

    They are those of static sessions, else those of all sessions with a rest, and have one rate.
    The notes say what is left out and what a reader of the coefficients must know.
    """
    found = {session.name: record_of(session) for session in sessions if session.static}
    left_out = [name for name, record in found.items() if record is None]
    notes = [f"static session {name} holds no rest and is left out" for name in left_out]
    if len(left_out) == len(found):
        found = {session.name: record_of(session) for session in sessions if not session.static}
    records = [record for record in found.values() if record]
    if records and not records[0].session.static:
        count = sum(len(record.lengths) for record in records)
        seconds = max(record.lengths.max() / record.rate for record in records)
        notes.append(
            f"no static record: from all {count} rests, the longest of {seconds:.3g} s; what "
            f"changes the output over more than {seconds / 3:.2g} s (flicker, walk, ramp) is "
            "not seen there and only limited from above"
        )
    largest, kept = max(records, key=lambda record: record.lengths.sum(), default=None), []
    for record in records:
        if abs(record.rate / largest.rate - 1) <= RATE_TOLERANCE:
            kept.append(record)
            notes += [f"session {record.session.name}: {note}" for note in _conditions(record)]
        else:
            notes.append(
                f"session {record.session.name} has {record.rate:.4g} Hz and is left out beside "
                f"{largest.session.name} with {largest.rate:.4g} Hz"
            )
    return kept, notes


def _conditions(record):
    """Yield notes on the gaps and the temperature of a Record, each a text."""
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
