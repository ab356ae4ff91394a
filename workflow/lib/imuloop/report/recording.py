"""What another recording would gain, in sentences made of the numbers of the results."""

import numpy as np

from imuloop.core.effect import OUTPUT
from imuloop.core.errors import joined
from imuloop.core.samples import CHANNELS
from imuloop.core.sphere import WIDE_HOLE, direction_words, largest_hole
from imuloop.core.units import HOUR
from imuloop.diagnose.records.pose_diagnosis import TESTABLE
from imuloop.noise.record_length import record_seconds
from imuloop.plan.advice import INITIAL_REST_S, POSES
from imuloop.report.figures.poses import pose_directions
from imuloop.report.numbers import duration, number, percent
from imuloop.report.results import SENSORS, XYZ
from imuloop.report.units import MILLIRADIAN, data_sheet, quantities

# an error matters where it exceeds the noise of a mean of one second so many times
MATTERS = 2.0
# share of a standard error that one rest or turn has to take away to be worth its while
NOTICEABLE = 0.01
# white noise, flicker and walk of a usual MEMS sensor are equal in the Allan curve here, s
FLICKER_S, WALK_S = 100.0, 1000.0
# the longest record worth asking for, s, and the share of its upper limit by which one has to fall
LONGEST_RECORD, WORTH = 24 * HOUR, 0.5
# share of records in which a term of the size asked for may stay unseen
MISSED = 0.05


def parameter_words(sensor, name):
    """Return a parameter in words: ``the gyroscope's z scale factor``."""
    axes = "".join(XYZ[int(i)] for i in name[1:])
    if name[0] == "T":
        return f"the {sensor}'s misalignment {axes}"
    return f"the {sensor}'s {axes} {'scale factor' if name[0] == 'K' else 'bias'}"


def sigma_words(unit, *values):
    """Return standard errors, SI, one or two, in the data sheets' unit: ``310 to 140 ppm``."""
    display = MILLIRADIAN if unit == "rad" else data_sheet(unit)
    *first, last = values
    return " to ".join([*(display.size(v, 2) for v in first), display.text(last, 2)])


def first_session(device):
    """Yield that no multi_position session has enough poses to test."""
    own = [s for s in device.sessions if s.kind == "multi_position"]
    found = sum(s.poses for s in own)
    # a rejected one has its own line, which asks for the same
    if any(s.rejected for s in own) or found >= TESTABLE:
        return
    yield (
        1.0,
        f"Record a multi_position session: {duration(INITIAL_REST_S, 2)} at rest, then "
        f"about {POSES} rests of a few seconds in attitudes spread over the sphere, turned by hand "
        f"between them. Effects that the model lacks show from {TESTABLE} poses on.",
    )


def limit(device):
    """Yield the parameter that limits readings, where it matters, and what lowers its σ most."""
    now = device.diagnosis.get("next_step")
    if not now or now["ratio"] <= MATTERS or (gain := _gain(now)) < NOTICEABLE:
        return
    use = "1\u202fg" if now["sensor"] == "accelerometer" else "100\u202f°/s"
    error = data_sheet(OUTPUT[now["sensor"]]).text(now["error"], 2)
    yield (
        gain,
        f"What limits a reading most is {parameter_words(now['sensor'], now['parameter'])}: at "
        f"{use} its σ makes {error}, {number(now['ratio'], 2)} times the noise of a mean of "
        f"1\u202fs. To improve it most, {now['step']}: σ falls from "
        f"{_sigma(now, 'std', 'std_after')}.",
    )


def _gain(now):
    return 1 - now["std_after"] / now["std"] if now["std"] else 0.0


def _sigma(now, *keys):
    """Return standard errors of the parameter of a next step in words."""
    unit = {"T": "rad", "K": "1", "b": OUTPUT[now["sensor"]]}[now["parameter"][0]]
    return sigma_words(unit, *(now[key] for key in keys))


def hole(device):
    """Yield the region of the sphere that has no pose: a hole hides what no model has."""
    directions = pose_directions(device).get("multi_position")
    if directions is None:
        return
    up, angle = largest_hole(directions)
    degrees = np.degrees(angle)
    if degrees >= WIDE_HOLE:
        yield 0.0, f"Add poses with {direction_words(up)} up: the nearest is {degrees:.0f}° away."


