"""Findings: the numbers that the sentences of ``phrases.j2`` are made of."""

from operator import itemgetter

import numpy as np
from scipy.special import chdtr

from imuloop.core.errors import joined
from imuloop.core.samples import SENSORS
from imuloop.estimate.verdict import TESTED
from imuloop.model.prior_remarks import remarks
from imuloop.report.numbers import missing
from imuloop.report.page import RECORDS, effect_words, phrase, sentence
from imuloop.report.units import data_sheet

# verdicts from the best news to no news
VERDICTS = (*TESTED, "not_testable")
# verdicts on a residual above its floor
ABOVE = ("partly_explained", "unexplained")
# name for both sensors together, whose data in motion share the residual of velocity
BOTH = "sensors"
# a reduced χ² below FAR_BELOW whose p-value is below UNLIKELY means that the noise of the record is
# wrong; upper limits of slow noise lower χ² only to a half. A fit has up to MOST_PARAMETERS
FAR_BELOW, UNLIKELY, MOST_PARAMETERS = 0.05, 1e-3, 9
# an error that falls by this factor is news
WORTH_SAYING = 1.1
# an effect that leaves less than this share of the held-out error is mentioned though rejected
WORTH_A_WORD = 0.75
# stands for a record that was not diagnosed
UNTESTED = {
    "verdict": "not_testable",
    "why": "no recording of this kind",
    **dict.fromkeys(("effects", "candidates", "confounded"), ()),
    "residuals": {},
}
# where rotations that contradict all others are listed
ROTATIONS = ("gyroscope", "poses")
# residuals that a user notices first
QUOTED = {
    "accelerometer": ("gravity_norm",),
    "gyroscope": ("rotation", "pose_rate"),
    BOTH: ("velocity_vertical",),
}


def block_of(diagnosis, sensor, part):
    """Return the diagnosis of a sensor in one kind of data, with its findings, a dict.

    `diagnosis` is the content of diagnosis.json, `sensor` the name of a sensor or `BOTH`, and
    `part` the kind of data, such as ``poses``. The result is the entry of diagnosis.json on this
    kind of data, or `UNTESTED` if there is none, plus these keys:

    - ``sensor``, ``part``: the arguments;
    - ``words``: the effects that were added to the model, in words;
    - ``left``: name of the residual farthest above its floor, which is its size from noise alone;
    - ``quoted``: name of the residual that the effects lowered most; without effects, ``left``;
    - ``lacking``: the largest reduced χ² above 1 and the name of its residual, or None;
    - ``too_quiet``: the result of `too_quiet`;
    - ``undersampled``: the error that too low a sampling rate adds to rotations, a dict, or None;
    - ``tried``: the result of `_tried`, None unless the verdict is ``unexplained``;
    - ``elsewhere``: candidate effects that were added to the model because of other kinds of data.
    """
    if sensor == BOTH:
        block = _of_both(*(block_of(diagnosis, name, part) for name in SENSORS))
    else:
        block = diagnosis.get("sensors", {}).get(sensor, {}).get(part) or UNTESTED
    block = block | {"sensor": sensor, "part": part}
    residuals, names = block["residuals"], {effect["name"] for effect in block["effects"]}
    block["words"] = [effect_words(effect) for effect in block["effects"]]
    above = block["verdict"] in ABOVE
    block["left"] = _largest(block, {n: r["after"] * above for n, r in residuals.items()})
    falls = {name: r["before"] - r["after"] for name, r in residuals.items()}
    block["quoted"] = _largest(block, falls) if block["effects"] else block["left"]
    large = [(r["chi2_after"], name) for name, r in residuals.items() if (r["chi2_after"] or 0) > 1]
    block["lacking"] = max(large, default=None)
    block["too_quiet"] = too_quiet(block)
    block["undersampled"] = residuals.get("rotation", {}).get("undersampled")
    block["tried"] = _tried(block) if block["verdict"] == "unexplained" else None
    block["elsewhere"] = [
        c for c in block["candidates"] if c["status"] == "added" and c["name"] not in names
    ]
    return block


def blocks(diagnosis):
    """Return the diagnosis of each sensor in each kind of data, a list of results of `block_of`.

    Data in motion have one diagnosis for both sensors. `diagnosis` is the content of
    diagnosis.json.
    """
    sensors = diagnosis.get("sensors", {})
    places = [(sensor, part) for sensor in SENSORS for part in ("poses", "static_record")]
    places.append((BOTH, "motion"))
    places += [(s, "reference") for s in SENSORS if "reference" in sensors.get(s, {})]
    return [block_of(diagnosis, *place) for place in places]


def tested(diagnoses):
    """Return the diagnoses that have a verdict other than ``not_testable``, a list.

    `diagnoses` is the result of `blocks`.
    """
    return [block for block in diagnoses if block["verdict"] != "not_testable"]


