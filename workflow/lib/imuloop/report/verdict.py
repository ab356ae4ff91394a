"""What the diagnosis says about a sensor, in sentences made of its numbers."""

import numpy as np
from scipy.special import chdtr

from imuloop.core.errors import joined, plural
from imuloop.core.samples import SENSORS
from imuloop.estimate.verdict import TESTED
from imuloop.report.numbers import missing, number, p_text
from imuloop.report.units import RESIDUAL

# verdicts from the best news to none
VERDICTS = (*TESTED, "not_testable")
WORDS = {verdict: verdict.replace("_", " ") for verdict in VERDICTS}
PARTS = {
    "poses": "poses",
    "static_record": "static record",
    "motion": "motion",
    "reference": "beside a reference",
}
# whose velocity it is
BOTH = "sensors"
RESIDUAL_WORDS = {
    "gravity_norm": "error of gravity's magnitude",
    "pose_rate": "angular rate left at rest",
    "rotation": "error of gravity's direction after a rotation",
    "bias": "wander of the bias",
    "velocity_vertical": "vertical velocity at the end of a move",
    "velocity_horizontal": "horizontal velocity at the end of a move",
    "reference_rotation": "error of the rotation over 1 s",
    "reference_force": "error of specific force over 0.4 s",
}
# effects whose words are not their names with spaces
EFFECT_WORDS = {
    "bias_temperature": "bias over temperature",
    "bias_temperature_rate": "bias over the rate of temperature",
    "g_sensitivity": "g-sensitivity",
    "g2_sensitivity": "g²-sensitivity",
    "gyro_axis_delay": "delays between the gyroscope's axes",
    "earth_rate": "Earth rate",
    "quadratic": "quadratic nonlinearity",
    "cubic": "cubic nonlinearity",
    "scale_asymmetry": "scale factor asymmetry",
    "scale_nonlinearity": "scale factor nonlinearity",
    "scale_temperature": "scale factor over temperature",
    "steps": "bias steps",
    "turn_on_bias": "turn-on bias",
    "warm_up": "warm-up",
}
# of a residual at a floor that is more than the noise as estimated
SLOW_NOISE = (
    " It takes more flicker or random walk than these rests show, within their intervals: a static "
    "record of two hours or more would tell."
)
SLOW_AT_REST = (
    " Held out it is more than a quarter above its floor: it takes more flicker or random walk "
    "than was estimated, within their intervals."
)
# share of the floor that its range is worth naming from
WIDE = 0.1
# a reduced χ² below this, less likely than that with the noise as it is, is no luck: a floor that
# upper limits of slow noise raise comes to half. Parameters that a fit may take from n residuals
FAR_BELOW, UNLIKELY, MOST_PARAMETERS = 0.05, 1e-3, 9
# verdicts on a residual above its floor
ABOVE = ("partly_explained", "unexplained")
# held-out error that a candidate leaves, as a share of that without it, that is worth a word
WORTH_A_WORD = 0.75
# where a stage before could not be read
UNTESTED = {
    "verdict": "not_testable",
    "why": "no recording of this kind",
    **dict.fromkeys(("effects", "candidates", "confounded"), ()),
    "residuals": {},
}
# residuals that a user feels first
QUOTED = {
    "accelerometer": ("gravity_norm",),
    "gyroscope": ("rotation", "pose_rate"),
    BOTH: ("velocity_vertical",),
}


def block_of(diagnosis, sensor, part="poses"):
    """Return the diagnosis of a sensor in one kind of record."""
    return diagnosis.get("sensors", {}).get(sensor, {}).get(part) or UNTESTED


def motion_of(diagnosis):
    """Return the diagnosis of both sensors in motion, which have the residuals in common."""
    force, turn = (block_of(diagnosis, sensor, "motion") for sensor in SENSORS)
    both = {key: [*force[key], *turn[key]] for key in ("effects", "candidates")}
    # what is given to one sensor is none of the other's
    named = {c["name"]: c for c in reversed(both["candidates"])}
    return force | both | {"candidates": list(reversed(named.values()))}


def effect_words(name, constants=None):
    """Return the words for an effect, given its name in results, and its constants."""
    if constants and "formula" in constants:
        return f"{constants['formula']} on {constants['axis']}"
    return EFFECT_WORDS.get(name, name.replace("_", " "))


def blocks(diagnosis):
    """Return every part of a diagnosis: (sensor, part, content)."""
    own = [(s, p, block_of(diagnosis, s, p)) for s in SENSORS for p in ("poses", "static_record")]
    known = diagnosis.get("sensors", {})
    beside = [(s, "reference") for s in SENSORS if "reference" in known.get(s, {})]
    found = [*own, (BOTH, "motion", motion_of(diagnosis))]
    return found + [(s, part, block_of(diagnosis, s, part)) for s, part in beside]


def residual_names(sensor, block):
    """Return the names of the residuals of a record; those that a user feels first come first."""
    residuals = block["residuals"]
    return list(dict.fromkeys((*(n for n in QUOTED[sensor] if n in residuals), *residuals)))