def enough(device):
    """Return that no standard error matters, with the one that comes nearest; empty if one does."""
    now = device.diagnosis.get("next_step")
    if not now or (now["ratio"] > MATTERS and _gain(now) >= NOTICEABLE):
        return ""
    known = f"{parameter_words(now['sensor'], now['parameter'])}, {_sigma(now, 'std')}"
    if now["ratio"] <= MATTERS:
        return (
            "Enough poses and turns: at 1\u202fg and 100\u202f°/s no σ of the calibration makes an "
            f"error above {MATTERS:g} times the noise of a mean of 1\u202fs; the largest, of "
            f"{known}, makes {number(now['ratio'], 2)} times that noise."
        )
    return (
        f"No rest and no turn lowers the σ that matters most by as much as {percent(NOTICEABLE)}: "
        f"that of {known}."
    )


def initial_rest(device):
    """Yield how long the first rest has to be until flicker limits the gyroscope's mean rate."""
    now = device.diagnosis.get("next_step") or {"ratio": 0.0}
    if now["ratio"] <= MATTERS or (now["sensor"], now["parameter"][0]) != ("gyroscope", "b"):
        return
    needs = []
    for channel in SENSORS["gyroscope"]:
        white, flat = device.axes[channel].N.value, device.axes[channel].B.value
        if white is not None and flat:
            flat *= np.sqrt(2 * np.log(2) / np.pi)
            needs.append(((white / flat) ** 2, white, flat, channel))
    needed, white, flat, channel = max(needs, default=(0.0, 0.0, 0.0, ""))
    for session in device.used:
        first = session.segments[session.segments["pose"] == 0]
        now = float((first["end_s"] - first["start_s"]).sum())
        if session.kind == "multi_position" and 0 < now < needed <= HOUR:
            before, after = (np.hypot(white / np.sqrt(t), flat) for t in (now, needed))
            yield (
                1 - after / before,
                f"Begin session {session.name} with {duration(needed, 2)} at rest (now "
                f"{duration(now, 2)}): the error of the mean of {channel} falls from "
                f"{sigma_words('rad/s', before, after)}; from there on flicker noise limits it.",
            )


def static_record(device):
    """Yield the length of a record at rest that would show flicker and walk."""
    longest = max((s.quality["duration_s"] for s in device.used if s.kind == "static"), default=0.0)
    rates = [rate for s in device.used if (rate := s.quality["rate_hz"])]
    wanted, limited = [], []
    for channel, axis in device.axes.items() if rates else ():
        if (white := axis.N.value) is None:
            continue
        flicker = white * np.sqrt(np.pi / (2 * np.log(2) * FLICKER_S))
        for name, usual in (("B", flicker), ("K", white * np.sqrt(3) / WALK_S)):
            term = getattr(axis, name)
            if term.value is not None or not term.upper95:
                continue
            limited.append(f"{name} of {channel}")
            target = min(term.upper95, usual)
            if target < (1 - WORTH) * term.upper95:
                squares = {k: getattr(axis, k).square for k in "QNBK"}
                squares |= {p.tc.value: p.q.square * p.tc.value / 2 for p in axis.gauss_markov}
                seconds = record_seconds(name, target, squares, 1 / min(rates), MISSED)
                if seconds and longest < seconds <= LONGEST_RECORD:
                    wanted.append((seconds, name, channel, term.upper95, target))
    if not wanted:
        if limited and not longest:
            yield (
                0.0,
                f"Record 2\u202fh at rest: there is no static session, and {joined(limited)} are "
                "known as upper limits only.",
            )
        return
    seconds = max(w[0] for w in wanted)
    _, name, channel, upper, target = max(wanted, key=lambda w: w[3] / w[4])
    sensor = next(s for s, channels in SENSORS.items() if channel in channels)
    axes = {}
    for key in "BK":
        if shown := [c for _, term, c, *_ in wanted if term == key]:
            words = "all six axes" if len(shown) == len(CHANNELS) else joined(shown)
            axes.setdefault(words, []).append(key)
    shows = [f"{' and '.join(keys)} of {words}" for words, keys in axes.items()]
    unit = quantities(sensor)[name].sheet[0]
    now = f"{duration(longest, 2)} now" if longest else "there is no static session now"
    yield (
        1 - target / upper,
        f"Record {duration(max(seconds, HOUR), 2)} at rest ({now}). Nine times in ten it would "
        f"show {joined(shows)} at the size usual beside this white noise: {name} of {channel}, now "
        f"only limited, would fall from {unit.size(upper, 2)} to {unit.text(target, 2)}.",
    )
