"""Pictures drawn by matplotlib as SVG: same bytes each time, colours that follow the page."""

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import matplotlib
import numpy as np
import pyarrow as pa
from markupsafe import Markup, escape
from matplotlib import cycler
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import (
    FuncFormatter,
    LogLocator,
    MaxNLocator,
    NullLocator,
    ScalarFormatter,
)
from pyarrow import csv

from imuloop.core.files import replaced
from imuloop.core.tables import text_cells
from imuloop.report.numbers import superscript

INK, GRID, SHADE, PAGE = "#1b1f24", "#c8ced6", "#eef1f4", "#ffffff"
# colours that are told apart with any colour vision
PALETTE = ("#0244af", "#b13311", "#048e8b", "#c369cf", "#d87d15", "#4e90ff", "#937851")
BLUE, VERMILLION, GREEN, PURPLE, ORANGE, *_ = PALETTE
# colours of the axes x, y, z in every picture
AXES = (BLUE, VERMILLION, GREEN)
# what the page has in the place of each colour, light or dark
THEME = {INK: "currentColor", GRID: "var(--grid)", SHADE: "var(--shade)", PAGE: "var(--page)"}
THEME |= {colour: f"var(--c{i})" for i, colour in enumerate(PALETTE)}
STYLE = {
    "svg.fonttype": "none",
    "font.sans-serif": ["DejaVu Sans"],
    # labels are other people's text
    "text.parse_math": False,
    "font.size": 11,
    "axes.labelsize": 11,
    "xtick.labelsize": 11,
    "ytick.labelsize": 11,
    "legend.fontsize": 10,
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
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
}
CLEAR = dict.fromkeys(("figure.facecolor", "axes.facecolor"), "none")
# what matplotlib writes of itself and of the day
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
# the width that a picture has beside another, px
WIDE = 500
# powers of ten that are written out
PLAIN = range(-2, 4)


@dataclass(frozen=True)
class Picture:
    """A picture of the report, drawn when it is asked for.

    Its name is unique in the report, and the drawing's ids are made from it; kind and caption, a
    sentence made from the data, are what readers get who cannot see it. `plot` draws on the `Axes`,
    or on the list of them, row by row, that it is given; what it labels is in the key. Size, px;
    path of the numbers behind it, from the report's folder; relative widths and heights of the
    areas, which share their limits.
    """

    name: str
    kind: str
    caption: str
    plot: Callable
    size: tuple = (440, 300)
    csv: str = ""
    columns: tuple = (1,)
    rows: tuple = (1,)

    @property
    def stem(self):
        """Its name among the figures of its device, and that of its file."""
        return self.name.partition(".")[2].replace(".", "_")

    @property
    def wide(self):
        """Whether it takes the full width of the page."""
        return self.size[0] > WIDE

    def figure(self):
        """Return it as a matplotlib figure."""
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
            # areas share axes, and one that is marked is marked in all
            in_decades = [pair for each in figure.axes for pair in _in_decades(each)]
            for area, axis in in_decades:
                _mark_decades(axis)
                _grid_between(area, axis)
            if key:
                figure.legend(key.values(), key, loc="outside upper right", ncols=len(key))
            figure.align_ylabels()
            return figure

    @cached_property
    def svg(self):
        """The drawing as the text of an SVG file, in colours that need no page."""
        file = io.StringIO()
        with matplotlib.rc_context(STYLE | CLEAR | {"svg.hashsalt": self.name}):
            drawn = self.figure()
            # `savefig` would lay it out twice
            FigureCanvasSVG(drawn).print_svg(file, metadata=NO_METADATA)
        text = file.getvalue()
        for group, titles in getattr(drawn, "titles", {}).items():
            before, start, after = text.partition(f'<g id="{group}">')
            said = iter(titles)
            after = re.sub(
                "(<use [^>]*)/>",
                lambda mark, said=said: f"{mark[1]}><title>{escape(next(said))}</title></use>",
                after,
                count=len(titles),
            )
            text = f"{before}{start}{after}"
        return text

    @property
    def inline(self):
        """The drawing as an element of the page, in the page's colours.

        Without what a page may have once only: the head of the file, its style, names of groups.
        """
        svg = re.sub('<style.*?</style>|(?<=<g) id="[^"]*"', "", self.svg, flags=re.DOTALL)
        alt = escape(f"{self.kind}. {self.caption}")
        svg = f'<svg role="img" aria-label="{alt}" {svg.partition("<svg ")[2]}'
        for colour, variable in THEME.items():
            svg = svg.replace(colour, variable)
        return Markup(svg)


