"""Which parameters of the calibration the data tell apart: their correlations as a matrix."""

import numpy as np

from imuloop.report.calibration_tables import correlations, parameter_words
from imuloop.report.numbers import number
from imuloop.report.paths import FONT
from imuloop.report.results import SENSORS
from imuloop.report.svg import BLUE, VERMILLION, Picture, draw, write_csv

NOTE = (
    "A square a pair of parameters (T misalignment, K scale factor, b bias), the fuller the more "
    "an error of one shows as an error of the other: blue in the same sense, orange-red in the "
    "opposite; point at it for the number. Good: pale squares only. A full one, beyond 0.9, says "
    "that the data hardly tell the two apart: add attitudes, or turns about other axes, in which "
    "they differ."
)
# a correlation below which two parameters are told apart well
TOLD_APART = 0.5
SYMBOLS = str.maketrans("012", "xyz")


def correlation_matrices(device, folder):
    """Return the picture of the parameters' correlations of each sensor that has some.

    Parameters
    ----------
    device : Device
        The device.
    folder : Path
        Where the CSV files go.
    """
    final = device.calibrations.get("final")
    # biases alone have nothing to be mixed up with
    scaled = [s for s in SENSORS if final and "K0" in getattr(final, s).names]
    found = {s: correlations(getattr(final, s)) for s in scaled}
    return [_picture(device, s, r, folder) for s, r in found.items() if r is not None]


def _picture(device, sensor, r, folder):
    names = getattr(device.calibrations["final"], sensor).names
    # K0 as Kx; an effect's parameters without its name
    short = [n.rpartition(".")[2].translate(SYMBOLS) for n in names]
    words = [
        f"{n.partition('.')[0]} {s}" if "." in n else parameter_words(n)
        for n, s in zip(names, short, strict=True)
    ]
    table = {"parameter": names, **dict(zip(names, r.T, strict=True))}
    csv = write_csv(folder, f"{sensor}_correlations", table)
    count, places = len(names), range(len(names))

    def plot(ax):
        ax.cells(
            [[j < i and (BLUE if r[i, j] > 0 else VERMILLION) for j in places] for i in places],
            np.abs(r),
            [[f"{short[i]}, {short[j]} {number(r[i, j], 2)}" for j in places] for i in places],
        )
        ax.set_axis_off()
        # on the diagonal, at the end of its row and on top of its column
        for i, name in enumerate(short):
            ax.text(i - 0.4, i, name, fontsize=min(FONT, 0.8 * side / count))

    pairs = sorted(((abs(r[i, j]), i, j) for i in places for j in range(i)), reverse=True)
    told = "; ".join(f"{words[j]} and {words[i]} {number(r[i, j], 2)}" for _, i, j in pairs[:3])
    tight = sum(size > TOLD_APART for size, *_ in pairs)
    caption = (
        f"{sensor.capitalize()}: {tight or 'none'} of {len(pairs)} pairs of parameters "
        f"{'correlates' if tight < 2 else 'correlate'} by more than {TOLD_APART}; largest: {told}."
    )
    name = f"{device.name}.{sensor}_correlations"
    side = min(34 * count, 400)
    margins = (8, 440 - 8 - side, 4, 4)
    svg = draw(name, f"Correlation of parameters. {caption}", 440, side + 8, plot, margins)
    return Picture(name, svg, caption, NOTE, (csv,))
