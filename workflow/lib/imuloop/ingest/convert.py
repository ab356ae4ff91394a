"""From the rows of a log to samples: SI units, time from zero, faulty rows dropped and counted."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS, LOGGED_TIME, OWN_TIME, TEMPERATURE, TIME
from imuloop.core.units import TEMPERATURE as DEGREES
from imuloop.core.units import RawUnit
from imuloop.ingest import increments, misread
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import HELD, STAMP
from imuloop.ingest.spellings import SENSORS

# larger than any value of a sensor, in any unit: counts of 32 bits, taken for SI, end at 4.3e9, the
# widest accelerometers at 2e6 m/s^2
BEYOND = 1e10


_of_channels = partial(dict.fromkeys, CHANNELS, 0)


@dataclass
class Counts:
    """Numbers of used and dropped rows of a log, and findings on its clock and its values.

    Each row is counted once. `reasons` are lines on a log that cannot be used. `identical` rows
    repeat the one before in stamp and all values. `is_gravity` and `in_two_units` are results of
    `misread`. `increments`, `pps` and `logged` are entries of quality.json on increments, 1PPS
    marks and rebuilt time stamps, or None; `rebuilt` is the line on the last. `start_ns` is the
    moment of the first sample, ns since 1970, None if stamps are not dates. It lies `begin_s` s
    after the log's first stamp, `origin` as logged.
    """

    reasons: list = field(default_factory=list)
    read: int = 0
    outside: int = 0
    non_finite: int = 0
    duplicates: int = 0
    identical: int = 0
    out_of_order: int = 0
    without_interval: int = 0
    by_usual_step: int = 0
    missing_values: dict = field(default_factory=_of_channels)
    impossible_values: dict = field(default_factory=_of_channels)
    spiked: int = 0
    spike_values: dict = field(default_factory=_of_channels)
    start_ns: int | None = None
    begin_s: float = 0.0
    origin: float = 0.0
    time_unit: str | None = None
    clock: Clock = field(default_factory=Clock)
    is_gravity: bool = False
    in_two_units: dict | None = None
    increments: dict | None = None
    pps: dict | None = None
    logged: dict | None = None
    rebuilt: str | None = None


def no_samples(log):
    """Return the columns of the samples of a RawLog by name, a dict, each without rows."""
    names = [TIME, *CHANNELS, *[TEMPERATURE] * log.temperature]
    names += [OWN_TIME[log.slower]] if log.slower else []
    return {name: np.empty(0) for name in names}


# a count of 1e306 has no value in SI, and stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def si_samples(rows, raw_units):
    """Return the samples of `Rows`, a dict of columns of shape (n,) in SI, and their `Counts`.

    The column ``t`` starts at 0 and rises. `raw_units` are the `RawUnit` of each sensor by
    quantity. Rows with a fault are left out and counted.
    """
    log, summed = rows.log, increments.factors(rows.units)
    if log.slower and summed:
        raise ImuloopError(
            f"units of {' and '.join(summed)}: increments of two sensors have to be on one clock"
        )
    values, first, wide, usual = increments.rates(rows)
    values = rows.values | values
    counts = Counts(
        read=len(rows.x),
        missing_values=dict.fromkeys(values, 0),
        impossible_values=dict.fromkeys(values, 0),
        time_unit=rows.time_unit,
        clock=rows.clock,
        is_gravity=misread.is_gravity(rows.values),
    )
    if rows.stamped:
        counts.in_two_units = misread.in_two_units(rows.stamps[STAMP][0], rows.values)
    logged = {*SENSORS} & {*log.found}
    unit_of = {name: raw_units[q] for q in logged for name in SENSORS[q]}
    if log.temperature:
        unit_of[TEMPERATURE] = RawUnit("degC", *DEGREES[rows.units["temperature"]])
    inside, before, bad = rows.inside, rows.before, ~rows.usable
    for name, raw in values.items():
        unit = unit_of.get(name)
        # a channel in SI needs no copy
        is_si = unit is None or (unit.scale, unit.offset) == (1.0, 0.0)
        values[name] = x = raw if is_si else unit.to_si(raw)
        # the comparison is written so that not-a-number fails it
        if not (x.max(initial=0.0) <= BEYOND and x.min(initial=0.0) >= -BEYOND):
            wrong = ~(np.abs(x) <= BEYOND)
            lacks = ~np.isfinite(raw)
            counts.missing_values[name] = int(np.count_nonzero(inside & lacks))
            counts.impossible_values[name] = int(np.count_nonzero(inside & wrong & ~lacks))
            if name == TEMPERATURE:
                values[name] = np.where(wrong, np.nan, x)
            else:
                bad |= wrong
    # the first fate that is true of a row counts; on an even clock the order of stamps does not
    # matter
    fates = {
        "identical": rows.same,
        "outside": ~inside,
        "non_finite": bad,
        "duplicates": (rows.x == before) & (not rows.even),
        "out_of_order": (rows.x < before) & (not rows.even),
        "without_interval": first,
    }
    keep = np.ones(len(rows.x), dtype=bool)
    for name, mask in fates.items():
        setattr(counts, name, int(np.count_nonzero(keep & mask)))
        keep &= ~mask
    counts.by_usual_step = int(np.count_nonzero(keep & wide))
    counts.increments = increments.figures(rows, counts, usual)
    if not keep.any():
        return no_samples(log), counts
    # whole columns need no copy
    first, keep = keep.argmax(), slice(None) if keep.all() else keep
    zero, t = rows.x[first].item(), rows.times(keep)
    counts.origin, counts.start_ns = rows.origin, rows.moment(zero)
    counts.begin_s = float((zero - rows.origin) * rows.scale)
    samples = {TIME: t} | {name: x[keep] for name, x in values.items()}
    if rows.even:
        number = rows.even.number(rows.number[keep])
        samples |= {TIME: (number - number[0]) * rows.even.step, LOGGED_TIME: t}
    if rows.timeline:
        counts.pps = rows.timeline.figures_beside(rows.x[keep])
    if log.slower:
        own = (rows.stamps[HELD][0][keep] - zero) * rows.scale
        if rows.even:
            # each of its samples gets the rebuilt time of the first row that holds it
            _, first, which = np.unique(own, return_index=True, return_inverse=True)
            own = samples[TIME][first][which]
        samples[OWN_TIME[log.slower]] = own
    return samples, counts