def drawn(device, stem, kind, caption, plot, numbers, **looks):
    """Return a `Picture` of a device; the numbers behind it are written under its name."""
    csv = write_csv(device.figures, stem.replace(".", "_"), numbers)
    return Picture(f"{device.name}.{stem}", kind, caption, plot, csv=csv, **looks)


def fill(area, x, low, high, colour, alpha=0.2):
    """Fill the area between two curves."""
    area.fill_between(x, low, high, color=colour, alpha=alpha, lw=0)


def _in_decades(area):
    """Return the area with each of its axes that is logarithmic and has no ticks of its own."""
    axes = (area.xaxis, area.yaxis)
    return [(area, a) for a in axes if a.get_scale() == "log" and a.isDefault_majloc]


def _mark_decades(axis):
    """Mark powers of ten; 1, 2 and 5 times them, or round numbers, where these are few."""
    low, high = axis.get_view_interval()
    axis.set_minor_locator(NullLocator())
    if high < 4 * low:
        axis.set_major_locator(MaxNLocator(4, steps=(1, 2, 5, 10)))
        axis.set_major_formatter(ScalarFormatter())
    else:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
        axis.set_major_formatter(FuncFormatter(_decade))


def _grid_between(area, axis):
    """Draw the lines between powers of ten at once: their own ticks take most of the time."""
    low, high = axis.get_view_interval()
    if high < 4 * low:
        return
    at = LogLocator(subs=range(2, 10)).tick_values(low, high)
    at, ends = at[(at > low) & (at < high)], np.array([0.0, 1.0])
    along = axis is area.xaxis
    lines = [np.column_stack([np.full(2, v), ends][:: 1 if along else -1]) for v in at]
    transform = area.get_xaxis_transform() if along else area.get_yaxis_transform()
    grid = LineCollection(lines, colors=GRID, linewidths=0.3, transform=transform, zorder=0.5)
    grid.set_in_layout(False)
    area.add_collection(grid, autolim=False)


def _decade(value, _):
    digits, _, exponent = f"{value:.0e}".partition("e")
    exponent = int(exponent)
    if exponent in PLAIN:
        return f"{value:g}"
    return f"{digits}·" * (digits != "1") + f"10{superscript(exponent)}"


def entitle(area, marks, titles):
    """Have each mark of a line say what it is when it is pointed at."""
    titled = area.figure.__dict__.setdefault("titles", {})
    marks.set_gid(f"titles{len(titled)}")
    titled[marks.get_gid()] = list(titles)


def write_svg(folder, name, picture):
    """Write a picture as its own file, on white."""
    text = picture.svg.replace("<svg ", '<svg style="background:#ffffff" ', 1)
    with replaced(folder / f"{name}.svg") as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_csv(folder, name, columns):
    """Write the numbers behind a picture; return the file's name.

    Of columns, a dict or a DataFrame, what is None or not a number stays empty.
    """
    table = pa.table({k: pa.array(np.asarray(v), from_pandas=True) for k, v in columns.items()})
    with replaced(folder / f"{name}.csv") as temporary:
        csv.write_csv(text_cells(table), temporary, csv.WriteOptions(quoting_style="needed"))
    return f"{name}.csv"
