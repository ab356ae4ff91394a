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
from imuloop.noise.signal import SPARSEST, Signal

# sessions share one estimate if their rates agree within this share
RATE_TOLERANCE = 0.01
# the usual step of time is the median of the first PART steps
PART = 1 << 20
# least share of missing samples, and least change of temperature, K, that are worth a note
LOST, TEMPERATURE_RANGE = 1e-3, 2.0


@dataclass(frozen=True)
class RecordedSession:
    """One recorded session of a device: its name, kind, samples in SI, and table of segments.

    `kind` is ``static``, ``six_position`` or another kind of the config. `samples` are Samples,
    which have no rows if the session was rejected. `segments` has a row for each rest, motion,
    disturbance and gap.
    """

    name: str
    kind: str
    samples: object
    segments: object

    @property
    def static(self):
        """Whether this is a static session in which the device never moved."""
        return self.kind == "static" and MOTION not in np.asarray(self.segments["kind"])


@dataclass(frozen=True)
class Record:
    """The clean stretches of one session: samples at rest, without disturbances and gaps."""

    session: RecordedSession
    rows: tuple[list[slice], ...]  # rows of the samples in each stretch, for each power cycle
    cycles: tuple[Signal, ...]  # when the stretches were sampled, for each power cycle
    # number of samples that are missing in gaps of a few, over the number that are there
    lost: float

    @property
    def rate(self):
        """Mean sampling rate, Hz."""
        return self.cycles[0].rate

    @property
    def lengths(self):
        """Number of samples of each stretch, (s,); a gap of a few samples does not end one."""
        return np.concatenate([cycle.closed_up().lengths for cycle in self.cycles])

    def signals(self, name):
        """Return the values of a column of the samples, a list with a Signal for each power cycle.

        `name` is the name of the column, such as ``gx``.
        """
        x = np.asarray(self.session.samples[name])
        values = [np.concatenate([x[rows] for rows in cycle]) for cycle in self.rows]
        return [replace(s, values=x) for s, x in zip(self.cycles, values, strict=True)]

    def stretches(self, name):
        """Return the values of a column of the samples, a list with an array for each stretch.

        `name` is the name of the column, such as ``gx``. A gap of a few samples does not end a
        stretch.
        """
        return [x for s in self.signals(name) for x in s.closed_up().split(s.values)]


def read_recorded(name, files):
    """Return the RecordedSession of one session, which is read from its files.

    `name` is the name of the session. `files` is a dict with the ``kind`` of the session and the
    paths of its ``samples`` and ``segments``, Parquet files.
    """
    segments = read_columns(files["segments"])
    return RecordedSession(name, files["kind"], Samples(files["samples"]), segments)


def record_of(session):
    """Return the Record of one session, its clean stretches at rest, or None if it has none.

    `session` is a RecordedSession. The Record has all steady rests (`_steady_rests`) of two samples
    or more; without any, the result is None. Each rest has the number of a level; rests of the same
    level share the mean of their output. In a static session a new level begins after each
    disturbance, because it may have moved the device. In other sessions, each rest has its own
    level. A missing sample ends a stretch.
    """
    if not len(session.samples):
        return None
    segments, t = session.segments, np.asarray(session.samples[TIME])
    first, last = (np.searchsorted(t, np.asarray(segments[c], float)) for c in ("start_s", "end_s"))
    used = _steady_rests(segments) & (last - first > 1)
    if not used.any():
        return None
    disturbances = np.cumsum(np.asarray(segments["kind"]) == DISTURBED)
    level = disturbances if session.static else np.arange(len(first))
    stretches, lost, rate = _split_at_losses(t, first[used], last[used])
    first, last, rest = np.transpose(stretches)
    level, cycle = level[used][rest], power_cycles(segments)[used][rest]
    rows, signals = [], []
    for number in np.unique(cycle):
        here = cycle == number
        i, lengths = first[here], (last - first)[here]
        start, before = np.rint((t[i] - t[i[0]]) * rate).astype(int), np.cumsum(lengths) - lengths
        # scattered time stamps must not make one stretch overlap the next
        start = before + np.maximum.accumulate(start - before)
        levels = np.unique(level[here], return_inverse=True)[1]
        signals.append(Signal(rate, start, lengths, levels))
        rows.append([*map(slice, i, i + lengths)])
    return Record(session, tuple(rows), tuple(signals), lost)


