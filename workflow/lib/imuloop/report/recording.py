"""What another recording would gain, in sentences made of the diagnosis' expected σ."""

import numpy as np

from imuloop.core.errors import joined
from imuloop.core.samples import CHANNELS
from imuloop.core.sphere import WIDE_HOLE, largest_hole
from imuloop.core.units import HOUR
from imuloop.diagnose.records.pose_diagnosis import TESTABLE
from imuloop.noise.record_length import record_seconds
from imuloop.plan.session import INITIAL_REST_S, POSES
from imuloop.report.figures.poses import pose_directions
from imuloop.report.numbers import duration, number, percent
from imuloop.report.results import SENSORS, XYZ
from imuloop.report.units import MILLIRADIAN, data_sheet, quantities
from imuloop.report.verdict import ABOVE, block_of

# an error matters where it exceeds the noise of a mean of one second so many times
MATTERS = 2.0
# share of a standard error that has to go before a recording is worth its while
NOTICEABLE = 0.1
# the largest rotation about an axis that is not small, degrees, and the least mean rate of
# rotations that is not slow, deg/s
SMALL_TURN, SLOW = 90.0, 10.0
# where an axis stands apart from the vertical by less, degrees, it is simply up or down
UPRIGHT = 10.0
# white noise, flicker and walk of a usual MEMS sensor are equal in the Allan curve here, s
FLICKER_S, WALK_S = 100.0, 1000.0
# the longest record worth asking for, s, and the share of its upper limit by which one has to fall
LONGEST_RECORD, WORTH = 24 * HOUR, 0.5
# share of records in which a term of the size asked for may stay unseen
MISSED = 0.05


def attitude_words(up):
    """Return an attitude in words, from the upward unit vector: x axis down, tilted 30° towards +y.

    The axis nearest to the vertical, and which other axes rise by the tilt.
    """
    main = int(np.abs(up).argmax())
    text = f"{XYZ[main]} axis {'up' if up[main] > 0 else 'down'}"
    tilt = np.degrees(np.arccos(np.clip(abs(up[main]), 0, 1)))
    if tilt < UPRIGHT:
        return text
    rest = [i for i in range(3) if i != main]
    most = max(abs(up[i]) for i in rest)
    toward = [f"{'+' if up[i] > 0 else '−'}{XYZ[i]}" for i in rest if abs(up[i]) > most / 2]
    return f"{text}, tilted {tilt:.0f}° towards {joined(toward)}"


def parameter_words(sensor, name):
    """Return a parameter in words: ``the gyroscope's z scale factor``."""
    if "." in name:
        return f"the {sensor}'s {name.replace('.', ' ', 1)}"
    axes = "".join(XYZ[int(i)] for i in name[1:])
    if name[0] == "T":
        return f"the {sensor}'s misalignment {axes}"
    return f"the {sensor}'s {axes} {'scale factor' if name[0] == 'K' else 'bias'}"


def sigma_words(unit, *values):
    """Return standard errors, SI, one or two, in the data sheets' unit: ``310 to 140 ppm``."""
    display = MILLIRADIAN if unit == "rad" else data_sheet(unit)
    *first, last = values
    return " to ".join([*(display.size(v, 2) for v in first), display.text(last, 2)])


def _plans(device):
    """Return (sensor, parameters, candidates) of the next recording."""
    content = device.diagnosis.get("next_recording", {}).get("sensors", {})
    return [(sensor, own["parameters"], own["candidates"]) for sensor, own in content.items()]


def _drops(device, name=None, least=MATTERS):
    """Return what recordings lower most: (share lost, words on it, candidate), or no share.

    Of those of a name, or of all; of parameters whose weights are above the least.
    """
    found = [
        (
            1 - after / now["std"],
            f"{parameter_words(sensor, parameter)} from "
            f"{sigma_words(now['unit'], now['std'], after)}",
            entry,
        )
        for sensor, parameters, candidates in _plans(device)
        for entry in candidates
        if name in (None, entry["name"])
        for parameter, after in entry["std"].items()
        if (now := parameters.get(parameter)) and (now["weight"] or 0.0) > least
        if after is not None
    ]
    return max(found, key=lambda drop: drop[0], default=(0.0, "", {}))


def first_session(device):
    """Yield that no multi_position session has enough poses to test, and what one would give."""
    own = [s for s in device.sessions if s.kind == "multi_position"]
    found = sum(s.poses for s in own)
    # a rejected one has its own line, which asks for the same
    if any(s.rejected for s in own) or found >= TESTABLE:
        return
    gains = []
    for sensor, _, candidates in _plans(device):
        after = next((c["std"] for c in candidates if c["name"] == "multi_position"), {})
        for letter, words, unit in (("K", "scale factor", "1"), ("T", "misalignment", "rad")):
            if known := [s for name, s in after.items() if name[0] == letter and s is not None]:
                gains.append(f"the {sensor}'s {words} to {sigma_words(unit, max(known))}")
    expected = f" It would give {joined(gains)} (1 σ, the worst axis)." if gains else ""
    yield (
        1.0,
        f"Record a multi_position session: {duration(INITIAL_REST_S, 2)} at rest, then "
        f"about {POSES} rests of a few seconds in attitudes spread over the sphere, turned by hand "
        "between them."
        f"{expected} Effects that the model lacks show from {TESTABLE} poses on.",
    )


