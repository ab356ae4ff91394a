"""The most useful next step for a device, and its gain, by the numbers of its results."""

import re

import numpy as np

from imuloop.core.samples import TEMPERATURE, TIME
from imuloop.core.units import DEGREE, EARTH_RATE, HOUR
from imuloop.diagnose.poses import TESTABLE
from imuloop.model.effect import OUTPUT
from imuloop.plan.advice import INITIAL_REST_S, POSES
from imuloop.plan.directions import WIDE_HOLE, direction_words, largest_hole
from imuloop.report.figures.poses import pose_directions
from imuloop.report.findings import ABOVE, blocks
from imuloop.report.page import phrase
from imuloop.report.units import MILLIRADIAN, data_sheet

# a step is worthwhile above this share of spoiled moves or rests, and of rests that are too short
MANY, MANY_SHORT = 0.1, 0.2
# the least span of temperature that can show an effect, K, and the correlation of temperature with
# time from which on a fit cannot tell one from the other
SPAN_K, MONOTONE = 2.0, 0.9
# an error of readings matters if it exceeds the noise of a mean over one second by this factor
MATTERS = 2.0
# a further rest or turn is worthwhile if it lowers a standard error by this share
NOTICEABLE = 0.01
# a longer record is asked for up to this length, s, if the longest is shorter by a tenth
LONG_RECORD, NEARLY = 2 * HOUR, 0.9
# matches a warning of ingest about a declaration, by a key of the config or an option
DECLARED = re.compile(r"see (units|--\S+-unit)")


def next_step(device):
    """Return the most useful next step for the user of a device, a sentence.

    `device` is a DeviceResults, all results of one device. Steps have three ranks: steps against
    faults of a recording come first, then further recordings, and last a long record at rest, which
    improves only the estimate of the noise. Among steps of one rank, the step with the largest gain
    is chosen. The gain is the share by which the step may lower a standard error or a residual; it
    is 1 if a recording is missing. Without any step, the sentence says that the results are good
    enough, or that the report has the reasons why nothing was tested.

    The functions `_rejected` to `_static_record` yield steps. A step is a tuple: its gain, the name
    of a sentence for `phrase`, and the values in this sentence, a dict.
    """
    mend = (_rejected, _doubted, _first_session, _clipped, _short_rests, _tilted_rests)
    record = (_missing, _limit, _hole, _heat_and_cool)
    ranks = mend, record, (_static_record,)
    # if a log or its declaration is wrong, every other number is doubtful
    misdeclared = any(s.quality["misdeclared"] for s in device.sessions)
    for sources in ((_rejected,),) if misdeclared else ranks:
        if steps := [step for source in sources for step in source(device)]:
            _, code, numbers = max(steps, key=lambda step: step[0])
            return phrase(code, **numbers)
    now = device.diagnosis.get("next_step")
    if now and not misdeclared:
        return phrase("enough", now=now, display=_display(now), matters=MATTERS)
    return phrase("see_why")


def _rejected(device):
    """Yield a step for each rejected session of a DeviceResults, `device`.

    The step is to correct the declaration of the log if that is wrong, else to record it again. A
    step is a tuple, as in `next_step`.
    """
    for s in device.sessions:
        if s.rejected:
            code = "correct" if s.quality["misdeclared"] else "record_again"
            yield 1.0, code, {"session": s.name}


def _doubted(device):
    """Yield a step for each warning of ingest that a declaration, such as a unit, may be wrong.

    The step is to check the declaration. `device` is a DeviceResults. A step is a tuple, as in
    `next_step`.
    """
    for s in device.used:
        for text in filter(DECLARED.search, s.quality["warnings"]):
            yield 1.0, "doubted", {"session": s.name, "text": text}


