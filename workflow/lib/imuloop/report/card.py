"""A device in three parts: what was found, what correcting it gains, what is left."""

from imuloop.core.errors import joined, plural
from imuloop.core.samples import SENSORS
from imuloop.model.prior_remarks import remarks
from imuloop.report.numbers import number
from imuloop.report.units import RESIDUAL
from imuloop.report.verdict import (
    ABOVE,
    BOTH,
    PARTS,
    RESIDUAL_WORDS,
    block_of,
    blocks,
    contradicting,
    effect_words,
    lacking,
    left_over,
    rank,
    shown,
    too_quiet,
    undersampled,
)

# factor from which on an error is said to have fallen
WORTH_SAYING = 1.1


def card(diagnosis, loop, calibration=None):
    """Return what is said of a device first, in the same order for every device.

    ``found``, which undeclared effects, by sensor; ``gain``, the errors that fell, with both ends;
    ``left``, pairs of a verdict and what it is about, with the floor of the noise; ``untested``,
    with the turns that were left out and the remarks on the prior. `loop` are the errors of
    `loop_errors`; takes the final Calibration, None without one.
    """
    left_out = contradicting(block_of(diagnosis, "gyroscope"))
    of_prior = "".join(
        f" {name.capitalize()}: {remark[:1].lower()}{remark[1:]}"
        for name in SENSORS
        for remark in (remarks(name, getattr(calibration, name)) if calibration else ())
    )
    return {
        "found": _found(diagnosis),
        "gain": " ".join(_path(error) for error in told(loop)),
        "left": _left(diagnosis, loop),
        "untested": f"{_untested(diagnosis)}{left_out}{of_prior}".strip(),
    }


def fall(error):
    """Return how many times an error is smaller with the effects found."""
    return error["calibrated"] / error["final"] if error["final"] else 1.0


def told(loop):
    """Return the errors that the effects lowered by `WORTH_SAYING`, or else the first one."""
    return [error for error in loop if fall(error) >= WORTH_SAYING] or loop[:1]


def headline(summaries):
    """Return what was found in all devices in a line, given summary.json: the fall that is largest.

    An effect that lowers no error by `WORTH_SAYING` is no news.
    """
    found = [(fall(error), error, s) for s in summaries for error in s["loop"]]
    found = [each for each in found if each[1]["effects"] and each[0] >= WORTH_SAYING]
    if found:
        _, error, summary = max(found, key=lambda each: each[0])
        display = RESIDUAL[error["unit"]]
        before, after = (display.text(error[stage], 2) for stage in ("calibrated", "final"))
        if len(summaries) == 1:
            what, effects = error["what"].capitalize(), joined(error["effects"])
            return f"{summary['label']}: undeclared {effects}. {what} {before} → {after}"
        count = sum(
            any(verdict in ("explained", "partly_explained") for _, verdict, _ in s["answers"])
            for s in summaries
        )
        largest = f"{summary['label']}, {error['what']} {before} → {after}"
        return f"Undeclared effects in {count} of {len(summaries)} devices; largest: {largest}"
    every = {verdict for s in summaries for _, verdict, _ in s["answers"]}
    verdicts = every - {"not_testable"}
    named = summaries[0]["label"] if len(summaries) == 1 else plural(len(summaries), "device")
    if not verdicts:
        calibrated = "calibrated; " if all(s.get("calibrated") for s in summaries) else ""
        return f"{named}: {calibrated}nothing could be tested"
    worst = max(verdicts, key=rank)
    words = {"consistent": "nothing is missing", "explained": "what was missing is small"}
    tested = ", where it could be tested" if every > verdicts else ""
    return f"{named}: {words.get(worst, 'something is still missing')}{tested}"


