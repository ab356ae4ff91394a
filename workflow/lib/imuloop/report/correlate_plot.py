"""What the residual that is left goes with: a bar for everything that it was compared with."""

import numpy as np

from imuloop.report.columns import from_records
from imuloop.report.numbers import missing, p_text, percent
from imuloop.report.svg import BLUE, GRID, Picture, draw, write_csv
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS, beyond_chance, correlate_words

NOTE = (
    "Bars: share of the residual's variance that this quantity would explain, less what any "
    "quantity of its size explains by chance. Blue: more than chance would do, all bars counted. "
    "A quantity that the residual goes with is a trace, not yet a cause."
)


def correlate_pictures(device, sensor, part, block, folder):
    """Return how much of each kind of residual every quantity explains, a picture a kind.

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
    for probe in block.get("correlates") or []:
        if not missing(probe.get("share")):
            kinds.setdefault(probe.get("residual"), []).append(probe)
    count = sum(map(len, kinds.values()))
    return [_picture(device, sensor, part, *each, count, folder) for each in kinds.items()]


def _picture(device, sensor, part, residual, probes, count, folder):
    """Return the picture of one kind of residual; `count` probes were compared in all."""
    probes = sorted(probes, key=lambda c: c["share"])
    stem = "_".join(filter(None, [sensor, part, residual, "correlates"]))
    csv = write_csv(folder, stem, from_records(probes[::-1]))
    words = [correlate_words(c["name"]) for c in probes]
    shares = np.clip([c["share"] for c in probes], 0, 1) * 1e2
    sure = [beyond_chance(c, count) for c in probes]
    told = [f"{percent(max(c['share'], 0.0))}, {p_text(c.get('p_value'))}" for c in probes]

    def plot(ax):
        place = np.arange(len(probes))
        ax.barh(place, shares, [BLUE if s else GRID for s in sure])
        for y, share, text in zip(place, shares, told, strict=True):
            ax.text(share + 0.01 * limit, y, text, fontsize=10)
        ax.set_yticks(place, words)
        ax.grid_of = {"x"}
        ax.set_xlim(0, limit)
        ax.set_ylim(-0.5, len(probes) - 0.5)
        ax.set_xlabel("share of the residual explained, %")

    # room for the numbers beside the longest bar
    limit = max(1.6 * shares.max(), 10)
    leading = [i for i, s in enumerate(sure) if s]
    finding = (
        f"it goes most with {words[leading[-1]]}, {told[leading[-1]]}"
        if leading
        else f"nothing that it was compared with explains more than chance; first is "
        f"{words[-1]}, {told[-1]}"
    )
    of = f" of the {RESIDUAL_WORDS.get(residual, residual)}" if residual else ""
    caption = f"{sensor.capitalize()}, {PARTS[part]}, what is left{of}: {finding}."
    alt = f"{caption} " + "; ".join(
        f"{w} {t}" for w, t in zip(words[::-1], told[::-1], strict=True)
    )
    name = f"{device.name}.{stem}"
    height = 62 + 24 * len(probes)
    svg = draw(name, alt, 500, height, plot, margins=(200, 12, 8, 42))
    return Picture(name, svg, caption, NOTE, (csv,))
