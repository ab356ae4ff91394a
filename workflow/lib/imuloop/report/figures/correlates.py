"""What the residual that is left goes with: a bar for everything that it was compared with."""

import numpy as np
import pandas as pd

from imuloop.report.figures.drawing import BLUE, GRID, WIDE, drawn
from imuloop.report.numbers import missing, p_text, percent
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS, beyond_chance, correlate_words


def correlate_pictures(device, sensor, part, block):
    """Return how much of each kind of residual every quantity explains, a picture per kind."""
    kinds = {}
    for probe in block["correlates"]:
        if not missing(probe["share"]):
            kinds.setdefault(probe["residual"], []).append(probe)
    count = sum(map(len, kinds.values()))
    return [_picture(device, sensor, part, *each, count) for each in kinds.items()]


def _picture(device, sensor, part, residual, probes, count):
    """Return the picture of one kind of residual; `count` probes were compared in all."""
    probes = sorted(probes, key=lambda c: c["share"])
    names = [correlate_words(c["name"]) for c in probes]
    shares = np.clip([c["share"] for c in probes], 0, 1) * 1e2
    sure = [beyond_chance(c, count) for c in probes]
    said = [f"{percent(max(c['share'], 0.0))}, {p_text(c['p_value'])}" for c in probes]

    def plot(area):
        widest = max(1.6 * shares.max(), 10)
        area.barh(names, shares, color=[BLUE if s else GRID for s in sure], height=0.62)
        for place, text in enumerate(said):
            area.text(widest, place, text, ha="right", va="center", fontsize=10)
        area.set(xlim=(0, widest), ylim=(-0.5, len(names) - 0.5))
        area.grid(visible=False, axis="y")
        area.set_xlabel("share of the residual explained, %")

    leading = [i for i, s in enumerate(sure) if s]
    finding = (
        f"it goes most with {names[leading[-1]]}, {said[leading[-1]]}"
        if leading
        else f"nothing that it was compared with explains more than chance; first is "
        f"{names[-1]}, {said[-1]}"
    )
    words = f"{sensor.capitalize()}, {PARTS[part]}, what is left of the {RESIDUAL_WORDS[residual]}"
    return drawn(
        device,
        f"{sensor}_{part}_{residual}_correlates",
        "What a residual goes with",
        f"{words}: {finding}.",
        plot,
        pd.DataFrame(probes[::-1]),
        size=(WIDE, 62 + 24 * len(probes)),
    )
