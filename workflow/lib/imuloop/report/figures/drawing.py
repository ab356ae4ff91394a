"""Pictures drawn by matplotlib as SVG: same bytes each time, colours that follow the page."""

import io
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import matplotlib
import numpy as np
import pyarrow as pa
from markupsafe import Markup, escape
from matplotlib import cycler
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator, ScalarFormatter
from pyarrow import csv

from imuloop.core.files import replaced
from imuloop.core.tables import text_cells
from imuloop.report.figures.compact import compact
from imuloop.report.numbers import superscript

INK, GRID, SHADE, PAGE = "#1b1f24", "#c8ced6", "#eef1f4", "#ffffff"
# colours that are told apart with any colour vision
PALETTE = ("#0244af", "#b13311", "#048e8b", "#c369cf", "#d87d15", "#4e90ff", "#937851")
BLUE, VERMILLION, GREEN, PURPLE, ORANGE, *_ = PALETTE
# colours of the axes x, y, z in every picture
AXES = (BLUE, VERMILLION, GREEN)
# the variable of the page for each colour, light or dark
THEME = {INK: "currentColor", GRID: "var(--grid)", SHADE: "var(--shade)", PAGE: "var(--page)"}
THEME |= {colour: f"var(--c{i})" for i, colour in enumerate(PALETTE)}
STYLE = {
    "svg.fonttype": "none",
    "font.sans-serif": ["DejaVu Sans"],
    # other people may have written the labels: a $ in them must not start a formula
    "text.parse_math": False,
    "font.size": 12,
    "legend.fontsize": 12,
    "legend.frameon": False,
    "legend.borderaxespad": 0.2,
    "legend.handlelength": 1.5,
    "legend.columnspacing": 1.2,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GRID,
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.useoffset": False,
    "axes.prop_cycle": cycler(color=PALETTE),
    "axes.xmargin": 0.02,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.markeredgewidth": 0,
    # px
    "path.simplify_threshold": 0.4,
    **dict.fromkeys(("axes.labelsize", "xtick.labelsize", "ytick.labelsize"), 12),
    **{f"{axis}tick.{kind}.size": 0 for axis in "xy" for kind in ("major", "minor")},
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
}
CLEAR = dict.fromkeys(("figure.facecolor", "axes.facecolor"), "none")
# entries in which matplotlib writes its name and the date
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
# size of a picture that a small screen shows whole, size of a picture next to a column of text, and
# the width from which on a picture takes the full width of the page, px
SMALL, BESIDE, WIDE = (356, 250), (560, 240), 600