def _first_session(device):
    """Yield the step to record a multi_position session, if there are too few poses for a test.

    There are too few if all such sessions together have less than `TESTABLE` poses. No step is
    yielded if one of these sessions is rejected, because `_rejected` then yields it. `device` is a
    DeviceResults. A step is a tuple, as in `next_step`.
    """
    sessions = [s for s in device.sessions if s.kind == "multi_position"]
    # a rejected session has its own step, which asks for the same
    if sum(s.poses for s in sessions) < TESTABLE and not any(s.rejected for s in sessions):
        numbers = {"rest": INITIAL_REST_S, "poses": POSES, "testable": TESTABLE}
        yield 1.0, "first_session", numbers


def _clipped(device):
    """Yield the step to avoid saturation, for each session with saturated samples.

    `device` is a DeviceResults. A step is a tuple, as in `next_step`.
    """
    for s in device.used:
        counts = {k: v for k, v in s.quality["clipped"].items() if v}
        seen = s.quality["faults"].get("clipped_at", {})
        counts |= {k: f["rows"] for k, f in seen.items() if k not in counts and f["values"]}
        if counts:
            rests = s.segmentation.get("railed_rests")
            yield 1.0, "clipped", {"session": s.name, "counts": counts, "rests": rests}


def _short_rests(device):
    """Yield the step to rest longer, for each session in which many rests are too short.

    Many are more than the share `MANY_SHORT` of all rests. A session in which shorter rests than
    usual had to be used gets the step, too. `device` is a DeviceResults. A step is a tuple, as in
    `next_step`.
    """
    for s in device.used:
        short, used = s.segmentation.get("short_rests", 0), s.segmentation.get("shorter")
        every = short + (s.segments["pose"] >= 0).sum()
        if used or short > MANY_SHORT * every:
            yield short / every, "short_rests", {"session": s.name, "short": short, "used": used}


def _tilted_rests(device):
    """Yield the step to rest more firmly, for each session with many rests in which a device tilts.

    Many are more than the share `MANY` of all rests. `device` is a DeviceResults. A step is a
    tuple, as in `next_step`.
    """
    for s in device.used:
        tilted, rests = s.segmentation.get("tilted_rests", 0), (s.segments["pose"] >= 0).sum()
        if tilted > MANY * rests:
            numbers = {"session": s.name, "tilted": tilted, "rests": rests}
            numbers["degrees"] = s.segments["tilt_rad"].max() / DEGREE
            numbers["held"] = s.segmentation["hand_held"]
            # such a rest does not show the gyroscope's bias
            yield 1 - np.sqrt(1 - min(tilted / rests, 1.0)), "tilted_rests", numbers


def _missing(device):
    """Yield a step for each residual above its floor, and one if the sampling rate is too low.

    The step for a residual is to find the effect that is missing in the model. The floor is the
    size of the residual that noise alone gives. The sampling rate is too low if the error that
    motion between samples causes in rotations exceeds all other noise. `device` is a DeviceResults.
    A step is a tuple, as in `next_step`.
    """
    diagnoses = blocks(device.diagnosis)
    above = [b for b in diagnoses if b["verdict"] in ABOVE]
    for b in diagnoses:
        if (lost := b["undersampled"]) and (b["sensor"], b["part"]) == ("gyroscope", "poses"):
            yield (
                1 - lost["others"] / np.hypot(lost["error"], lost["others"]),
                "undersampled",
                {"b": b},
            )
    at_poses = {b["sensor"] for b in above if b["part"] == "poses"}
    for b in above:
        if b["part"] == "motion" and at_poses:
            # an error that the poses show goes on into the velocities
            continue
        if b["part"] == "poses" and b["sensor"] == "gyroscope" and "accelerometer" in at_poses:
            yield 0.0, "missing_first", {"b": b}
            continue
        residual, moves = b["residuals"][b["left"]], b.get("moves", {})
        after, floor = residual["after"], residual["floor"]
        gain = max(1 - floor / after, 0.0) if after else 0.0
        rate = b["sensor"] == "gyroscope" and residual["unit"] == "rad/s"
        numbers = {"b": b, "gain": gain, "earth": rate and gain > 0}
        numbers["earth"] &= after**2 - floor**2 < EARTH_RATE**2
        numbers["knocks"] = moves.get("left_out", 0) > MANY * moves.get("all", 0)
        yield gain, "missing", numbers


