"""From the rows of a log to samples: SI units, time from zero, faulty rows dropped and counted."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS, LOGGED_TIME, OWN_TIME, TEMPERATURE, TIME
from imuloop.core.units import TEMPERATURE as DEGREES
from imuloop.ingest import increments, misread
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import HELD, STAMP
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
def si_samples(rows, log, units, raw_units):
    """Return the columns of the samples of a log, `t` strictly increasing from 0, and the `Counts`.

    Parameters
    ----------
    rows, log : Rows, RawLog
        Rows of the log on one clock, and the log as it was read.
    units, raw_units : dict
        Name of each unit, and `RawUnit` of each sensor, by quantity.
    """
    steps, ends_gap, first = rows.scale, np.zeros(len(rows.x), dtype=bool), None
    if log.slower and (summed := increments.factors(units)):
        raise ImuloopError(
            f"units of {' and '.join(summed)}: increments of two sensors have to be on one clock"
        )
    if rows.even:
        steps = rows.even.step
    elif increments.by_stamps(log, units):
        dt = (rows.x - rows.before) * rows.scale
        steps, ends_gap = increments.intervals(dt, rows.usual)
        first = rows.before < rows.origin
    stamps = rows.stamps[STAMP][0] if rows.stamped else None
    raw = rows.values | increments.rates(rows, steps, units)
    counts = Counts(
        read=len(rows.x),
        missing_values=dict.fromkeys(raw, 0),
        impossible_values=dict.fromkeys(raw, 0),
        time_unit=rows.time_unit,
        clock=rows.clock,
        is_gravity=misread.is_gravity(rows.values),
        in_two_units=misread.in_two_units(stamps, rows.values) if rows.stamped else None,
    )
    values, bad = {}, ~rows.usable
    for name, x in raw.items():
        values[name] = x = _to_si(name, x, log, units, raw_units)
        wrong = ~(np.abs(x) <= BEYOND)
        if not wrong.any():
            continue
        lacks = ~np.isfinite(raw[name])
        counts.missing_values[name] = int(np.count_nonzero(rows.inside & lacks))
        counts.impossible_values[name] = int(np.count_nonzero(rows.inside & wrong & ~lacks))
        if name == TEMPERATURE:
            values[name] = np.where(wrong, np.nan, x)
        else:
            bad |= wrong
    # what becomes of each row, the first that is true
    fates = {
        "identical": rows.same,
        "outside": ~rows.inside,
        "non_finite": bad,
    }
    # a clock that is rebuilt takes the rows as they come
    if not rows.even:
        fates |= {"duplicates": rows.x == rows.before, "out_of_order": rows.x < rows.before}
    if first is not None:
        fates["without_interval"] = first
    keep = np.ones(len(rows.x), dtype=bool)
    for name, mask in fates.items():
        setattr(counts, name, int(np.count_nonzero(keep & mask)))
        keep &= ~mask
    counts.by_usual_step = int(np.count_nonzero(keep & ends_gap))
    counts.increments = increments.figures(log, units, counts, rows)
    if not keep.any():
        return no_samples(log), counts
    zero, t = rows.x[keep.argmax()].item(), rows.times(keep)
    counts.origin, counts.begin_s = rows.origin, float((zero - rows.origin) * rows.scale)
    counts.start_ns = rows.moment(zero)
    samples = {TIME: t} | (values if keep.all() else {n: x[keep] for n, x in values.items()})
    if rows.even:
        number = rows.even.number(rows.number[keep])
        samples |= {TIME: (number - number[0]) * rows.even.step, LOGGED_TIME: t}
    if rows.timeline:
        counts.pps = rows.timeline.figures_beside(rows.x[keep])
    if log.slower:
        own = (rows.stamps[HELD][0][keep] - zero) * rows.scale
        if rows.even:
            # rebuilt with the time stamps of the rows
            _, first, which = np.unique(own, return_index=True, return_inverse=True)
            own = samples[TIME][first][which]
        samples[OWN_TIME[log.slower]] = own
    return samples, counts


def _to_si(name, raw, log, units, raw_units):
    """Return a channel, (n,), in SI, the temperature in degC; the same array if it is in them."""
    if name == TEMPERATURE:
        scale, zero = DEGREES[units["temperature"]]
        return raw if (scale, zero) == (1.0, 0.0) else (raw - zero) * scale
    quantity = next(q for q, axes in SENSORS.items() if name in axes)
    unit = raw_units[quantity]
    same = quantity not in log.found or (unit.scale, unit.offset) == (1.0, 0.0)
    return raw if same else unit.to_si(raw)