def best_recording(device):
    """Yield the recording that would lower a standard error most, of those that matter."""
    gain, words, entry = _drops(device)
    # some have sentences of their own, which say why
    own = entry.get("name") in ("multi_position", "turns")
    if gain < NOTICEABLE or own or (entry["name"] == "poses" and any(hole(device))):
        return
    asked = duration(entry["duration_s"], 2)
    if entry["name"] == "again":
        asked = f"the same session once more ({asked})"
    elif entry["name"] == "static":
        asked = f"{asked} at rest"
    else:
        heated = ""
        if entry["name"] == "heat_and_cool":
            span = number(entry["span_K"], 2)
            heated = f", while the device is heated by {span}\u202fK and cooled again"
        asked = (
            f"{entry['poses']} more poses in the largest holes of the sphere, the first with "
            f"{attitude_words(entry['up'])}{heated} ({asked})"
        )
    yield gain, f"The next recording that helps most: {asked} would lower σ of {words}."


def hole(device):
    """Yield the region of the sphere that has no pose, and what poses there would do."""
    directions = pose_directions(device).get("multi_position")
    if directions is None:
        return
    up, angle = largest_hole(directions)
    degrees = np.degrees(angle)
    if degrees < WIDE_HOLE:
        return
    text = f"Add poses with {attitude_words(up)}: the nearest is {degrees:.0f}° away."
    # where nothing matters the gain is that of any parameter: a hole hides what no model has, too
    gain, words, entry = max(
        (_drops(device, "poses", least) for least in (MATTERS, 0.0)), key=lambda drop: drop[0] > 0
    )
    if gain < NOTICEABLE:
        yield 0.0, text
        return
    more = f"{entry['poses']} poses there and in the next largest holes"
    yield gain, f"{text} {more} would lower σ of {words}."


def turns_needed(device):
    """Yield how many turns show the gyroscope's scale factor, where it matters."""
    turns = device.diagnosis.get("next_recording", {}).get("turns")
    if not turns or turns["std_after"] is None:
        return
    now, after, level = (turns[k] for k in ("std", "std_after", "level"))
    if now is not None and now <= MATTERS * level:
        return
    # where the fit is bad σ is large for that, and more turns are no answer
    if block_of(device.diagnosis, "gyroscope")["verdict"] in ABOVE and now is not None:
        return
    gain = 1.0 if now is None else 1 - after / now
    if gain < NOTICEABLE:
        return
    axis = turns["axis"]
    figures = [turns[k][XYZ.index(axis)] for k in ("turned_deg", "largest_deg", "mean_deg_s")]
    turned, largest, rate = (number(v, 2) for v in figures)
    known = "unknown" if now is None else f"known to {sigma_words('1', now)}"
    size = "slow" if figures[2] < SLOW else "few" if figures[1] > SMALL_TURN else "small"
    found = (
        f"The rotations about {axis} are too {size} to show the gyroscope's scale factor there "
        f"({known}): {turned}° in all, {largest}° in the largest, {rate}\u202f°/s in the mean."
    )
    if not any(turns["turned_deg"]):
        # however fast the device moved
        found = (
            "No turn that can be used goes from one rest to another, so nothing shows the "
            f"gyroscope's scale factor about {axis} ({known})."
        )
    yield (
        gain,
        f"{found} A session of {turns['poses']} "
        f"poses in the largest holes of the sphere, then {turns['turns']} turns of 360° about "
        f"{axis}, both ways, with {axis} level, would bring σ to {sigma_words('1', after)}; "
        f"{sigma_words('1', level)} are, at 100\u202f°/s, the noise of a mean of 1\u202fs.",
    )


def enough(device):
    """Return that no standard error matters, with the one that comes nearest; empty if one does."""
    weights = [
        (now["weight"], f"{parameter_words(sensor, name)}, {sigma_words(now['unit'], now['std'])}")
        for sensor, parameters, _ in _plans(device)
        for name, now in parameters.items()
        if now["weight"] is not None
    ]
    scales = sum("scale factor" in known for _, known in weights)
    gain, *_ = _drops(device)
    if scales < 2 * len(XYZ) or gain >= NOTICEABLE:
        return ""
    weight, known = max(weights)
    if weight <= MATTERS:
        return (
            "Enough poses and turns: at 1\u202fg and 100\u202f°/s no σ of the calibration makes an "
            f"error above {MATTERS:g} times the noise of a mean of 1\u202fs; the largest, of "
            f"{known}, makes {number(weight, 2)} times that noise."
        )
    return (
        "No recording that was tried lowers a σ that matters by as much as "
        f"{percent(NOTICEABLE)}; the largest is that of {known}."
    )


def initial_rest(device):
    """Yield how long the first rest has to be until flicker limits the gyroscope's mean rate."""
    parameters = next((own for sensor, own, _ in _plans(device) if sensor == "gyroscope"), {})
    if not any((now["weight"] or 0.0) > MATTERS for n, now in parameters.items() if n[0] == "b"):
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
