"""Clean stretches of a device's sessions, which its noise is estimated from."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.samples import TEMPERATURE, TIME, lost_samples
from imuloop.core.segments import DISTURBED, STATIC, runs
from imuloop.noise.periodogram import SPARSEST, is_sparse
from imuloop.noise.sampling import Sampling

# sessions pool into one estimate where their rates agree within this share
RATE_TOLERANCE = 0.01
# samples that are looked at together
PART = 1 << 20
# what is worth a note: spread of the sampling interval and missing samples, shares; temperature, K
JITTER, LOST, TEMPERATURE_RANGE = 0.05, 1e-3, 2.0


@dataclass(frozen=True)
class RecordedSession:
    """One session of a device: name, kind, samples in SI and segments by column.

    `samples` is empty where the session was rejected.
    """

    name: str
    kind: str
    samples: object
    segments: object


@dataclass(frozen=True)
class Record:
    """Stretches of a session, run by run (`imuloop.core.segments.runs`).

    For each run the `slices` of its samples, and the `samplings`, where in time they lie; `jitter`
    is the spread of the sampling interval, share of its mean, `lost` the samples missing in gaps of
    a few, share of those there.
    """

    session: RecordedSession
    slices: tuple[tuple[slice, ...], ...]
    samplings: tuple[Sampling, ...]
    jitter: float
    lost: float

    @property
    def rate(self):
        """Mean sampling rate, Hz."""
        return self.samplings[0].rate

    @property
    def lengths(self):
        """Samples of each stretch, gaps of a few samples closed up, shape (s,)."""
        return np.array([n for sampling in self.samplings for n in sampling.closed_up().lengths])

    def runs(self, name):
        """Return the Runs of a column; the values of a lone stretch are a view."""
        x = np.asarray(self.session.samples[name])
        each = ([x[s] for s in slices] for slices in self.slices)
        values = (np.concatenate(parts) if len(parts) > 1 else parts[0] for parts in each)
        return [s.with_values(v) for s, v in zip(self.samplings, values, strict=True)]


def closed_up(runs):
    """Return the values of the stretches of Runs, gaps of a few samples closed up."""
    return [x for run in runs for x in run.closed_up().split(run.values)]


def record_of(session, disturbed=False):
    """Return the Record of all rests of a session with two samples or more; None without any.

    A stretch of a static session has the level of the one before it, unless a disturbance lies
    between; the rests of other sessions have levels of their own. A lost sample ends a stretch.
    Where `disturbed`, disturbed stretches stay in, and one level holds all through.
    """
    kind, still = np.asarray(session.segments["kind"]), _steadiest(session.segments)
    begins, ends = (np.asarray(session.segments[c], float) for c in ("start_s", "end_s"))
    used = np.flatnonzero(still | (disturbed & (kind == DISTURBED)))
    used = used[np.argsort(begins[used], kind="stable")]
    start, end, run = begins[used], ends[used], runs(session.segments)[used]
    t = np.asarray(session.samples[TIME])
    first, last = np.searchsorted(t, start), np.searchsorted(t, end)
    level = np.arange(len(used))
    if session.kind == "static":
        # the disturbances before each
        level = np.searchsorted(np.sort(ends[kind == DISTURBED]), start, side="right")
    if disturbed:
        # stretches that follow each other without a gap are one
        new = np.r_[True, start[1:] > end[:-1]]
        first, last, run = first[new], last[np.r_[new[1:], True]], run[new]
        level = np.zeros(len(first), dtype=int)
    kept = last - first > 1
    first, last, level, run = first[kept], last[kept], level[kept], run[kept]
    if not len(first):
        return None
    seconds, count = (t[last - 1] - t[first]).sum(), (last - first).sum()
    first, last, of, lost, slots, jitter = _parted(t, first, last)
    level, run, interval = level[of], run[of], seconds / slots
    rate, samplings, slices = float(1 / interval), [], []
    for k in np.unique(run):
        i, j = first[run == k], last[run == k]
        n = j - i
        start, before = np.rint((t[i] - t[i[0]]) * rate).astype(int), np.cumsum(n) - n
        # stamps that scatter must not lay one stretch over another
        start = before + np.maximum.accumulate(start - before)
        samplings.append(Sampling(rate, *(tuple(x.tolist()) for x in (start, n, level[run == k]))))
        slices.append(tuple(map(slice, i.tolist(), j.tolist())))
    return Record(session, tuple(slices), tuple(samplings), jitter, float(lost / count))


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
    still = rest & (tilt == 0)
    used = still if still.any() else rest & (tilt <= np.quantile(tilt[rest], 1 / 3))
    seconds = np.asarray(segments["end_s"], float) - np.asarray(segments["start_s"], float)
    return used & (seconds >= seconds[used].max() / 2)


def _parted(t, first, last):
    """Return stretches parted where samples are missing, and the stretch each is part of.

    Then the samples missing, the steps of the clock in all stretches, and the standard deviation of
    those without a loss, share of their mean.
    """
    longest = np.argmax(last - first)
    usual = np.median(np.diff(t[first[longest] : last[longest]][: PART + 1]))
    cuts, lost, slots, moments = [], 0, 0, np.zeros(3)
    for i, j in zip(first, last, strict=True):
        for begin in range(i, j - 1, PART):
            steps = np.diff(t[begin : min(begin + PART + 1, j)])
            missing = lost_samples(steps, usual)
            cuts.append(begin + 1 + np.flatnonzero(missing))
            lost += int(missing.sum())
            # a late stamp that looks like a loss is made good by the short step after it
            slots += int(np.rint(steps / usual).sum()) if len(cuts[-1]) else len(steps)
            off = steps[missing == 0] / usual - 1
            moments += len(off), off.sum(), off @ off
    edges = np.sort(np.concatenate([first, *cuts]))
    of = np.searchsorted(first, edges, side="right") - 1
    ends = np.minimum(np.append(edges[1:], last[-1]), last[of])
    mean, square = moments[1:] / moments[0]
    return edges, ends, of, lost, slots, float(np.sqrt(max(square - mean**2, 0.0)) / (1 + mean))


def static_records(sessions, notes):
    """Return the Record of each static session that holds a rest, else note that it holds none."""
    static = [session for session in sessions if session.kind == "static"]
    found = {s.name: record_of(s) if len(s.samples) else None for s in static}
    notes += [
        f"static session {name} holds no rest and is left out"
        for name, record in found.items()
        if record is None
    ]
    return [record for record in found.values() if record is not None]


def all_rests(sessions, notes):
    """Return a Record of each session that holds a rest, and note what rests cannot tell."""
    records = [record_of(s) for s in sessions if s.kind != "static" and len(s.samples)]
    records = [record for record in records if record is not None]
    if records:
        count = sum(len(record.lengths) for record in records)
        seconds = max(record.lengths.max() / record.rate for record in records)
        notes.append(
            f"no static record: from all {count} rests, the longest of {seconds:.3g} s; what "
            f"changes the output over more than {seconds / 3:.2g} s (flicker, walk, ramp) is not "
            "seen there and only limited from above"
        )
    return records


def one_rate(records, notes):
    """Return the records that share the rate of the largest one, and note which do not."""
    largest, kept = max(records, key=lambda record: record.lengths.sum()), []
    for record in records:
        if abs(record.rate / largest.rate - 1) <= RATE_TOLERANCE:
            kept.append(record)
        else:
            notes.append(
                f"session {record.session.name} has {record.rate:.4g} Hz and is left out beside "
                f"{largest.session.name} with {largest.rate:.4g} Hz"
            )
    return kept


def note_conditions(record, notes):
    """Note gaps, jitter and temperature of a record."""
    found, jumps = [], len(record.samplings) - 1
    if jumps:
        found.append(
            f"{jumps} gap(s) longer than all that was recorded; noise is not followed across, "
            "each side is a record of its own"
        )
    if any(map(is_sparse, record.samplings)):
        found.append(f"gaps leave less than 1/{SPARSEST} of the time: no lines are sought")
    if record.jitter > JITTER:
        found.append(
            f"sampling interval scatters by {100 * record.jitter:.2g} %; the estimate takes the "
            "mean rate"
        )
    if record.lost > LOST:
        found.append(
            f"{100 * record.lost:.2g} % of the samples are missing, a few at a time; the gaps are "
            "closed up, so that K, R and correlation times may be off by as much"
        )
    if TEMPERATURE in record.session.samples:
        runs = record.runs(TEMPERATURE)
        low = np.fmin.reduce([np.fmin.reduce(run.values) for run in runs])
        high = np.fmax.reduce([np.fmax.reduce(run.values) for run in runs])
        if high - low > TEMPERATURE_RANGE:
            found.append(
                f"temperature went from {low:.1f} to {high:.1f} degC; B, K and R hold the bias' "
                "dependence on it"
            )
    notes += [f"session {record.session.name}: {note}" for note in found]
