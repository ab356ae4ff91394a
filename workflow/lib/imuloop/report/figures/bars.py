"""Bars side by side: what each candidate effect leaves, and what a residual goes with."""

import numpy as np
import pandas as pd

from imuloop.report.figures.drawing import BLUE, GRID, INK, picture, write_csv
from imuloop.report.numbers import RESIDUAL, missing, number, p_text, percent, with_unit
from imuloop.report.tables.candidates import ranked
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS, beyond_chance, correlate_words

CANDIDATES_NOTE = (
    "Each bar: the error on data that the fit never saw, with this effect alone added, in per cent "
    "of that without any (dotted). Blue: added. Grey: not added, no surer than chance or of no "
    "help. Dashed: what noise alone leaves. Good: a blue bar that ends near the dashed line, or no "
    "bar that could. Beyond the dotted line an effect only fits noise."
)
CORRELATES_NOTE = (
    "Bars: share of the residual's variance that this quantity would explain, less what any "
    "quantity of its size explains by chance. Blue: more than chance would do, all bars counted. "
    "A quantity that the residual goes with is a trace, not yet a cause."
)
# a bar that is longer than this, %, ends there
LONGEST = 160


def draw_bars(area, names, lengths, marked, said, widest):
    """Draw a bar per name, the last on top, those marked in colour, with a text at its end."""
    area.barh(names, lengths, color=[BLUE if m else GRID for m in marked], height=0.62)
    for place, text in enumerate(said):
        area.text(widest, place, text, ha="right", va="center", fontsize=10)
    area.set(xlim=(0, widest), ylim=(-0.5, len(names) - 0.5))
    area.grid(visible=False, axis="y")


def candidate_pictures(device, sensor, part, block):
    """Return how much of each kind of held-out error every candidate leaves, a picture per kind."""
    kinds = {}
    for candidate in ranked(block):
        residual = (block.get("residuals") or {}).get(candidate.get("residual")) or {}
        if not missing(candidate.get("heldout_after")) and (residual.get("before") or 0) > 0:
            kinds.setdefault(candidate["residual"], []).append(candidate)
    return [
        _candidates(device, sensor, part, kind, found, block["residuals"][kind])
        for kind, found in kinds.items()
    ]


def _candidates(device, sensor, part, kind, candidates, residual):
    # from below: added ones last, of each the one that leaves least
    candidates = sorted(
        candidates, key=lambda c: (c["status"] != "added", c["heldout_after"]), reverse=True
    )
    unit, before = RESIDUAL[residual["unit"]], residual["before"]
    names = [c["name"] for c in candidates]
    left = np.array([c["heldout_after"] for c in candidates]) / before * 1e2
    floor = (residual.get("floor") or np.nan) / before * 1e2
    shown = np.minimum(left, LONGEST)
    said = [
        f"{number(c['heldout_after'] * unit.factor)} {unit.unit}, {p_text(c.get('p_value'))}"
        for c in candidates
    ]
    added = [c["status"] == "added" for c in candidates]

    def plot(area):
        # room for the numbers beside the longest bar
        widest = 1.75 * np.nanmax([*shown, 100, floor])
        draw_bars(area, names, shown, added, said, widest)
        area.axvline(100, color=INK, ls=":", lw=1.2)
        area.axvline(floor, color=INK, ls="--", lw=1)
        area.set_xlabel("held-out error left, % of that without any effect")

    columns = {
        "effect": names,
        "status": [c["status"] for c in candidates],
        "p_value": [c.get("p_value") for c in candidates],
        "heldout_after": [c["heldout_after"] for c in candidates],
        "heldout_before": before,
        "floor": residual.get("floor"),
        "unit": residual["unit"],
    }
    stem = "_".join(dict.fromkeys([sensor, part, kind, "candidates"]))
    best = min(candidates, key=lambda c: c["heldout_after"])
    start, least, noise = (
        with_unit(number(None if missing(v) else v * unit.factor), unit.unit)
        for v in (before, best["heldout_after"], residual.get("floor"))
    )
    lowered = (
        f"{best['name']} alone leaves least, {least} of {start}"
        if best["heldout_after"] < before
        else f"none alone lowers the held-out error of {start}"
    )
    caption = (
        f"{sensor.capitalize()}, {PARTS[part]}: of {len(candidates)} effects that could be tried "
        f"on the {RESIDUAL_WORDS.get(kind, kind)} {sum(added) or 'none'} "
        f"{'was' if sum(added) < 2 else 'were'} added; {lowered}, floor from noise {noise}."
    )
    return picture(
        f"{device.name}.{stem}",
        "Candidate effects",
        caption,
        plot,
        (500, 62 + 22 * len(candidates)),
        CANDIDATES_NOTE,
        (write_csv(device.figures, stem, pd.DataFrame(columns)[::-1]),),
    )


def correlate_pictures(device, sensor, part, block):
    """Return how much of each kind of residual every quantity explains, a picture per kind."""
    kinds = {}
    for probe in block.get("correlates") or []:
        if not missing(probe.get("share")):
            kinds.setdefault(probe.get("residual"), []).append(probe)
    count = sum(map(len, kinds.values()))
    return [_correlates(device, sensor, part, *each, count) for each in kinds.items()]


def _correlates(device, sensor, part, residual, probes, count):
    """Return the picture of one kind of residual; `count` probes were compared in all."""
    probes = sorted(probes, key=lambda c: c["share"])
    words = [correlate_words(c["name"]) for c in probes]
    shares = np.clip([c["share"] for c in probes], 0, 1) * 1e2
    sure = [beyond_chance(c, count) for c in probes]
    said = [f"{percent(max(c['share'], 0.0))}, {p_text(c.get('p_value'))}" for c in probes]

    def plot(area):
        draw_bars(area, words, shares, sure, said, max(1.6 * shares.max(), 10))
        area.set_xlabel("share of the residual explained, %")

    leading = [i for i, s in enumerate(sure) if s]
    finding = (
        f"it goes most with {words[leading[-1]]}, {said[leading[-1]]}"
        if leading
        else f"nothing that it was compared with explains more than chance; first is "
        f"{words[-1]}, {said[-1]}"
    )
    of = f" of the {RESIDUAL_WORDS.get(residual, residual)}" if residual else ""
    stem = "_".join(filter(None, [sensor, part, residual, "correlates"]))
    return picture(
        f"{device.name}.{stem}",
        "What a residual goes with",
        f"{sensor.capitalize()}, {PARTS[part]}, what is left{of}: {finding}.",
        plot,
        (500, 62 + 24 * len(probes)),
        CORRELATES_NOTE,
        (write_csv(device.figures, stem, pd.DataFrame(probes[::-1])),),
    )