def quoted(sensor, block):
    """Return name and content of the residual that is shown with a verdict; (None, {}) without one.

    If effects were added, the residual that fell most, in multiples of its floor; else, above the
    floor, the one farthest above it; else the one that a user feels first.
    """
    if block["effects"]:
        return _largest(sensor, block, lambda r: r["before"] - r["after"])
    return left_over(sensor, block)


def left_over(sensor, block):
    """Return name and content of the residual farthest above its floor; (None, {}) without one.

    If the verdict is that none is above, the one that a user feels first.
    """
    return _largest(sensor, block, lambda r: r["after"] if block["verdict"] in ABOVE else 0.0)


def _largest(sensor, block, size):
    """Return name and content of the residual whose size is largest in multiples of its floor."""

    def multiple(name):
        residual = block["residuals"][name]
        return size(residual) / (residual["floor"] or np.inf)

    name = max(residual_names(sensor, block), key=multiple, default=None)
    return name, block["residuals"].get(name, {})


def shown(residual, key, digits=3):
    """Return a figure of a residual in the unit that people think in, as text with its unit."""
    return RESIDUAL[residual["unit"]].text(residual[key], digits)


def change(residual, changed):
    """Return how the held-out residual moved, and its floor."""
    floor = f"floor from noise alone {shown(residual, 'floor')}"
    low, high = residual.get("floor_range") or (0.0, 0.0)
    # where what is known of the noise leaves it wide
    if high - low > WIDE * residual["floor"]:
        display = RESIDUAL[residual["unit"]]
        ends = f"{display.size(low, 2)} to {display.text(high, 2)}"
        floor += f" ({ends} by the intervals of the noise)"
    before, after = (shown(residual, when) for when in ("before", "after"))
    if not changed:
        moved = after
    elif before == after:
        moved = f"stays at {after}"
    else:
        verb = "falls" if residual["after"] < residual["before"] else "goes"
        moved = f"{verb} from {before} to {after}"
    return f"held-out root mean square {moved}, {floor}"


def lacking(block):
    """Return the largest reduced χ² of a fit's residuals above one, and its words, or None."""
    found = [
        (r["chi2_after"] or 0.0, RESIDUAL_WORDS[name]) for name, r in block["residuals"].items()
    ]
    return max((f for f in found if f[0] > 1), default=None)


def misfit(block):
    """Return by how much the residual exceeds the noise where it does most, as a sentence's end."""
    if (most := lacking(block)) is None:
        return " The fit to all data leaves no more than noise; without a part of them it fails."
    chi2, words = most
    return f" Reduced χ² of the {words} is {number(chi2)}; noise alone gives 1."


def undersampled(block):
    """Return what the rate of the log adds to the rotations, or None, and at which to record."""
    if not (found := block["residuals"].get("rotation", {}).get("undersampled")):
        return None, ""
    return found, (
        f"Sampled too slowly for such turns: what {number(found['rate_hz'])} Hz does not show "
        f"adds {RESIDUAL['rad'].text(found['error'])} to the {RESIDUAL_WORDS['rotation']}; record "
        f"at {10 * np.ceil(found['enough_hz'] / 10):g} Hz or more, or turn more slowly."
    )


def contradicting(block):
    """Return which turns contradict all others, a sentence after others; empty where none does."""
    turns = [
        f"{t['session']} from {t['start_s']:.6g} to {t['end_s']:.6g} s, by "
        f"{np.degrees(t['angle']):.2g}°"
        for t in block.get("contradicting", ())
    ]
    if not turns:
        return ""
    verb = "contradicts" if len(turns) == 1 else "contradict"
    return (
        f" Left out, as {plural(len(turns), 'turn')} {verb} all others: {joined(turns)}; were "
        "samples cut out or repeated there?"
    )


def too_quiet(block):
    """Return name, reduced χ² and its p-value of a residual far below its noise, or None."""
    for name, r in block["residuals"].items():
        chi2 = r["chi2_before"]
        if chi2 is not None and chi2 < FAR_BELOW:
            dof = max(r["n"] - MOST_PARAMETERS, 1)
            p = float(chdtr(dof, dof * chi2))
            if p < UNLIKELY:
                return name, chi2, p
    return None


def _tried(sensor, block):
    """Return what the effects that were rejected do to the held-out error, in words."""
    residuals, found = block["residuals"], []
    rejected = [c for c in block["candidates"] if c["status"] == "rejected"]
    if not rejected:
        return "and no effect of the library can be told from these data"
    for c in rejected:
        before = residuals.get(c.get("residual"), {}).get("before")
        if before and not missing(c["heldout_after"]):
            found.append((c["heldout_after"] / before, c))
    share, best = min(found, key=lambda f: f[0], default=(1.0, None))
    if share > WORTH_A_WORD:
        return "no effect that was tried helps"
    kind = best["residual"]
    left = shown(residuals[kind] | {"after": best["heldout_after"]}, "after")
    alone = effect_words(best["name"], best.get("constants"))
    text = f"no effect that was tried is certain, though {alone} alone would leave {left}"
    if kind != quoted(sensor, block)[0]:
        text += f" of {shown(residuals[kind], 'before')} of the {RESIDUAL_WORDS[kind]}"
    return text