@dataclass(frozen=True)
class Picture:
    """A picture of the report, drawn when it is needed.

    `name` is unique in the report: DEVICE.NAME. The ids in the drawing are made from it. `kind` and
    `caption` are its text for readers who cannot see it. `plot` is a function that draws on a
    matplotlib `Axes`, or, if the picture has several, on a list of them, row by row. The key of the
    picture lists all lines that have labels.
    """

    name: str
    kind: str
    caption: str
    plot: Callable
    numbers: Mapping = field(default_factory=dict)  # columns of the CSV file
    size: tuple = SMALL  # px
    columns: tuple = (1,)  # relative widths of the columns of Axes
    rows: tuple = (1,)  # relative heights of the rows of Axes
    file: str = ""  # name of the CSV file without .csv, if it is not the name of the picture

    @property
    def stem(self):
        """The name of the picture without its device, from which its SVG file has its name."""
        return self.name.partition(".")[2].replace(".", "_")

    @property
    def csv(self):
        """The name of the CSV file with the numbers of the picture."""
        return f"{self.file or self.stem}.csv"

    @property
    def wide(self):
        """Whether the picture takes the full width of the page."""
        return self.size[0] > WIDE

    def figure(self):
        """Return the picture as a matplotlib figure."""
        with matplotlib.rc_context(STYLE):
            # 72 points an inch: a point is a pixel
            inches = [side / 72 for side in self.size]
            figure = Figure(figsize=inches, dpi=72, layout="constrained")
            areas = figure.subplots(
                len(self.rows),
                len(self.columns),
                sharex="col",
                sharey="row",
                squeeze=False,
                width_ratios=self.columns,
                height_ratios=self.rows,
            )
            areas, key = areas.ravel().tolist(), {}
            self.plot(areas if len(areas) > 1 else areas[0])
            for area in figure.axes:
                # no wider than the area, and each asks for all ticks again
                area.spines[:].set_in_layout(False)
                key |= dict(zip(*reversed(area.get_legend_handles_labels()), strict=True))
                for axis in (area.xaxis, area.yaxis):
                    if axis.get_scale() == "log" and axis.isDefault_majloc:
                        _mark_decades(axis)
            if key:
                figure.legend(key.values(), key, loc="outside upper right", ncols=len(key))
            figure.align_ylabels()
            return figure

    @cached_property
    def svg(self):
        """The drawing as the text of an SVG file; its colours do not follow the page."""
        file = io.StringIO()
        with matplotlib.rc_context(STYLE | CLEAR | {"svg.hashsalt": self.name}):
            # `savefig` would lay it out twice
            FigureCanvasSVG(self.figure()).print_svg(file, metadata=NO_METADATA)
        return re.sub(' (?:d|x|y)="[^"]*"', _rounded, file.getvalue())

    @property
    def inline(self):
        """The drawing as an element of the page, in the page's colours."""
        alt = escape(f"{self.kind}. {self.caption}")
        box = "0 0 {} {}".format(*self.size)
        svg = f'<svg role="img" aria-label="{alt}" fill="none" viewBox="{box}">{compact(self.svg)}'
        for colour, variable in THEME.items():
            svg = svg.replace(colour, variable)
        return Markup(svg)

    def write_svg(self, folder):
        """Write the picture as an SVG file on white, and return the path of the file.

        `folder` is the folder of the file, a Path.
        """
        text = self.svg.replace("<svg ", '<svg style="background:#ffffff" ', 1)
        path = folder / f"{self.stem}.svg"
        with replaced(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
        return path

    def write(self, folder):
        """Write the picture as an SVG file, and its `numbers` as a CSV file.

        `folder` is the folder of both files, a Path. None and not-a-number are empty in the CSV
        file.
        """
        self.write_svg(folder)
        columns = {k: pa.array(np.asarray(v), from_pandas=True) for k, v in self.numbers.items()}
        with replaced(folder / self.csv) as temporary:
            options = csv.WriteOptions(quoting_style="needed")
            csv.write_csv(text_cells(pa.table(columns)), temporary, options)


def _rounded(attribute):
    """Return the text of an SVG attribute with its numbers cut to two decimals.

    `attribute` is a regex match of the attribute.
    """
    return re.sub(r"(\.\d\d)\d+", r"\1", attribute[0])


def fill(area, x, low, high, colour, alpha=0.2):
    """Fill the area between two curves, as for a band of confidence, on the matplotlib Axes `area`.

    The curves are `low` and `high` over `x`, (n,) each. `colour` is the colour of the area, and
    `alpha` its opacity, 0 to 1.
    """
    area.fill_between(x, low, high, color=colour, alpha=alpha, lw=0)


def _mark_decades(axis):
    """Set the ticks of a logarithmic axis: powers of ten, or also values between if these are few.

    `axis` is the x or y axis of a matplotlib Axes.
    """
    low, high = axis.get_view_interval()
    axis.set_minor_locator(NullLocator())
    if high < 4 * low:
        axis.set_major_locator(MaxNLocator(4, steps=(1, 2, 5, 10)))
        axis.set_major_formatter(ScalarFormatter())
    else:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
        axis.set_major_formatter(FuncFormatter(_decade))


def _decade(value, _):
    """Return the text of the tick at `value`: 0.01 … 1000 in full, others as powers of ten.

    The second argument, the position of the tick, is not used.
    """
    digits, _, exponent = f"{value:.0e}".partition("e")
    if -2 <= int(exponent) < 4:
        return f"{value:g}"
    return f"{digits}·" * (digits != "1") + f"10{superscript(int(exponent))}"