def sentence_of(text):
    """Return a text with a capital, and a full stop where it has no mark at its end."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('?') else '.'}"


def _tested(diagnosis):
    return [each for each in blocks(diagnosis) if each[2]["verdict"] != "not_testable"]


def _place(sensor, part):
    return f"{sensor} beside a reference" if part == "reference" else sensor


def _found(diagnosis):
    """Return the effects that were found, each with its sensors, or that there are none."""
    tested = _tested(diagnosis)
    if not tested:
        return "Not testable."
    places, effects = {}, {}
    for sensor in SENSORS:
        for part in PARTS:
            for effect in block_of(diagnosis, sensor, part)["effects"]:
                found = places.setdefault(effect_words(effect["name"], effect.get("constants")), [])
                found += {_place(sensor, part)} - {*found}
    for effect, found in places.items():
        effects.setdefault(joined(found), []).append(effect)
    if effects:
        listed = (f"in the {where}: {joined(names)}" for where, names in effects.items())
        return f"Undeclared {'; '.join(listed)}."
    if any(block["verdict"] in ABOVE for *_, block in tested):
        return "No known effect found, yet something is missing."
    return "No undeclared effect found."


def _path(error):
    """Return how an error falls from step to step, each with its two ends and its factor."""
    sizes = [error[stage] for stage in ("logged", "calibrated", "final")]
    logged, calibrated, final = sizes
    first, middle, last = (RESIDUAL[error["unit"]].text(size, 2) for size in sizes)
    steps = []
    if logged is not None:
        steps.append(f"calibrating takes {first} to {middle}{_less(logged, calibrated)}")
    if final is not None:
        start = "that" if steps else middle
        words = "correcting the effects" if len(error["effects"]) > 1 else "correcting the effect"
        steps.append(f"{words} takes {start} to {last}{_less(calibrated, final)}")
    what = f"{error['what'][:1].upper()}{error['what'][1:]}"
    return f"{what}: {'; '.join(steps) or middle}."


def _less(before, after):
    ratio = before / after if after else 1.0
    return f", {number(ratio, 2)} times less" if ratio >= WORTH_SAYING else ""


def _left(diagnosis, loop):
    """Return pairs of a verdict and what it says is left, what is unexplained first."""
    tested = _tested(diagnosis)
    above = [each for each in tested if each[2]["verdict"] in ABOVE]
    within = [each for each in tested if each not in above]
    said = [(block["verdict"], _still(sensor, part, block)) for sensor, part, block in above]
    if within:
        worst = max((block["verdict"] for *_, block in within), key=rank)
        noise = "Nothing else beyond the noise." if above else _noise(within, told(loop))
        said.append((worst, noise))
    for sensor, _, block in within:
        if too_quiet(block):
            text = f"{sensor}: far quieter than its own noise allows, corrected or filtered before"
            said.append((block["verdict"], sentence_of(f"{text} it was logged")))
    return said


def _still(sensor, part, block):
    """Return by how much the residual of a record is above its noise, in words."""
    where = "in motion" if sensor == BOTH else f"in the {sensor}"
    if part == "reference":
        where += " or the reference"
    name, residual = left_over(sensor, block)
    what, after, floor = RESIDUAL_WORDS[name], *(shown(residual, k, 2) for k in ("after", "floor"))
    most = lacking(block)
    if residual["after"] > residual["floor"] and after != floor:
        what += f", {after} where the noise alone gives {floor}"
    elif most:
        what = f"{most[1]}, of which the fit leaves more than noise, reduced χ² {number(most[0])}"
    else:
        what += ", in a part of the data"
    return f"Still unexplained {where}: {what}."


def _noise(within, errors):
    """Return that nothing is left but the noise, and what that alone gives of each error."""
    slow = any(block.get("slow_noise") for *_, block in within)
    few = any(undersampled(block)[0] for *_, block in within)
    text = f"Left: nothing beyond the noise{' and the rate of the log' if few else ''}"
    floors = joined([RESIDUAL[error["unit"]].text(error["floor"], 2) for error in errors])
    # slow noise that the rests do not show is a guess
    gives = f", which alone {'may give' if slow else 'give' if few else 'gives'} {floors}"
    return f"{text}{gives * bool(floors)}."


def _untested(diagnosis):
    """Return which sensors were not tested, or not at poses; nothing where none was."""
    if not _tested(diagnosis):
        return ""
    found = {}
    for sensor in SENSORS:
        lost = {p for p in PARTS if block_of(diagnosis, sensor, p)["verdict"] == "not_testable"}
        if lost == {*PARTS}:
            found.setdefault("", []).append(sensor)
        elif "poses" in lost:
            at_rest = ", nor its bias at rest" if "static_record" in lost else ""
            text = f": scale and misalignment, which poses show{at_rest}"
            found.setdefault(text, []).append(sensor)
    said = (
        sentence_of(f"not tested{why}" if len(s) > 1 else f"not tested: {s[0]}{why}")
        for why, s in found.items()
    )
    return " ".join(said)