def sentence(sensor, block):
    """Return the verdict on a sensor's poses or static record in a sentence."""
    verdict = block["verdict"]
    if verdict == "not_testable":
        end = "" if block["why"].endswith("?") else "."
        return f"not testable: {block['why']}{end}{contradicting(block)}"
    name, residual = quoted(sensor, block)
    effects = joined([effect_words(e["name"], e.get("constants")) for e in block["effects"]])
    words = {
        "consistent": "consistent with its model and noise",
        "explained": f"explained by {effects}",
        "partly_explained": f"partly explained by {effects}, "
        + ("something is still missing" if lacking(block) else "not in every part of the data")
        + (", in the sensor or the reference" if "set_up" in block else ""),
        "unexplained": f"unexplained, {_tried(sensor, block)}",
    }[verdict]
    text = f"{words}: {RESIDUAL_WORDS[name]}, {change(residual, bool(effects))}"
    # effects that came from the other kind of data
    own = {e["name"] for e in block["effects"]}
    added = [c for c in block["candidates"] if c["status"] == "added" and c["name"] not in own]
    if added:
        listed, verb = (
            joined([effect_words(c["name"]) for c in added]),
            "is" if len(added) == 1 else "are",
        )
        text += f"; {listed}, {added[0]['why']}, {verb} part of the model"
    text += "."
    if verdict in ABOVE:
        text += misfit(block)
    elif block.get("slow_noise"):
        text += SLOW_AT_REST if "bias" in block["residuals"] else SLOW_NOISE
    text += f" {undersampled(block)[1]}".rstrip()
    text += contradicting(block)
    if len(block.get("set_up", ())) == 1:
        text += " Held out were parts of one session, not sessions."
    if spoiled := block.get("moves", {}).get("left_out"):
        of = plural(block["moves"]["all"], "move")
        why = "a knock between two samples, lost samples, a tilt at the rest beside it or clipping"
        text += f" Left out, for {why}: {spoiled} of {of}."
    if found := too_quiet(block):
        name, chi2, p = found
        text += (
            f" Reduced χ² of the {RESIDUAL_WORDS[name]} is {number(chi2)}, far below 1, "
            f"which its own noise at rest would not leave ({p_text(p)}): the data were corrected "
            "or filtered before they were logged, and say little of the sensor."
        )
    return text


def rank(verdict):
    """Return the place of a verdict from the best news to none."""
    return VERDICTS.index(verdict)


def answers(diagnosis):
    """Return what to say of a device first: each sensor, its worst verdict, words on it.

    Poses come first: they test the calibration. A static record is named where it says more, or
    where there are no poses; then motion, which is of both, where it says more.
    """
    said, motion = [], motion_of(diagnosis)
    for sensor in SENSORS:
        poses, still = (block_of(diagnosis, sensor, part) for part in ("poses", "static_record"))
        tested = [b["verdict"] for b in (poses, still) if b["verdict"] != "not_testable"]
        if not tested:
            words = f"not testable: {poses['why']}"
        elif poses["verdict"] == "not_testable":
            words = f"at rest {_words(still)}; not tested at poses"
        else:
            words = _words(poses)
            if still["verdict"] not in ("consistent", "not_testable"):
                words += f"; at rest {_words(still)}"
        said.append((sensor, max(tested, key=rank, default="not_testable"), words))
    for sensor in SENSORS:
        block = block_of(diagnosis, sensor, "reference")
        if block["verdict"] not in ("consistent", "not_testable"):
            said.append((f"{sensor} beside a reference", block["verdict"], _words(block)))
    if motion["verdict"] not in ("consistent", "not_testable"):
        said.append(("both in motion", motion["verdict"], _words(motion)))
    return said


def _words(block):
    """Return what a tested block says."""
    if too_quiet(block):
        return "far quieter than its own noise allows: corrected or filtered before it was logged"
    words = [effect_words(e["name"], e.get("constants")) for e in block["effects"]]
    corrected = f" with {joined(words)} corrected"
    few = undersampled(block)[0]
    # slow noise that the rests do not show is a guess
    verb = "may allow" if block.get("slow_noise") else "allow" if few else "allows"
    limits = "its noise and the log's rate" if few else "its noise"
    return {
        "consistent": f"as good as {limits} {verb}",
        "explained": f"as good as {limits} {verb}{corrected}",
        "partly_explained": f"better{corrected}, but something is still missing",
        "unexplained": "something is missing that no known effect explains",
    }[block["verdict"]]


def grouped(summaries):
    """Return what is said of the devices, the worst news first, each with those it is said of."""
    groups = {}
    for s in summaries:
        groups.setdefault(tuple(map(tuple, s["answers"])), []).append(s)

    def worst(group):
        said, found = group
        return [-max((rank(verdict) for _, verdict, _ in said), default=0), len(found)]

    return sorted(groups.items(), key=worst)