def _limit(device):
    """Yield the best next rest or turn, for the parameter whose error limits the readings most.

    `device` is a DeviceResults; its diagnosis names this parameter and the rest or turn that
    improves it most. The step is yielded if the error that the parameter causes in a reading
    exceeds the noise of a mean over one second by the factor `MATTERS`, and if the step lowers the
    standard error of the parameter by at least the share `NOTICEABLE`. A step is a tuple, as in
    `next_step`.
    """
    now = device.diagnosis.get("next_step")
    if not now or now["ratio"] <= MATTERS:
        return
    gain = 1 - now["std_after"] / now["std"] if now["std"] else 0.0
    if gain >= NOTICEABLE:
        reading = "1\u202fg" if now["sensor"] == "accelerometer" else "100\u202f°/s"
        error = data_sheet(OUTPUT[now["sensor"]]).text(now["error"], 2)
        numbers = {"now": now, "display": _display(now), "reading": reading, "error": error}
        yield gain, "limit", numbers


def _display(now):
    """Return the Display, the unit in which to show the parameter that limits the readings most.

    `now` is the entry ``next_step`` of diagnosis.json, which names this parameter.
    """
    if now["parameter"][0] == "T":
        return MILLIRADIAN
    return data_sheet("1" if now["parameter"][0] == "K" else OUTPUT[now["sensor"]])


def _hole(device):
    """Yield the step to add poses in the largest region of the sphere of directions without a pose.

    The region must be at least `WIDE_HOLE` degrees wide, as an angle from its centre to the nearest
    pose. `device` is a DeviceResults. A step is a tuple, as in `next_step`.
    """
    directions = pose_directions(device).get("multi_position")
    if directions is not None:
        up, angle = largest_hole(directions)
        if np.degrees(angle) >= WIDE_HOLE:
            yield 0.0, "hole", {"words": direction_words(up), "degrees": np.degrees(angle)}


def _heat_and_cool(device):
    """Yield the step to heat and cool, if temperature only rose or only fell in each session.

    In such sessions an effect of temperature cannot be told from a drift with time. Sessions whose
    temperature spans less than `SPAN_K` do not count. `device` is a DeviceResults. A step is a
    tuple, as in `next_step`.
    """
    swings = []
    for session in device.used:
        if TEMPERATURE not in session.samples:
            continue
        warmth = session.samples[TEMPERATURE]
        rows = np.flatnonzero(np.isfinite(warmth))
        rows = rows[:: max(1, len(rows) // 2000)]
        if len(rows) < 3 or np.ptp(warmth[rows]) < SPAN_K:
            continue
        r = float(np.corrcoef(session.samples[TIME][rows], warmth[rows])[0, 1])
        if abs(r) < MONOTONE:
            return
        low, high = np.quantile(warmth[rows], [0.005, 0.995])
        span = np.ptp(warmth[rows])
        swings.append((span, {"session": session.name, "r": r, "low": low, "high": high}))
    if swings:
        _, numbers = max(swings, key=lambda f: f[0])
        yield 1 - np.sqrt(max(1 - numbers["r"] ** 2, 1e-6)), "heat_and_cool", numbers


def _static_record(device):
    """Yield the step to record longer at rest, if flicker or random walk has only an upper limit.

    Exception: no step is yielded if the longest static session has at least the share `NEARLY` of
    the length `LONG_RECORD`. `device` is a DeviceResults. A step is a tuple, as in `next_step`.
    """
    longest = max((s.quality["duration_s"] for s in device.used if s.kind == "static"), default=0.0)
    axes = {}
    for channel, noise in device.axes.items():
        terms = {term: getattr(noise, term) for term in "BK"}
        limited = [t for t, c in terms.items() if c.value is None and c.upper95]
        if limited:
            axes.setdefault(" and ".join(limited), []).append(channel)
    if axes and longest < NEARLY * LONG_RECORD:
        yield 0.0, "static_record", {"axes": axes, "longest": longest, "hours": LONG_RECORD}
