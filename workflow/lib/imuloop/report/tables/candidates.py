"""The ranking of the candidates: what became of each and why, and which cannot be told apart."""

from imuloop.core.effect import Effect
from imuloop.report.effect_units import spans
from imuloop.report.numbers import (
    NO_NUMBER,
    RESIDUAL,
    duration,
    missing,
    number,
    percent,
    plural,
    probability,
    text_of,
    with_unit,
)
from imuloop.report.tables.table import Sized, Table
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
    "temperature": (
        *("bias_temperature", "scale_temperature"),
        *("bias_temperature_rate", "thermal_hysteresis"),
    ),
    "time": ("warm_up", "bias_drift", "ramp", "steps", "gauss_markov", "sinusoid"),
    "attitude": (
        *("quadratic", "cubic", "asymmetry", "cross_coupling"),
        *("g_sensitivity", "g2_sensitivity", "scale_temperature"),
    ),
    "turn": ("scale_nonlinearity", "scale_asymmetry"),
    "order": ("reorientation",),
    "vibration": ("vibration_rectification",),
    "heading": ("earth_rate",),
}
# symbol and unit of the constants of a shape
CONSTANTS = {
    "order": ("order", ""),
    "reference_temperature": ("θ0", "°C"),
    "tau": ("τ", "s"),
    "half_width": ("w", "K"),
    "frequency": ("f", "Hz"),
    "tc": ("Tc", "s"),
}
# best first
UNTRIED = ("not_observable", "not_available")
STATUS = ("added", "confounded", "rejected", *UNTRIED)


def ranked(block):
    """Return a diagnosis' candidates: added ones in their order, then by p-value."""
    order = [effect["name"] for effect in block.get("effects") or []]

    def rank(candidate):
        name, p = candidate["name"], candidate.get("p_value")
        return (
            _place(candidate["status"]),
            order.index(name) if name in order else len(order),
            float("inf") if missing(p) else p,
        )

    return sorted(block.get("candidates") or [], key=rank)


def _place(status):
    return STATUS.index(status) if status in STATUS else len(STATUS)


def ranking_table(sensor, part, block):
    """Return all effects that were thought of: what became of each, and why; None without any."""
    candidates = ranked(block)
    if not candidates:
        return None
    residuals = block.get("residuals") or {}
    meant = "; ".join(
        f"in {RESIDUAL[r['unit']].unit}: {RESIDUAL_WORDS.get(name, name)}"
        for name, r in residuals.items()
    )
    # a row for each reason why effects could not be tried, with all that share it
    untried = {}
    for c in candidates:
        if c["status"] in UNTRIED:
            untried.setdefault((c["status"], c.get("why") or NO_NUMBER), []).append(c["name"])
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
        sorts=(0, 1, 2, 3),
    )


def _status(status, twin=None):
    words = status.replace("_", " ")
    return Sized(f"{words} with {twin}" if twin else words, _place(status))


def _row(candidate, residuals):
    known, p = Effect.library.get(candidate["name"]), candidate.get("p_value")
    adds = (known and known.equation, constants_text(candidate.get("constants")))
    limits = spans(candidate.get("detection_limit") or {}, candidate.get("units") or {})
    return (
        candidate["name"],
        _status(candidate["status"], candidate.get("confounded_with")),
        Sized(probability(p), p),
        _heldout(candidate, residuals),
        "; ".join(limits) or NO_NUMBER,
        candidate.get("why") or NO_NUMBER,
        ", ".join(filter(None, adds)) or NO_NUMBER,
    )


def _heldout(candidate, residuals):
    """Return the held-out error without effects and with this one alone."""
    after = candidate.get("heldout_after")
    residual = residuals.get(candidate.get("residual")) or next(iter(residuals.values()), None)
    if residual is None or missing(after):
        return NO_NUMBER
    unit, before = RESIDUAL[residual["unit"]], residual.get("before")
    start = NO_NUMBER if missing(before) else number(before * unit.factor)
    text = f"{start}\u00a0→\u00a0{with_unit(number(after * unit.factor), unit.unit)}"
    # residuals of several units share the column
    return Sized(text, after / before if before else None)


def constants_text(constants):
    """Return the constants of an effect's shape in words."""
    parts = []
    for name, value in (constants or {}).items():
        if name == "times":
            parts.append(f"{plural(len(value), 'step')}, {', '.join(map(duration, value[:3]))}")
            parts[-1] += ", …" * (len(value) > 3)
        elif name not in ("sessions", "spans"):
            symbol, unit = CONSTANTS.get(name, (name.replace("_", " "), ""))
            text = str(value) if isinstance(value, int) else text_of(value)
            parts.append(f"{symbol} {with_unit(text, unit) if unit else text}")
    return ", ".join(parts)


def telling_apart(*names):
    """Return which recording would tell effects apart: one in which what they depend on varies."""
    kinds = [k for k, effects in _VARIES_WITH.items() if set(names) & set(effects)]
    if "heading" in kinds:
        return _RECORDINGS["heading"]
    return "; ".join(_RECORDINGS[k] for k in kinds or ("attitude", "time"))


def twin_table(sensor, part, block):
    """Return the effects that these data cannot tell apart, and what would; None without any."""
    twins = {}
    for pair in block.get("confounded") or []:
        twins.setdefault(pair["effect"], []).append(pair)
    if not twins:
        return None
    rows = []
    for effect, pairs in twins.items():
        others = [f"{pair['with']} ({percent(pair.get('share'))})" for pair in pairs]
        advice = telling_apart(effect, *(pair["with"] for pair in pairs))
        rows.append((effect, ", ".join(others), advice))
    return Table(
        f"{sensor.capitalize()}, {PARTS[part]}: cannot be told apart in these data",
        ("Effect", "Looks like (share of its pattern)", "What would tell them apart"),
        rows,
        "From the attitudes, times and temperatures of the recording alone, before its residuals: "
        "how much of the pattern that the first would leave the other could leave as well. Where "
        "one of them is named as the cause, it may as well be the other.",
        sorts=(0, 1),
    )
