"""What the diagnosis says about a sensor, in sentences made of its numbers."""

from imuloop.report.numbers import RESIDUAL, missing, number, with_unit

WORDS = {
    "consistent": "consistent",
    "explained": "explained",
    "partly_explained": "partly explained",
    "unexplained": "unexplained",
    "not_testable": "not testable",
}
PARTS = {"poses": "poses", "static_record": "static record"}
RESIDUAL_WORDS = {
    "gravity_norm": "error of gravity's magnitude",
    "pose_rate": "angular rate left at rest",
    "rotation": "error of gravity's direction after a rotation",
    "bias": "wander of the bias",
}
# the residual that a verdict quotes, the one a user feels first
QUOTED = {"accelerometer": ("gravity_norm",), "gyroscope": ("rotation", "pose_rate")}


def block_of(diagnosis, sensor, part="poses"):
    """Return the diagnosis of a sensor's poses or static record; empty where there is none."""
    return diagnosis.get("sensors", {}).get(sensor, {}).get(part) or {}


def quoted(sensor, block):
    """Return name and content of the residual that a verdict quotes; (None, {}) without one."""
    residuals = block.get("residuals") or {}
    names = [*(n for n in QUOTED[sensor] if n in residuals), *residuals]
    return (names[0], residuals[names[0]]) if names else (None, {})


def shown(residual, key):
    """Return a figure of a residual in the unit that people think in, as text with its unit."""
    display = RESIDUAL[residual["unit"]]
    value = residual.get(key)
    return "unknown" if missing(value) else with_unit(number(value * display.factor), display.unit)


def change(residual, changed):
    """Return how the held-out residual moved, and its floor."""
    if not residual:
        return "no held-out number"
    floor = f"floor from noise alone {shown(residual, 'floor')}"
    if not changed:
        return f"held-out root mean square {shown(residual, 'after')}, {floor}"
    before, after = residual.get("before"), residual.get("after")
    verb = "falls" if not missing(before) and not missing(after) and after < before else "goes"
    return (
        f"held-out root mean square {verb} from {shown(residual, 'before')} to "
        f"{shown(residual, 'after')}, {floor}"
    )


def verdict_of(block):
    """Return the verdict's word as the contract has it."""
    return block.get("verdict") or "not_testable"


def reason_of(block):
    """Return why a sensor could not be tested."""
    return block.get("why") or "no recording of this kind"


def sentence(sensor, block):
    """Return the verdict on a sensor in a sentence.

    Parameters
    ----------
    sensor : {'accelerometer', 'gyroscope'}
        Which sensor.
    block : dict
        Its diagnosis: `poses` or `static_record`.
    """
    verdict = verdict_of(block)
    if verdict == "not_testable":
        return f"not testable: {reason_of(block)}."
    name, residual = quoted(sensor, block)
    effects = " and ".join(e["name"] for e in block.get("effects") or [])
    if not residual:
        return f"{WORDS.get(verdict, verdict)}; no residual was given."
    status = {c["status"] for c in block.get("candidates") or []}
    tried = (
        "no effect that was tried helps"
        if "rejected" in status
        else "and no effect of the library can be told from these data"
    )
    moved = f"{RESIDUAL_WORDS.get(name, name)}, {change(residual, bool(effects))}"
    return {
        "consistent": f"consistent with its model and noise: {moved}.",
        "explained": f"explained by {effects}: {moved}.",
        "partly_explained": f"partly explained by {effects}, something is still missing: {moved}.",
        "unexplained": f"unexplained, {tried}: {moved}.",
    }.get(verdict, f"{verdict}: {moved}.")
