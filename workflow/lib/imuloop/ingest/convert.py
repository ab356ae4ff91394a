"""From the rows of a log to samples: SI units, time from zero, faulty rows dropped and counted."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS, LOGGED_TIME, OWN_TIME, TEMPERATURE, TIME
from imuloop.core.units import TEMPERATURE as DEGREES
from imuloop.ingest import increments, misread
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import HELD
from imuloop.ingest.spellings import SENSORS

# what no sensor gives, whatever it is logged in: counts of 32 bits, taken for SI, end at 4.3e9; the
# widest accelerometers at 2e6 m/s^2
BEYOND = 1e10


_of_channels = partial(dict.fromkeys, CHANNELS, 0)


@dataclass
class Counts:
    """What became of the rows of a log, each counted once, and why it cannot be used (`reasons`).

    `identical` are rows that repeat the one before in stamp and all values: nothing is lost.
    `is_gravity` and `in_two_units` are as in `misread`. `increments`, `pps` and `logged` are what
    quality.json says of increments, of 1PPS marks and of time stamps that were rebuilt, None
    without; `rebuilt` is the line on these. `start_ns` is the moment of the first sample, ns since
    1970, None without dates, `begin_s` how long it is after the log's first stamp, s, which is
    `origin` as logged.
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
    """Return the columns of samples of a log, without any row."""
    names = [TIME, *CHANNELS, *[TEMPERATURE] * log.temperature]
    names += [OWN_TIME[log.slower]] if log.slower else []
    return {name: np.empty(0) for name in names}


# a count of 1e306 has no value in SI, and stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def si_samples(rows, timing, log, units, raw_units):
    """Return the columns of the samples of a log, `t` strictly increasing from 0, and the `Counts`.

    Parameters
    ----------
    rows, timing, log : Rows, Timing, RawLog
        Rows of the log, when they were sampled, and the log as it was read.
    units, raw_units : dict
        Name of each unit, and `RawUnit` of each sensor, by quantity.
    """
    steps, ends_gap = rows.scale, np.zeros(len(rows.x), dtype=bool)
    summed, first = increments.factors(units), ends_gap
    if log.slower and summed:
        raise ImuloopError(
            f"units of {' and '.join(summed)}: increments of two sensors have to be on one clock"
        )
    if timing.even:
        steps = timing.even.step
    elif increments.by_stamps(log, units):
        dt = (timing.x - timing.before) * timing.scale
        steps, ends_gap = increments.intervals(dt, timing.usual)
        first = timing.before < timing.origin
    raw = rows.values | increments.rates(rows, steps, units)
    values = {name: raw[name] for name in CHANNELS}
    for quantity in {*SENSORS} & {*log.found}:
        values |= {name: raw_units[quantity].to_si(raw[name]) for name in SENSORS[quantity]}
    if log.temperature:
        scale, zero = DEGREES[units["temperature"]]
        values[TEMPERATURE] = (raw[TEMPERATURE] - zero) * scale
    missing, impossible, bad = {}, {}, ~timing.usable
    for name, x in values.items():
        lacks = ~np.isfinite(raw[name])
        beyond = ~lacks & (np.abs(x) > BEYOND)
        missing[name] = int(np.count_nonzero(timing.inside & lacks))
        impossible[name] = int(np.count_nonzero(timing.inside & beyond))
        if name == TEMPERATURE:
            values[name] = np.where(lacks | beyond, np.nan, x)
        else:
            bad |= lacks | beyond
    # what becomes of each row, the first that is true
    masks = {
        "identical": rows.same,
        "outside": ~timing.inside,
        "non_finite": bad,
        # a clock that is rebuilt takes the rows as they come
        "duplicates": (timing.x == timing.before) & (timing.even is None),
        "out_of_order": (timing.x < timing.before) & (timing.even is None),
        "without_interval": first,
    }
    fate = np.select([*masks.values()], range(1, 7), 0)
    keep, numbers = fate == 0, np.bincount(fate, minlength=7)[1:].tolist()
    counts = Counts(
        **dict(zip(masks, numbers, strict=True)),
        by_usual_step=int((keep & ends_gap).sum()),
        read=len(rows.x),
        missing_values=missing,
        impossible_values=impossible,
        time_unit=timing.time_unit,
        clock=timing.clock,
        is_gravity=misread.is_gravity(rows.values),
        in_two_units=misread.in_two_units(rows.x, rows.values) if rows.stamped else None,
    )
    counts.increments = increments.figures(log, units, counts, timing)
    if not keep.any():
        return no_samples(log), counts
    zero, t = timing.x[keep][0].item(), timing.times(keep)
    counts.origin, counts.begin_s = timing.origin, float((zero - timing.origin) * timing.scale)
    counts.start_ns = timing.moment(zero)
    samples = {TIME: t} | {name: x[keep] for name, x in values.items()}
    if timing.even:
        number = timing.even.number(timing.number[keep])
        samples |= {TIME: (number - number[0]) * timing.even.step, LOGGED_TIME: t}
    if timing.timeline:
        counts.pps = timing.timeline.figures_beside(timing.x[keep])
    if log.slower:
        own = (rows.stamps[HELD][0][keep] - zero) * timing.scale
        if timing.even:
            # rebuilt with the time stamps of the rows
            _, first, which = np.unique(own, return_index=True, return_inverse=True)
            own = samples[TIME][first][which]
        samples[OWN_TIME[log.slower]] = own
    return samples, counts
