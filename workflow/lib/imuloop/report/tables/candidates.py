"""The ranking of the candidates: what became of each and why, and which cannot be told apart."""

from imuloop.core.effect import Effect
from imuloop.core.errors import plural
from imuloop.report.numbers import (
    NO_NUMBER,
    duration,
    missing,
    percent,
    probability,
    text_of,
    with_unit,
)
from imuloop.report.tables.table import Sized, Table
from imuloop.report.units import RESIDUAL, spans
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS

# what an effect varies with, and the recording in which that varies
_RECORDINGS = {
    "temperature": "heat and cool within one record, at more than one rate",
    "time": "a longer record, or the same again in another order",
    "attitude": "more attitudes, edges and corners as well as faces",
    "turn": "turns at varied speeds and in both senses about every axis",
    "order": "the same attitudes in another order",
    "vibration": "the same attitudes with and without vibration",
    "heading": "nothing at one place: the Earth's vertical rate follows from the latitude",
}
_VARIES_WITH = {
    "temperature": "bias_temperature scale_temperature bias_temperature_rate thermal_hysteresis",
    "time": "warm_up bias_drift ramp steps gauss_markov sinusoid",
    "attitude": "quadratic cubic asymmetry cross_coupling g_sensitivity g2_sensitivity "
    "scale_temperature",
    "turn": "scale_nonlinearity scale_asymmetry",
    "order": "reorientation",
    "vibration": "vibration_rectification",
    "heading": "earth_rate",
}
# symbol and unit of the constants of a shape
CONSTANTS = {
    "order": ("order", ""),
    "reference_temperature": ("θ0", "°C"),
    "tau": ("τ", "s"),
    "half_width": ("w", "K"),
    "frequency": ("f", "Hz"),
    "tc": ("Tc", "s"),
    "middle": ("t_m", "s"),
}
# best first
UNTRIED = ("not_observable", "not_available")
STATUS = ("added", "confounded", "rejected", *UNTRIED)


def ranked(block):
    """Return a diagnosis' candidates: added ones in their order, then by p-value."""
    order = [effect["name"] for effect in block["effects"]]
    return sorted(
        block["candidates"],
        key=lambda c: (
            STATUS.index(c["status"]),
            order.index(c["name"]) if c["name"] in order else len(order),
            float("inf") if c["p_value"] is None else c["p_value"],
        ),
    )


def ranking_table(sensor, part, block):
    """Return all effects that were thought of: what became of each, and why; None without any."""
    candidates, residuals = ranked(block), block["residuals"]
    if not candidates:
        return None
    meant = "; ".join(
        f"in {RESIDUAL[r['unit']].unit}: {RESIDUAL_WORDS[name]}" for name, r in residuals.items()
    )
    # a row for each reason why effects could not be tried, with all that share it
    untried = {}
    for c in candidates:
        if c["status"] in UNTRIED:
            untried.setdefault((c["status"], c["why"]), []).append(c["name"])
    return Table(
        f"{sensor.capitalize()}, {PARTS[part]}: candidate effects, best first",
        (
            *("Effect", "Status", "p-value", "Held-out error without → with it alone"),
            *("Detection limit", "Why", "It adds"),
        ),
        [_row(c, residuals) for c in candidates if c["status"] not in UNTRIED]
        + [
            (", ".join(names), _status(status), *[NO_NUMBER] * 3, why, NO_NUMBER)
            for (status, why), names in untried.items()
        ],
        "p-value: how often noise alone would look this much like the effect. Held-out error: root "
        f"mean square of the model without effects, and with this one alone added ({meant}). "
        "Detection limit: the smallest size that these data would have shown in nine of ten "
        "cases; the least and the greatest of the effect's parameters.",
        dense=True,
        sortable=True,
    )


def _status(status, twin=None):
    words = status.replace("_", " ")
    return Sized(f"{words} with {twin}" if twin else words, STATUS.index(status))


def _row(candidate, residuals):
    known, p = Effect.library.get(candidate["name"]), candidate["p_value"]
    adds = (known and known.equation, constants_text(candidate.get("constants", {})))
    limits = spans(candidate["detection_limit"] or {}, candidate.get("units", {}))
    error, after = NO_NUMBER, candidate["heldout_after"]
    # of a residual that the block lacks neither the unit nor the error without it is known
    residual = residuals.get(candidate.get("residual"))
    if residual and not missing(after):
        unit, before = RESIDUAL[residual["unit"]], residual["before"]
        # residuals of several units share the column
        error = Sized(
            f"{unit.size(before)}\u00a0→\u00a0{unit.text(after)}",
            after / before if before else None,
        )
    return (
        candidate["name"],
        _status(candidate["status"], candidate["confounded_with"]),
        Sized(probability(p), p),
        error,
        "; ".join(limits) or NO_NUMBER,
        candidate["why"],
        ", ".join(filter(None, adds)) or NO_NUMBER,
    )


def constants_text(constants):
    """Return the constants of an effect's shape in words."""
    parts = []
    for name, value in constants.items():
        if name == "times":
            parts.append(f"{plural(len(value), 'step')}, {', '.join(map(duration, value[:3]))}")
            parts[-1] += ", …" * (len(value) > 3)
        elif name not in ("sessions", "spans", "marker"):
            symbol, unit = CONSTANTS.get(name, (name.replace("_", " "), ""))
            text = str(value) if isinstance(value, (int, str)) else text_of(value)
            parts.append(f"{symbol} {with_unit(text, unit) if unit else text}")
    return ", ".join(parts)


def telling_apart(*names):
    """Return which recording would tell effects apart: one in which what they depend on varies."""
    kinds = [k for k, effects in _VARIES_WITH.items() if set(names) & set(effects.split())]
    if "heading" in kinds:
        return _RECORDINGS["heading"]
    return "; ".join(_RECORDINGS[k] for k in kinds or ("attitude", "time"))


def twin_table(sensor, part, block):
    """Return the effects that these data cannot tell apart, and what would; None without any."""
    twins = {}
    for pair in block["confounded"]:
        twins.setdefault(pair["effect"], []).append(pair)
    if not twins:
        return None
    return Table.of(
        f"{sensor.capitalize()}, {PARTS[part]}: cannot be told apart in these data",
        twins.items(),
        {
            "Effect": lambda twin: twin[0],
            "Looks like (share of its pattern)": lambda twin: ", ".join(
                f"{pair['with']} ({percent(pair['share'])})" for pair in twin[1]
            ),
            "What would tell them apart": lambda twin: telling_apart(
                twin[0], *(pair["with"] for pair in twin[1])
            ),
        },
        "From the attitudes, times and temperatures of the recording alone, before its residuals: "
        "how much of the pattern that the first would leave the other could leave as well. Where "
        "one of them is named as the cause, it may as well be the other.",
        sortable=True,
    )
