"""From the rows of a log to samples: SI units, time from zero, faulty rows dropped and counted."""

from dataclasses import dataclass, field

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


def _of_channels():
    """Return a dict with a count of zero for each channel, ``ax`` to ``gz``."""
    return dict.fromkeys(CHANNELS, 0)


@dataclass
class Counts:
    """Numbers of used and dropped rows of a log, and facts about its clock and its values.

    Each row that is dropped is counted once, under the first fault that applies. `read` counts all
    rows, `outside` those outside of the time range, `non_finite` those with a missing or impossible
    value of a sensor (a missing temperature does not count), and `spiked` those with a spike on a
    single channel; `missing_values`, `impossible_values` and `spike_values` have the numbers by
    channel. `identical` rows repeat the row before in time stamp and all values. `reasons` are
    lines on why a log cannot be used. `is_gravity` is true if the angular rate holds gravity, and
    `in_two_units` describes a sensor whose samples are logged twice, or is None. `increments`,
    `pps` and `logged` are entries of quality.json on increments, 1PPS marks and rebuilt time
    stamps, or None; `rebuilt` is the line on rebuilt time stamps for the user. `start_ns` is the
    time of the first sample, ns since 1970, None if the time stamps are not dates. `begin_s` is the
    time from the first time stamp of the log, `origin`, to the first sample, s.
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
    """Return the columns of samples without rows, a dict of empty arrays by name.

    `log` is the RawLog whose sensors and temperature give the names.
    """
    names = [TIME, *CHANNELS, *[TEMPERATURE] * log.temperature]
    names += [OWN_TIME[log.slower]] if log.slower else []
    return {name: np.empty(0) for name in names}


# a count of 1e306 has no value in SI, and stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def si_samples(rows, raw_units):
    """Return the samples of a log in SI, a dict of columns, (n,), and their `Counts`.

    `rows` are the `Rows` of the log. `raw_units` has the `RawUnit` of each sensor, which converts
    it to SI, by quantity. The column ``t`` is the time, s; it starts at 0 and increases. Rows with
    a fault are left out and counted. Exception: spikes are still in the samples.
    """
    log = rows.log
    if log.slower and increments.factors(rows.units):
        raise ImuloopError("units: increments of two sensors have to be on one clock")
    rates, first, wide, usual = increments.rates(rows)
    counts = Counts(read=len(rows.x), time_unit=rows.time_unit, clock=rows.clock)
    counts.is_gravity = misread.is_gravity(rows.values)
    if rows.stamped:
        counts.in_two_units = misread.in_two_units(rows.stamps[STAMP][0], rows.values)
    units = {name: raw_units[q] for q in SENSORS if q in log.names for name in SENSORS[q]}
    if log.temperature:
        units[TEMPERATURE] = RawUnit("degC", *DEGREES[rows.units["temperature"]])
    inside, bad, values = rows.inside, ~rows.usable, {}
    for name, raw in (rows.values | rates).items():
        # values in SI and whole columns need no copy: a long log has some GB
        unit = units.get(name, RawUnit("SI", 1.0))
        values[name] = x = raw if (unit.scale, unit.offset) == (1.0, 0.0) else unit.to_si(raw)
        lacks, wrong = ~np.isfinite(raw), ~(np.abs(x) <= BEYOND)
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
        "duplicates": (rows.x == rows.before) & (not rows.even),
        "out_of_order": (rows.x < rows.before) & (not rows.even),
        "without_interval": first,
    }
    fate = np.select([*fates.values()], range(len(fates)), len(fates))
    for number, name in enumerate(fates):
        setattr(counts, name, int(np.count_nonzero(fate == number)))
    keep = fate == len(fates)
    counts.by_usual_step = int(np.count_nonzero(keep & wide))
    counts.increments = increments.figures(rows, counts, usual)
    if not keep.any():
        return no_samples(log), counts
    begin, keep = rows.x[keep.argmax()].item(), slice(None) if keep.all() else keep
    counts.origin, counts.start_ns = rows.origin, rows.moment(begin)
    counts.begin_s = float((begin - rows.origin) * rows.scale)
    samples = {TIME: rows.times(keep)} | {name: x[keep] for name, x in values.items()}
    if rows.even:
        number = rows.even.number(rows.number[keep])
        even_t = (number - number[0]) * rows.even.step
        samples |= {TIME: even_t, LOGGED_TIME: samples[TIME]}
    if rows.timeline:
        counts.pps = rows.timeline.figures_beside(rows.x[keep])
    if log.slower:
        samples[OWN_TIME[log.slower]] = (rows.stamps[HELD][0][keep] - begin) * rows.scale
    return samples, counts