def _of_both(force, turn):
    """Return the diagnosis of both sensors together in motion, a dict.

    `force` and `turn` are the diagnoses of the accelerometer and of the gyroscope in motion,
    entries of diagnosis.json. The result has the residuals, which are the same in both, and the
    effects and candidates of both sensors in one list each.
    """
    effects, candidates = ([*force[key], *turn[key]] for key in ("effects", "candidates"))
    # a candidate of one sensor is also in the list of the other, with the status not_available
    by_name = {c["name"]: c for c in reversed(candidates)}
    return force | {"effects": effects, "candidates": list(reversed(by_name.values()))}


def residual_names(block):
    """Return the names of the residuals of a diagnosis, a list.

    The list begins with the residuals in `QUOTED`, which a user notices first. `block` is a result
    of `block_of`.
    """
    first = [name for name in QUOTED[block["sensor"]] if name in block["residuals"]]
    return list(dict.fromkeys([*first, *block["residuals"]]))


def _largest(block, sizes):
    """Return the name of the residual with the largest ratio of its entry in `sizes` to its floor.

    The floor of a residual is its size from noise alone. `sizes` has a number for each residual by
    its name, such as its size or its fall, in the unit of the floor. `block` is the diagnosis of a
    sensor in one kind of data; the result is None if it has no residuals.
    """
    floors = {name: r["floor"] or np.inf for name, r in block["residuals"].items()}
    multiples = {name: sizes[name] / floors[name] for name in residual_names(block)}
    return max(multiples, key=multiples.get, default=None)


def too_quiet(block):
    """Return name, reduced χ² and p-value of the first residual far below its noise, or None.

    A residual is far below its noise if its reduced χ² is less than `FAR_BELOW` and the probability
    of so low a value is less than `UNLIKELY`. The report then says that the data were corrected or
    filtered before they were logged. `block` is the diagnosis of a sensor in one kind of data.
    """
    for name, r in block["residuals"].items():
        chi2 = r["chi2_before"]
        if chi2 is not None and chi2 < FAR_BELOW:
            dof = max(r["n"] - MOST_PARAMETERS, 1)
            p = float(chdtr(dof, dof * chi2))
            if p < UNLIKELY:
                return name, chi2, p
    return None


def _tried(block):
    """Return whether candidate effects were rejected, and the best of them, a dict.

    The key ``any`` is true if at least one was rejected. The key ``best`` has the rejected
    candidate, a dict, with the smallest ratio of the held-out error with it to the error without
    it. It is None if no rejected candidate has a ratio of at most `WORTH_A_WORD`. `block` is the
    diagnosis of a sensor in one kind of data.
    """
    rejected = [c for c in block["candidates"] if c["status"] == "rejected"]
    best, share = None, WORTH_A_WORD
    for candidate in rejected:
        before = block["residuals"].get(candidate.get("residual"), {}).get("before")
        after = candidate["heldout_after"]
        if before and not missing(after) and after / before <= share:
            best, share = candidate, after / before
    return {"any": bool(rejected), "best": best}


def rank(verdict):
    """Return the index of a verdict in `VERDICTS`, in which the best news comes first."""
    return VERDICTS.index(verdict)


def answers(diagnoses):
    """Return the verdicts that a user is told, a list of (place, verdict, words).

    The place is a text, the sensor and the kind of data. The words are a sentence on the verdict.
    First is the verdict on the poses of each sensor, or on its static record if only this was
    tested. The verdicts on other data follow. Of these, ``consistent`` and ``not_testable`` are
    left out, because a user does not need them. `diagnoses` is the result of `blocks`.
    """
    said, with_verdict = [], tested(diagnoses)
    for sensor in SENSORS:
        poses, static = (b for b in diagnoses if b["sensor"] == sensor and b["part"] != "reference")
        said.append(static if static in with_verdict and poses not in with_verdict else poses)
    news = [b for b in with_verdict if b["verdict"] != "consistent"]
    said += [b for b in news if b not in said]
    alone = [b for b in said[: len(SENSORS)] if b["part"] == "static_record"]
    return [
        (phrase("place", b=b), b["verdict"], phrase("answer", b=b, alone=b in alone)) for b in said
    ]


def grouped(summaries):
    """Return groups of devices with equal answers, a list of (answers, summaries), the worst first.

    The answers of a group are the verdicts that its devices have in common, as the function
    `answers` returns them; the summaries are the entries of `summaries` for its devices.
    `summaries` are the contents of summary.json of all devices.
    """
    groups = {}
    for s in summaries:
        groups.setdefault(tuple(map(tuple, s["answers"])), []).append(s)

    def order(group):
        """Return the key by which groups are sorted: the worst verdict, then the number of devices.

        `group` is a tuple of answers and summaries.
        """
        said, devices = group
        return [-max((rank(verdict) for _, verdict, _ in said), default=0), len(devices)]

    return sorted(groups.items(), key=order)