def _steady_rests(segments):
    """Return which of n segments are steady rests, in which only the sensors make noise, (n,).

    The result is a mask. If the device tilts in no rest, all rests are steady. If it tilts in some
    of the rests, those without a tilt are steady; if it tilts in every rest, the third of them with
    the least tilt is steady. Exception: if it tilts in any rest, a rest that is shorter than half
    the longest of the steady ones does not count as steady. In a short rest a small tilt is not
    noticed, but it looks like a random walk. `segments` is the table of segments, with the tilt of
    each rest.
    """
    rest, tilt = np.asarray(segments["kind"]) == STATIC, np.asarray(segments["tilt_rad"], float)
    if not tilt[rest].any():
        return rest
    steady = rest & (tilt <= (np.quantile(tilt[rest], 1 / 3) if tilt[rest].all() else 0.0))
    seconds = np.asarray(segments["end_s"], float) - np.asarray(segments["start_s"], float)
    return steady & (seconds >= seconds[steady].max() / 2)


def _split_at_losses(t, first, last):
    """Return rests cut at each missing sample, the share of missing samples, and the rate.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Time stamps, s.
    first, last : ndarray of int, shape (m,)
        First row of each of m rests, and the row after its last.

    Returns
    -------
    stretches : list of tuple
        For each stretch its first row, the row after its last, and the index of its rest.
    lost : float
        Number of missing samples over the number of samples that are there, in all rests.
    rate : float
        Mean sampling rate over all rests, Hz.
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
        # a late time stamp looks like a loss: the sum counts the short step after it, too
        count += int(np.rint(steps / usual).sum()) if missing.any() else len(steps)
    rate = count / (t[last - 1] - t[first]).sum()
    return stretches, float(lost / (last - first).sum()), float(rate)


def records_by_sensor(sessions, notes):
    """Return the Records from which the noise of each sensor is estimated, a list of pairs.

    A pair has the names of one or both sensors, and a list of their Records. Both sensors are in
    one pair if they were recorded in the same sessions, on one clock. A sensor without a rest is in
    no pair. `sessions` is a list of RecordedSession. Remarks are added to the list `notes`: which
    sessions are left out, and what limits the coefficients. Each remark begins with the name of the
    sensor if the two sensors do not share their Records.
    """
    two_clocks = any(stamps in s.samples for s in sessions for stamps in OWN_TIME.values())
    groups, pairs = {}, []
    for sensor in SENSORS:
        if names := tuple(s.name for s in sessions if holds(s.samples, sensor)):
            groups.setdefault((names, sensor if two_clocks else None), []).append(sensor)
    for (names, _), sensors in groups.items():
        chosen = [s for s in sessions if s.name in names]
        chosen = [replace(s, samples=on_own_clock(s.samples, sensors[0])) for s in chosen]
        records, new_notes = choose_records(chosen)
        notes += [f"{sensors[0]}: {note}" if len(groups) > 1 else note for note in new_notes]
        if records:
            pairs.append((sensors, records))
    return pairs


def choose_records(sessions):
    """Return the Records from which to estimate the noise of one sensor, and remarks, two lists.

    `sessions` is a list of RecordedSession, at the times of this sensor. The Records are those of
    the static sessions with a rest. If there are none, they are those of all other sessions with a
    rest. Sessions whose sampling rate differs from the rate of the Record with the most samples by
    more than the share `RATE_TOLERANCE` are left out. The remarks name the sessions that are left
    out, and what limits the noise coefficients.
    """
    by_name = {session.name: record_of(session) for session in sessions if session.static}
    left_out = [name for name, record in by_name.items() if record is None]
    notes = [f"static session {name} holds no rest and is left out" for name in left_out]
    if len(left_out) == len(by_name):
        by_name = {session.name: record_of(session) for session in sessions if not session.static}
    records = [record for record in by_name.values() if record]
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
        name = f"session {record.session.name}"
        if abs(record.rate / largest.rate - 1) <= RATE_TOLERANCE:
            kept.append(record)
            notes += [f"{name}: {note}" for note in _conditions(record)]
        else:
            other = f"{largest.session.name} with {largest.rate:.4g} Hz"
            notes.append(f"{name} has {record.rate:.4g} Hz and is left out, unlike {other}")
    return kept, notes


def _conditions(record):
    """Yield remarks on the gaps and the temperature of `record`, a Record, each a text, if any."""
    if jumps := len(record.cycles) - 1:
        yield f"{jumps} gap(s) longer than all that was recorded; noise is not followed across"
    if any(cycle.is_sparse for cycle in record.cycles):
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
            yield f"temperature was {low:.1f} to {high:.1f} degC; B, K and R include its effect"
