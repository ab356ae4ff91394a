"""The table of checks: the faults of a log, how bad each is, and the remedies.

A check is a row of `CHECKS`. Its function `measure` takes the `Evidence` e on a log. The function
returns a false value if all is well, else the values for the message: a text, a number, a list of
texts, or values by name. The message and the remedy may also name quality figures, as in
``{rate_hz:.4g}``.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from imuloop.core.errors import plural
from imuloop.core.samples import ACCELERATION, CHANNELS, TEMPERATURE
from imuloop.core.units import DEGREE
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest import plausible
from imuloop.ingest.axes import mapping_words
from imuloop.ingest.convert import BEYOND
from imuloop.ingest.places import PAIR
from imuloop.ingest.stamps import PLAUSIBLE_RATE

# how bad a finding is: the log cannot be read, so that nothing else is said of it; the log cannot
# be used; it contradicts its declaration; it may contradict its declaration; a user should look at
# it
SEVERITIES = ("unreadable", "unusable", "misdeclared", "doubtful", "warning")
UNREADABLE, UNUSABLE, MISDECLARED, DOUBTFUL, WARNING = SEVERITIES

# least number of samples and least duration, s, of a log with a rest that is worth a mean
LEAST_ROWS, LEAST_DURATION = 100, 2.0
# least range of a channel, SI, a thousandth of the noise of the best sensors: the squared inverse
# of a smaller one overflows
LEAST_CHANGE = 1e-12
# largest share of its rows that a usable log loses to faults
MOST_DROPPED = 0.05
# rate of the fastest usual log, and least usual rate of time stamps without a unit, Hz
MOST_RATE, LEAST_RATE = 1e4, 1.5
# lowest and highest temperature of an IMU, degC
PLAUSIBLE_TEMPERATURE = (-60.0, 150.0)
# largest mean angular rate of turns by hand, rad/s
MOST_MEAN_RATE = 10.0
# a static session rests for at least this share of its time, and gravity turns in its axes by at
# most this angle, rad: a drift of a bias would have to be 0.15 g to look like a larger turn
LEAST_REST, MOST_TILT = 0.5, 0.15
# a device turns to and fro if its mean rate over half a second changes by more than the first
# number, rad/s, and if the squared change exceeds the power of white noise by the second one
MOST_CHANGE, MOST_CHANGE_SHARE = 0.01, 4.0
# a channel is named if its integer wraps around at least this number of times, and the log is
# misdeclared from the second number on: a log of several joined logs has one or two such jumps
LEAST_WRAPS, MOST_WRAPS = 3, 20


@dataclass(frozen=True)
class Check:
    """A row of the table of checks: a test of a log for one fault.

    `name` is unique, `severity` is one of `SEVERITIES`, and `measure` is the function of the test,
    which takes the Evidence on a log and returns a false value if all is well. `message` and
    `remedy` are formats of the text for the user. `about` are the subjects of the check, words.
    Once a check has found its fault, all later checks with one of its subjects are skipped.
    """

    name: str
    severity: str
    measure: Callable
    message: str
    remedy: str = ""
    about: str = ""


def listed(counts, text="{0} {1}"):
    """Return a text for each name in `counts` whose count is not zero, a list.

    `counts` are numbers by name. `text` is the format of a text, with the name as {0} and the count
    as {1}.
    """
    return [text.format(name, count) for name, count in counts.items() if count]


def _dropped_rows(e):
    """Return the numbers of lost rows by reason, text, if more than `MOST_DROPPED` of all are lost.

    Otherwise the result is False. `e` is the Evidence on a log: all that ingest knows about it.
    """
    missing = {n: c for n, c in e.counts.missing_values.items() if n != TEMPERATURE}
    parts = {
        f"with missing or impossible values ({', '.join(listed(missing))})": e.counts.non_finite,
        "with a repeated stamp, see columns.time": e.counts.duplicates,
        "with a stamp before an earlier one": e.counts.out_of_order,
        "lines that are no row": e.log.bad_lines,
        f"with a spike ({', '.join(listed(e.counts.spike_values))})": e.counts.spiked,
    }
    lost, inside, words = sum(parts.values()), e.inside, ", ".join(listed(parts, "{1} {0}"))
    text = f"{lost} of {inside} rows ({lost / inside:.1%}) cannot be used: {words}"
    return lost > MOST_DROPPED * inside and text


def _lost_text(e):
    """Return the share of the log's bytes in lines that cannot be read, text, if it is too large.

    It is too large above `MOST_DROPPED`; otherwise the result is False. `e` is the Evidence on a
    log: all that ingest knows about it.
    """
    share = e.log.lost_bytes / max(e.log.text_bytes, 1)
    return share > MOST_DROPPED and f"{share:.1%}"


def _rate(e):
    """Return words on the unit of the time stamps if the sampling rate is not plausible.

    The rate is plausible within `PLAUSIBLE_RATE`; then the result is false. `e` is the Evidence on
    a log: all that ingest knows about it.
    """
    rate, (low, high) = e.figures["rate_hz"], PLAUSIBLE_RATE
    return e.figures["rows"] >= LEAST_ROWS and rate and not low <= rate <= high and _units(e)


def _units(e):
    """Return words on units of the time stamps that would make the sampling rate a usual one.

    The text is a dot if no unit does, or if the unit in use is one of them. `e` is the Evidence on
    a log: all that ingest knows about it.
    """
    steps = e.figures["rate_hz"] * TIME_SCALES.get(e.counts.time_unit, 0.0)
    fits = [name for name, scale in TIME_SCALES.items() if 1 <= steps / scale <= MOST_RATE]
    words = f": the stamps look like {' or '.join(fits)}; declare units.time: {(*fits, '')[0]}"
    return words if fits and e.counts.time_unit not in fits else "."


def _milliseconds(e):
    """Return whether the time stamps look like ms: taken as s, they give too low a sampling rate.

    Only stamps without a declared or stated unit are tested. `e` is the Evidence on a log: all that
    ingest knows about it.
    """
    is_stated = "time" in {**e.declared.units, **e.log.units} or e.counts.start_ns
    least = e.declared.rate / 500 if e.declared.rate else LEAST_RATE
    in_seconds = e.counts.time_unit == "s" and not is_stated
    return in_seconds and (e.figures["rate_hz"] or np.inf) < least


def _failed_reads(e):
    """Return the channels with failed reads and the largest share of rows that these have, text.

    A failed read is a row with one value far from the rows before and after. The result is False if
    the share is at most `MOST_DROPPED`. `e` is the Evidence on a log: all that ingest knows about
    it.
    """
    failed = {n: rows for n, rows in e.faults["failed_reads"].items() if rows}
    share = max(failed.values(), default=0) / max(e.figures["rows"], 1)
    return share > MOST_DROPPED and f"{', '.join(failed)}: {share:.0%}"


def _wraps(e, least):
    """Return a text for each channel whose integer wraps around, if one does `least` times or more.

    The texts are a list, without channels that wrap around fewer than `LEAST_WRAPS` times. If no
    channel wraps around `least` times, the result is False. `e` is the Evidence on a log: all that
    ingest knows about it.
    """
    wraps = {name: n for name, n in e.faults["wraps"].items() if n >= LEAST_WRAPS}
    return max(wraps.values(), default=0) >= least and listed(wraps, "{} {} times")


def _motion(e):
    """Return the figures ``rests`` of quality.json if a static session moves, a dict.

    It moves if gravity turns by more than `MOST_TILT`, rad, on the axes of the device, or if the
    device rests too little and turns to and fro. Angles are given in degrees, too. For a session of
    another kind, and without such a motion, the result is a false value. `e` is the Evidence on a
    log: all that ingest knows about it.
    """
    rests = e.faults["rests"]
    if not rests or e.kind != "static":
        return None
    tilts = rests["turned"] > MOST_TILT
    restless = rests["share"] < LEAST_REST or (rests["change_share"] or 0) > MOST_CHANGE_SHARE
    degrees = {f"{name}_deg": rests[name] / DEGREE for name in ("turned", "change")}
    return (tilts or (restless and rests["change"] > MOST_CHANGE)) and rests | degrees


def _temperature(e):
    """Return whether a temperature in the log lies outside of `PLAUSIBLE_TEMPERATURE`, degC.

    `e` is the Evidence on a log: all that ingest knows about it.
    """
    low, high = e.figures["temperature_range"] or PLAUSIBLE_TEMPERATURE
    return not PLAUSIBLE_TEMPERATURE[0] <= low <= high <= PLAUSIBLE_TEMPERATURE[1]


def _saturated(e):
    """Return the number of saturated rows of each channel that has any, a list of texts.

    These are the rows beyond the declared full scale or, without any, the rows at saturated ends.

    `e` is the Evidence on a log: all that ingest knows about it.
    """
    rows = {name: ends["rows"] for name, ends in e.faults["clipped_at"].items()}
    return listed({name: n or rows.get(name, 0) for name, n in e.figures["clipped"].items()})


def _axes(e):
    """Return in words a mapping of the axes that fits the turns better than the axes as logged.

    It tells which axis of the gyroscope fits each axis of the accelerometer. The result is a false
    value if none fits better. `e` is the Evidence on a log: all that ingest knows about it.
    """
    axes = e.faults["axes"]
    # a log in which one axis is given twice fits no mapping of the axes
    return axes and not e.faults["copies"] and axes["mapping"] and mapping_words(axes["mapping"])


_WRAP = "an integer that wraps around from one end of its range to the other: {}"
_WIDEN = "widen it in the logger, or choose a wider full scale"
_LOST = f"at most {MOST_DROPPED:.0%} may be lost"

CHECKS = [
    # the log cannot be read
    Check("reading", UNREADABLE, lambda e: e.counts.reasons, "{}"),
    Check("joined seconds", UNREADABLE, lambda e: e.counts.clock.fault(), "{}"),
    Check("gravity as rate", UNREADABLE, lambda e: e.counts.is_gravity,
          "the columns of the angular rate hold gravity: vectors of constant length along the "
          "acceleration", "name the gyroscope's own columns in columns.angular_rate, or give null"),
    Check("two units", UNREADABLE, lambda e: e.counts.in_two_units,
          "{n} rows repeat the one before, with its time stamp, in another unit: the {sensor} "
          "in {unit} and again in {other}", "log each sample once, or keep the rows of one unit"),
    Check("no rows", UNREADABLE, lambda e: not e.inside and f"{e.counts.read or 'no'} rows"
          f"{', and none of them lies in the time range' * bool(e.counts.read)}", "the log has {}"),
    Check("rate", UNREADABLE, _rate, "no IMU has a rate of {rate_hz:.3g} Hz{}"),
    Check("failed reads", UNREADABLE, _failed_reads, "{} of rows hold the same value, far from "
          "those between: failed reads", "look at the bus, the driver and the read rate"),
    # the log cannot be used
    Check("dropped rows", UNUSABLE, _dropped_rows, "{}", _LOST, "rows"),
    Check("lost text", UNUSABLE, _lost_text, "{} of the log's bytes are in lines that are "
          "no row", _LOST, "rows"),
    Check("few rows", UNUSABLE, lambda e: e.figures["rows"] < LEAST_ROWS,
          f"{{rows}} usable rows, at least {LEAST_ROWS} needed", about="length"),
    Check("short log", UNUSABLE, lambda e: e.figures["duration_s"] < LEAST_DURATION and _units(e),
          f"the log lasts {{duration_s:.3g}} s, at least {LEAST_DURATION:g} s needed{{}}",
          about="length"),
    Check("dead accelerometer", UNUSABLE, lambda e: {*ACCELERATION} <= {*e.figures["constant"]},
          "the acceleration never changes: the sensor was not read"),
    Check("unresolved change", UNUSABLE, lambda e: [n for n in CHANNELS if 0 <
          np.ptp(e.figures["range"][n] or 0.0) < LEAST_CHANGE], "{}: changing by less in the whole "
          "log than any sensor resolves", "see units.acceleration and units.angular_rate"),
    # contradictions to the declaration
    Check("overflow", MISDECLARED, lambda e: _wraps(e, MOST_WRAPS), _WRAP, _WIDEN,
          "overflow force rate"),
    Check("rare overflow", DOUBTFUL, lambda e: _wraps(e, LEAST_WRAPS), _WRAP, _WIDEN, "overflow"),
    Check("increments", MISDECLARED, plausible.increments, "{words} the step of {step:.4g} s, so "
          "the log looks like increments of velocity and angle per sample", "declare {unit}",
          "force rate"),
    Check("unit of force", MISDECLARED, lambda e: plausible.cause(e, "acceleration"), "{}",
          about="force"),
    Check("size of force", DOUBTFUL, plausible.size_of_force, "{}: has gravity been removed, or "
          "does the log hold increments per sample? If not, see units.acceleration and "
          "nominal.acceleration", about="force"),
    Check("scale of force", DOUBTFUL, plausible.changed_force, "the specific force at rest goes "
          "from {low:.4g} to {high:.4g} m/s^2: its scale changed, or logs were joined",
          "crop it with time_range", "force"),
    Check("unit of rate", MISDECLARED, lambda e: plausible.cause(e, "angular_rate"), "{}",
          "or the log's rate is off by as much", "rate"),
    Check("size of rate", DOUBTFUL, lambda e: e.figures["rows"] and
          e.figures["mean_angular_rate"] > MOST_MEAN_RATE,
          "the mean angular rate is {mean_angular_rate:.4g} rad/s, too much for a turn by hand",
          "see units.angular_rate", "rate"),
    Check("scale of rate", DOUBTFUL, plausible.scale_of_rate, "{}: its scale is off by as much",
          "see units.angular_rate and nominal.angular_rate; or the log's rate is off by as much",
          "rate"),
    Check("motion", MISDECLARED, _motion, "the device rests for {share:.0%} of the time, its mean "
          "angular rate changes by {change_deg:.2g} deg/s from half a second to the next, and "
          "gravity turns by up to {turned_deg:.0f}° in its axes", "a static session lies still: "
          "declare another kind, or crop it with time_range", "rest"),
    Check("milliseconds", MISDECLARED, _milliseconds, "the stamps look like milliseconds, as "
          "seconds give {rate_hz:.3g} Hz", "declare units.time: ms, or s if they are"),
    # faults that a user should look at
    Check("one sensor", WARNING, lambda e: e.absent and {"pair": PAIR, "absent": e.absent},
          "the log holds no {absent}: what needs it is not testable",
          "give both files where another holds it, {pair}"),
    Check("dead channel", WARNING, lambda e: [n for n in e.figures["constant"] if n in CHANNELS],
          "never changing: {}"),
    Check("gaps", WARNING, lambda e: e.figures["gaps"]["count"] and
          plural(e.figures["gaps"]["count"], "gap"), "{}, {gaps[total_s]:.4g} s together"),
    Check("declared rate", WARNING, lambda e: e.declared.rate and e.figures["rate_hz"] and
          abs(e.figures["rate_hz"] / e.declared.rate - 1) > 0.02 and f"{e.declared.rate:g}",
          "the stamps give {rate_hz:.4g} Hz, declared are {} Hz; stamps used"),
    Check("lines without stamps", WARNING, lambda e: e.log.bad_lines and "time" not in e.log.names,
          "each lost line shortens a log without stamps by one step"),
    Check("identical rows", WARNING, lambda e: e.counts.identical,
          "{} rows identical to the one before, stamp and values: dropped, nothing is lost"),
    Check("spikes", WARNING, lambda e: listed(e.counts.spike_values),
          "rows dropped for a spike that no body makes: {}", "check the wiring and the logger"),
    Check("impossible values", WARNING, lambda e: listed(e.counts.impossible_values),
          f"missing, as beyond ± {BEYOND:g} in SI, which no sensor gives: {{}}",
          "see units.acceleration and units.angular_rate"),
    Check("missing temperatures", WARNING, lambda e: e.counts.missing_values.get(TEMPERATURE),
          "{} temperatures are missing"),
    Check("zeros", WARNING, lambda e: listed(e.faults["zero_rows"], "{} in {} rows"),
          "exactly zero on all axes: {}", "padding or failed reads: take them out of the log"),
    Check("stuck values", WARNING, lambda e: [f"{n} {stuck['rows']} samples, first at "
          f"{stuck['spans_s'][0][0]:.6g} s" for n, stuck in e.faults["stuck"].items()
          if stuck["rows"]], "stuck at one value: {}", "look at the cable and driver"),
    Check("silence", WARNING, lambda e: e.faults["silent_at_rest"], "no noise at rest: {}",
          "a step too coarse, or firmware that holds the value: no noise or bias can be known"),
    Check("spikes on several channels", WARNING, lambda e: listed(e.faults["spikes"]),
          "spikes of a single sample: {}", "check the wiring and the logger"),
    Check("saturation", WARNING, _saturated, "samples at the end of the range: {}", "rests, turns "
          "and moves with them are left out: choose a wider range or turn more slowly, and declare "
          "full_scale"),
    Check("held values", WARNING, lambda e: [f"{sensor} for {n:.3g} rows" for sensor, n in
          e.faults["rows_a_value"].items() if n > 1], "a value is held: {}",
          "log each new value once"),
    Check("copies", WARNING, lambda e: [f"{b} is a copy of {a}" for a, b in e.faults["copies"]],
          "{}: see columns.acceleration and columns.angular_rate"),
    Check("temperature", WARNING, _temperature, "temperature from {temperature_range[0]:.5g} to "
          "{temperature_range[1]:.5g} degC: counts, failed reads, or in K",
          "see units.temperature"),
    Check("axes", WARNING, _axes, "the angular rate fits the turns of gravity "
          "with {}; gravity does not tell which sensor is at fault", "columns.acceleration and "
          "columns.angular_rate put axes in order, and -NAME turns a sign"),
]  # fmt: skip


# a broken log may have a specific force of zero
@np.errstate(all="ignore")
def findings(evidence):
    """Return the lines on the faults of a log for the user, a dict of lists by severity.

    `evidence` is the Evidence on the log: all that ingest knows about it. An `UNREADABLE` log has a
    single line.
    """
    lines, done = {severity: [] for severity in SEVERITIES}, set()
    for check in CHECKS:
        about = {*check.about.split()}
        if done & about or not (facts := check.measure(evidence)):
            continue
        done |= about
        named = facts if isinstance(facts, dict) else {}
        fact = ", ".join(facts) if isinstance(facts, list) else facts
        text = "; ".join(filter(None, (check.message, check.remedy)))
        lines[check.severity].append(text.format(fact, **evidence.figures | named))
        if check.severity == UNREADABLE:
            break
    return lines