def card(diagnoses, loop, calibration=None):
    """Return the texts with which the part of a device in the report begins, a dict.

    The text ``found`` names the hidden effects by sensor, and ``gain`` the errors that fell.
    ``left`` is a list of pairs: a verdict, and a text on the remaining error. ``untested`` names
    data that could not be tested, and adds remarks on the calibration. A text is empty if there is
    nothing to say. `diagnoses` is the result of `blocks` for the device, `loop` the result of
    `loop_errors`, and `calibration` its final Calibration or None.
    """
    places, effects = {}, {}
    for block in diagnoses:
        for effect in block["effects"]:
            place = places.setdefault(effect_words(effect), [])
            # data in motion repeat the effects that other data show: those are named once
            if block["sensor"] != BOTH or not place:
                place += {phrase("sensor", b=block)} - {*place}
    for effect, place in places.items():
        effects.setdefault(joined(place), []).append(effect)
    with_verdict = tested(diagnoses)
    above = [b for b in with_verdict if b["verdict"] in ABOVE]
    remaining = [(b["verdict"], phrase("still", b=b)) for b in above]
    if within := [b for b in with_verdict if b not in above]:
        worst = max((b["verdict"] for b in within), key=rank)
        errors = [] if above else told(loop)
        remaining.append((worst, phrase("nothing_left", above=above, within=within, errors=errors)))
    remaining += [(b["verdict"], phrase("quiet", b=b)) for b in within if b["too_quiet"]]
    words = [phrase("untested", found=diagnoses) if with_verdict else ""]
    turns = [b for b in diagnoses if (b["sensor"], b["part"]) == ROTATIONS]
    words += [phrase("contradicting", b=b) for b in turns]
    for name in SENSORS if calibration else ():
        words += [sentence(f"{name}: {r}") for r in remarks(name, getattr(calibration, name))]
    return {
        "found": phrase("found", effects=effects, tested=with_verdict, above=above),
        "gain": " ".join(phrase("gain", error=error) for error in told(loop)),
        "left": remaining,
        "untested": " ".join(filter(None, words)),
    }


def fall(error):
    """Return the ratio of an error before the correction of effects to the error after it.

    `error` is a dict of the list that `loop_errors` returns. The ratio is above 1 if the error
    fell; it is 1 if the corrected error is zero or absent.
    """
    return error["calibrated"] / error["final"] if error["final"] else 1.0


def told(loop):
    """Return the errors of a device that are worth a sentence, a list.

    They are those that fell by at least the factor `WORTH_SAYING`, or the first error alone if none
    did. `loop` is the result of `loop_errors`: the errors of a device as logged, calibrated and
    corrected. If it is empty, so is the result.
    """
    return [error for error in loop if fall(error) >= WORTH_SAYING] or loop[:1]


def headline(summaries):
    """Return the main finding of all devices, a sentence.

    It is the largest fall of an error by the correction of effects, or the worst verdict if no
    error fell by the factor `WORTH_SAYING`. `summaries` are the contents of summary.json of the
    devices.
    """
    falls = [(fall(e), e, s) for s in summaries for e in s["loop"] if e["effects"]]
    factor, error, summary = max(falls, key=itemgetter(0), default=(0, None, None))
    if factor >= WORTH_SAYING:
        verdicts = [{verdict for _, verdict, _ in s["answers"]} for s in summaries]
        count = sum(bool(v & {"explained", "partly_explained"}) for v in verdicts)
        numbers = {"summary": summary, "error": error, "count": count}
        return phrase("headline_fall", **numbers, devices=len(summaries))
    every = {verdict for s in summaries for _, verdict, _ in s["answers"]}
    return phrase(
        "headline_verdict",
        summaries=summaries,
        every=every,
        worst=max(every - {"not_testable"}, key=rank, default="not_testable"),
        calibrated=all(s["calibrated"] for s in summaries),
    )


def residual_text(residual, key, digits=3):
    """Return one number of a residual as text with its unit.

    `residual` is an entry ``residuals`` of a diagnosis, `key` the name of the number, such as
    ``after`` or ``floor``, and `digits` the number of significant digits.
    """
    return data_sheet(residual["unit"]).text(residual[key], digits)


def record_title(block):
    """Return the heading of a diagnosis: its sensor and its kind of data, as "Gyroscope, poses".

    `block` is a result of `block_of`.
    """
    return f"{block['sensor'].capitalize()}, {RECORDS[block['part']]}"
