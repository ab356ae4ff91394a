"""The devices of a board: how they lie to each other, and whose an error is."""

from scipy.spatial.transform import Rotation

from imuloop.report.numbers import with_sigma
from imuloop.report.tables.table import Table
from imuloop.report.units import DEGREES, MILLI_G

# what all devices may show alike: the quantity, its unit, and what it can come from
COMMON = {
    "closure": (
        "the direction of gravity after a move",
        DEGREES,
        "motion too fast for the sampling rate, or a support that gives way",
    ),
    "gravity_norm": ("the magnitude of gravity", MILLI_G, "vibration, or the wrong local gravity"),
}


def board_part(content, labels):
    """Return name, texts and table of board.json; `labels` are the devices' names in the report."""
    placed = [(labels[n], d) for n, d in content["devices"].items() if "arm" in d]
    texts = [f"Not testable: {content['why']}"] * bool(content["why"])
    texts += [f"{labels[n]}: {d['why']}" for n, d in content["devices"].items() if "why" in d]
    texts += [f"Session {n}: {s['why']}" for n, s in content["sessions"].items() if s["why"]]
    texts += [_common(COMMON[kind], test) for kind, test in content["common"].items()]
    columns = ["Device", "Place x, y, z, mm", "Turn about x, y, z, °"]
    columns += ["Own error of turns / noise, °", "Own error of gravity / noise, mg"]
    rows = []
    for label, device in placed:
        turn = Rotation.from_matrix(device["rotation"]).as_rotvec()
        rows.append(
            (
                label,
                _vector(device["arm"], device["arm_std"], 1e3),
                _vector(turn, device["rotation_std"], DEGREES.factor),
                _sizes(device["turn"], DEGREES),
                _sizes(device["gravity_norm"], MILLI_G),
            )
        )
    reference = labels.get(content["reference"], "")
    note = f"On the axes of {reference}, from the place of its accelerometer, value ± 1 σ."
    table = Table("Devices beside each other", tuple(columns), rows, note)
    return {"name": content["board"], "texts": texts, "table": table}


def _vector(values, std, factor):
    return "\n".join(with_sigma(*pair, factor) for pair in zip(values, std, strict=True))


def _sizes(test, display):
    """Return error and floor, where it was tested, then the verdict and its reason."""
    verdict = test["verdict"].replace("_", " ")
    lines = [f"{verdict}: {test['why']}" if test["why"] else verdict]
    if "n" in test:
        lines.insert(0, f"{display.size(test['error'])} / {display.size(test['floor'])}")
    return "\n".join(lines)


def _common(what, test):
    """Return a sentence on what all devices show alike."""
    quantity, display, causes = what
    if test["verdict"] == "not_testable":
        return f"Whether all devices are wrong alike in {quantity} is not testable: {test['why']}."
    sizes = f"{display.text(test['error'])}, noise alone {display.text(test['floor'])}"
    if test["verdict"] == "consistent":
        return f"In {quantity} the devices have no error in common: {sizes}."
    doubt = f" ({test['why']})" if test["why"] else ""
    return (
        f"In {quantity} the devices have an error in common: {sizes}{doubt}. What all see alike is "
        f"no sensor's fault: {causes}."
    )
