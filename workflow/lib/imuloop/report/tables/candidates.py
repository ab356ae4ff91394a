"""The ranking of the candidates: what became of each and why, and which cannot be told apart."""

from imuloop.core.errors import plural
from imuloop.report.numbers import (
    NO_NUMBER,
    duration,
    percent,
    text_of,
    with_unit,
)
from imuloop.report.tables.table import Sized, Table
from imuloop.report.units import spans
from imuloop.report.verdict import PARTS

# symbol and unit of the constants of a shape
CONSTANTS = {
    "order": ("order", ""),
    "reference_temperature": ("θ0", "°C"),
    "tau": ("τ", "s"),
    "half_width": ("w", "K"),
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
    candidates = ranked(block)
    if all(c["status"] in UNTRIED for c in candidates):
        return None
    tried = [c for c in candidates if c["status"] not in UNTRIED]
    return Table(
        f"{sensor.capitalize()}, {PARTS[part]}: candidate effects, best first",
        ("Effect", "Status", "Would be seen from"),
        [_row(c) for c in tried],
        " ".join(filter(None, (_untried(len(candidates) - len(tried)), _twins(block)))),
        dense=True,
        sortable=True,
    )


def _untried(count):
    return f"{plural(count, 'effect')} more cannot show here: see diagnosis.json." * bool(count)


def _twins(block):
    """Return which effects these data cannot tell apart, each pair once, with the share alike."""
    pairs = {}
    for pair in block["confounded"]:
        pairs.setdefault(frozenset((pair["effect"], pair["with"])), pair)
    said = (f"{p['effect']} and {p['with']} ({percent(p['share'])})" for p in pairs.values())
    return f"Cannot be told apart in these data: {', '.join(said)}." if pairs else ""


def _status(status, twin=None):
    words = status.replace("_", " ")
    return Sized(f"{words} with {twin}" if twin else words, STATUS.index(status))


def _row(candidate):
    limits = spans(candidate["detection_limit"] or {}, candidate.get("units", {}))
    return (
        candidate["name"],
        _status(candidate["status"], candidate["confounded_with"]),
        "; ".join(limits) or NO_NUMBER,
    )


def constants_text(constants):
    """Return the constants of an effect's shape in words."""
    parts = []
    for name, value in constants.items():
        if name == "times":
            parts.append(f"{plural(len(value), 'step')}, {', '.join(map(duration, value[:3]))}")
            parts[-1] += ", …" * (len(value) > 3)
        elif name not in ("sessions", "spans"):
            symbol, unit = CONSTANTS.get(name, (name.replace("_", " "), ""))
            text = str(value) if isinstance(value, (int, str)) else text_of(value)
            parts.append(f"{symbol} {with_unit(text, unit) if unit else text}")
    return ", ".join(parts)
