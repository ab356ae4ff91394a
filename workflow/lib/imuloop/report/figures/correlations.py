"""Which parameters of the calibration the data tell apart: their correlations as a matrix."""

import numpy as np

from imuloop.report.figures.drawing import BLUE, SHADE, VERMILLION, drawn, entitle
from imuloop.report.numbers import number
from imuloop.report.results import SENSORS

# a correlation below which two parameters are told apart well
TOLD_APART = 0.5
QUANTITIES = {"T": "misalignment", "K": "scale factor", "b": "bias"}
SYMBOLS = str.maketrans("012", "xyz")
# side of a square of its place, and of the matrix, px
SQUARE, SIDE, LARGEST = 0.92, 34, 400


def correlation_matrices(device):
    """Return the picture of the parameters' correlations of each sensor that has some."""
    final = device.calibrations.get("final")
    # biases alone have nothing to be mixed up with
    found = {s: getattr(final, s) for s in SENSORS if final and "K0" in getattr(final, s).names}
    return [
        _picture(device, name, sensor.names, sensor.covariance / np.outer(std, std))
        for name, sensor in found.items()
        if sensor.covariance is not None
        if (std := np.sqrt(np.diag(sensor.covariance))).all()
    ]


def _picture(device, sensor, names, r):
    # K0 as Kx; an effect's parameters without its name
    short = [n.rpartition(".")[2].translate(SYMBOLS) for n in names]
    words = [
        f"{n.partition('.')[0]} {s}" if "." in n else f"{QUANTITIES[n[0]]} {s[1:]}"
        for n, s in zip(names, short, strict=True)
    ]
    table = {"parameter": names, **dict(zip(names, r.T, strict=True))}
    pairs = [(abs(r[i, j]), i, j) for i in range(len(r)) for j in range(i)]
    told = "; ".join(
        f"{words[j]} and {words[i]} {number(r[i, j], 2)}"
        for _, i, j in sorted(pairs, reverse=True)[:3]
    )
    tight = sum(size > TOLD_APART for size, *_ in pairs)
    caption = (
        f"{sensor.capitalize()}: {tight or 'none'} of {len(pairs)} pairs of parameters "
        f"{'correlates' if tight < 2 else 'correlate'} by more than {TOLD_APART}; largest: {told}."
    )
    side = min(SIDE * len(names), LARGEST)

    def plot(area):
        # the lower half, in a square
        count = len(r)
        i, j = np.tril_indices(count, -1)
        size = (SQUARE * side / count) ** 2
        area.scatter(j, i, size, SHADE, marker="s", lw=0)
        values = r[i, j]
        colours = np.where(values > 0, BLUE, VERMILLION)
        marks = area.scatter(j, i, size, colours, marker="s", alpha=np.abs(values), lw=0)
        told = zip(i, j, values, strict=True)
        entitle(area, marks, [f"{short[a]}, {short[b]} {number(v, 2)}" for a, b, v in told])
        # on the diagonal, at the end of its row and on top of its column
        for k, name in enumerate(short):
            area.text(k - 0.4, k, name, va="center", fontsize=min(11, 0.8 * side / count))
        area.set(xlim=(-0.5, count - 0.5), ylim=(count - 0.5, -0.5), box_aspect=1, anchor="W")
        area.set_axis_off()

    kind, size, stem = "Correlation of parameters", (440, side + 8), f"{sensor}_correlations"
    return drawn(device, stem, kind, caption, plot, table, size=size)
