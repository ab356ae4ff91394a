"""Candidate effects side by side: what each alone does to the held-out error."""

import numpy as np

from imuloop.report.columns import from_records
from imuloop.report.numbers import RESIDUAL, missing, number, probability, with_unit
from imuloop.report.ranking import ranked
from imuloop.report.svg import BLUE, GRID, Picture, draw, write_csv
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS

NOTE = (
    "Each bar: the error on data that the fit never saw, with this effect alone added, in per cent "
    "of that without any (dotted). Blue: added. Grey: not added, no surer than chance or of no "
    "help. Dashed: what noise alone leaves. Good: a blue bar that ends near the dashed line, or no "
    "bar that could. Beyond the dotted line an effect only fits noise."
)
# a bar that is longer than this, %, ends there
LONGEST = 160


def ranking_pictures(device, sensor, part, block, folder):
    """Return how much of each kind of held-out error every candidate leaves, a picture a kind.

    Parameters
    ----------
    device : Device
        The device.
    sensor, part : str
        Which diagnosis.
    block : dict
        Its content.
    folder : Path
        Where the CSV files go.
    """
    kinds = {}
    for candidate in ranked(block):
        residual = (block.get("residuals") or {}).get(candidate.get("residual")) or {}
        if not missing(candidate.get("heldout_after")) and (residual.get("before") or 0) > 0:
            kinds.setdefault(candidate["residual"], []).append(candidate)
    return [
        _picture(device, sensor, part, kind, found, block["residuals"][kind], folder)
        for kind, found in kinds.items()
    ]


def _picture(device, sensor, part, kind, candidates, residual, folder):
    # added ones first, then the one that leaves least
    candidates = sorted(
        candidates, key=lambda c: (c["status"] != "added", c["heldout_after"]), reverse=True
    )
    before = residual["before"]
    left = np.array([c["heldout_after"] for c in candidates]) / before * 1e2
    floor = (residual.get("floor") or np.nan) / before * 1e2
    unit = RESIDUAL[residual["unit"]]
    told = [
        f"{number(c['heldout_after'] * unit.factor)} {unit.unit}, p {probability(c.get('p_value'))}"
        for c in candidates
    ]
    stem = "_".join(dict.fromkeys([sensor, part, kind, "candidates"]))
    csv = write_csv(
        folder,
        stem,
        from_records(
            [
                {
                    "effect": c["name"],
                    "status": c["status"],
                    "p_value": c.get("p_value"),
                    "heldout_after": c["heldout_after"],
                    "heldout_before": before,
                    "floor": residual.get("floor"),
                    "unit": residual["unit"],
                }
                for c in candidates[::-1]
            ]
        ),
    )

    shown = np.minimum(left, LONGEST)
    # room for the numbers beside the longest bar
    widest = 1.75 * max(shown.max(), 100, 0 if missing(floor) else floor)

    def plot(ax):
        place = np.arange(len(candidates))
        colours = [BLUE if c["status"] == "added" else GRID for c in candidates]
        ax.barh(place, shown, colours)
        for y, text in zip(place, told, strict=True):
            ax.text(widest, y, text, "right", fontsize=10)
        ax.axvline(100, ls=":", lw=1.2)
        if not missing(floor):
            ax.axvline(floor, ls="--", lw=1)
        ax.set_yticks(place, [c["name"] for c in candidates])
        ax.grid_of = {"x"}
        ax.set_xlim(0, widest)
        ax.set_ylim(-0.5, len(candidates) - 0.5)
        ax.set_xlabel("held-out error left, % of that without any effect")

    best = min(candidates, key=lambda c: c["heldout_after"])
    added = [c["name"] for c in candidates if c["status"] == "added"]
    lowered = missing(before) or best["heldout_after"] < before
    words = RESIDUAL_WORDS.get(kind, kind)
    start, least, noise = (
        with_unit(number(None if missing(v) else v * unit.factor), unit.unit)
        for v in (before, best["heldout_after"], residual.get("floor"))
    )
    caption = (
        f"{sensor.capitalize()}, {PARTS[part]}: of {len(candidates)} effects that could be tried "
        f"on the {words} {len(added) or 'none'} {'was' if len(added) < 2 else 'were'} added; "
        + (
            f"{best['name']} alone leaves least, {least} of {start}"
            if lowered
            else f"none alone lowers the held-out error of {start}"
        )
        + f", floor from noise {noise}."
    )
    name = f"{device.name}.{stem}"
    alt = f"{caption} " + "; ".join(
        f"{c['name']} {t}" for c, t in zip(candidates[::-1], told[::-1], strict=True)
    )
    svg = draw(name, alt, 500, 62 + 22 * len(candidates), plot, margins=(150, 12, 8, 42))
    return Picture(name, svg, caption, NOTE, (csv,))
