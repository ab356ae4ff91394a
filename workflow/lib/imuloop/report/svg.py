"""Pictures as inline SVG: same bytes each time, colours that follow the page, ids of their own."""

import io
import math
import re
import warnings
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from zlib import crc32

import matplotlib
from markupsafe import Markup
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from imuloop.report.numbers import superscript

# text and axes, grid, faint fill: replaced by the page's own colours, light or dark
INK, GRID, SHADE = "#010101", "#020202", "#030303"
# Okabe and Ito's colours, told apart with any colour vision; the page defines a pair for each
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")
BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, YELLOW = PALETTE
# colours of the axes x, y, z in every picture
AXES = (BLUE, VERMILLION, GREEN)

_VARIABLES = {INK: "currentColor", GRID: "var(--grid)", SHADE: "var(--shade)"} | {
    color: f"var(--c{i})" for i, color in enumerate(PALETTE)
}
_STYLE = {
    "svg.fonttype": "none",
    # labels are other people's text: a dollar sign is a dollar sign
    "text.parse_math": False,
    "font.size": 11,
    "text.color": INK,
    "axes.edgecolor": GRID,
    "axes.labelcolor": INK,
    "axes.linewidth": 1.0,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.unicode_minus": True,
    "axes.formatter.use_mathtext": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": GRID,
    "ytick.color": GRID,
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "lines.linewidth": 1.3,
}


@dataclass(frozen=True)
class Picture:
    """A picture of the report.

    Attributes
    ----------
    name : str
        Name of the picture, unique in the report.
    svg : Markup
        The drawing.
    caption : str
        What it says, in a sentence made from the data.
    note : str
        One line for who has never seen such a picture.
    csv : tuple of str
        Paths of the numbers behind it, from the report's folder.
    wide : bool
        Whether it takes the full width of the page.
    """

    name: str
    svg: Markup
    caption: str
    note: str
    csv: tuple[str, ...]
    wide: bool = False


def draw(name, alt, width, height, plot, margins=(58, 12, 12, 40), rows=1, columns=1, **subplots):
    """Return a drawing as inline SVG.

    Parameters
    ----------
    name : str
        Unique in the page; the drawing's ids begin with it.
    alt : str
        What the drawing shows, for who cannot see it.
    width, height : float
        Size, px.
    plot : callable
        Draws on the axes (one, or an array of rows × columns) that it is given.
    margins : tuple of float
        Left, right, top and bottom, px.
    rows, columns : int
        Number of axes.
    **subplots
        More for `Figure.subplots`.

    Returns
    -------
    Markup
        The `svg` element.
    """
    left, right, top, bottom = margins
    with matplotlib.rc_context({**_STYLE, "svg.hashsalt": name}), warnings.catch_warnings():
        figure = Figure(figsize=(width / 72, height / 72))
        FigureCanvasSVG(figure)
        figure.patch.set_visible(False)
        axes = figure.subplots(rows, columns, **subplots)
        figure.subplots_adjust(
            left / width, bottom / height, 1 - right / width, 1 - top / height, 0.3, 0.12
        )
        for ax in [axes] if rows * columns == 1 else axes.flat:
            ax.patch.set_visible(False)
        plot(axes)
        text = io.StringIO()
        # a letter that the layout's font lacks is drawn by the browser's
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        none = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(text, format="svg", metadata=none)
    return Markup(_inline(text.getvalue(), name, alt))


def _inline(text, name, alt):
    """Return an SVG document as an element for a page: see the module's first line."""
    root = ET.fromstring(text)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag.endswith(("}metadata", "}style")):
                parent.remove(child)
    # in a picture its ids stand at every line: a name of eight letters does
    short = f"p{crc32(name.encode()):08x}"
    referred = set(re.findall(r"#([\w.-]+)[\")]", text))
    names = {}
    for element in root.iter():
        element.tag = element.tag.partition("}")[2]
        attributes = {k.partition("}")[2] or k: v for k, v in element.attrib.items()}
        identity = attributes.pop("id", None)
        if identity in referred:
            attributes["id"] = names.setdefault(identity, f"{short}.{len(names)}")
        element.attrib.clear()
        element.attrib.update(attributes)
    for element in root.iter():
        for key, value in element.attrib.items():
            element.set(key, _attribute(key, value, names))
        if " ".join(element.get("transform", "").split()).startswith("rotate(0 "):
            del element.attrib["transform"]
        element.text = element.text if element.tag == "text" else None
        element.tail = None
    _lighten(root)
    for key in ("width", "height", "version"):
        root.attrib.pop(key, None)
    root.set("role", "img")
    root.set("aria-label", alt)
    return ET.tostring(root, encoding="unicode")


def _lighten(root):
    """Take out groups that say nothing; say once what all marks of a group have in common."""
    for parent in reversed(list(root.iter())):
        # from the inside out, so that what a group held is light already
        parent[:] = [
            kept
            for child in parent
            for kept in (child if child.tag == "g" and not child.attrib else [child])
            if len(kept) or kept.tag not in ("g", "defs")
        ]
        marks = parent.findall("use")
        looks = {mark.get("style") for mark in marks}
        if len(marks) > 1 and len(looks) == 1 and None not in looks and not parent.get("style"):
            parent.set("style", looks.pop())
            for mark in marks:
                del mark.attrib["style"]


def _attribute(key, value, names):
    """Return an attribute's value: new ids, colours of the page, tenths of a pixel."""
    if key == "href":
        return f"#{names[value[1:]]}"
    if key == "clip-path":
        return f"url(#{names[value[5:-1]]})"
    if key == "style":
        value = re.sub(r"font-family:[^;]*; ?", "", value)
        value = re.sub(r"#[0-9a-f]{6}", lambda m: _VARIABLES.get(m[0], m[0]), value)
        return re.sub(r"([:;]) ", r"\1", value)
    if key == "d" and not set("CQ") & set(value):
        return _steps(value)
    if key in ("d", "x", "y", "width", "height", "transform"):
        value = re.sub(r"-?\d+\.\d+", lambda m: f"{float(m[0]):.1f}".removesuffix(".0"), value)
        value = " ".join(value.replace("-0 ", "0 ").split())
    return value


def _steps(path):
    """Return a path of straight lines as steps from point to point, half as long.

    Places are rounded before their differences are taken, so that no error adds up.
    """
    words = iter(path.split())
    text, last, here, start = "", "z", (0, 0), (0, 0)
    for command in words:
        if command == "z":
            text, last, here = text + "z", "z", start
            continue
        there = round(10 * float(next(words))), round(10 * float(next(words)))
        letter = "m" if command == "M" else "l" if last == "z" else ""
        numbers = "".join(_tenths(b - a) for a, b in zip(here, there, strict=True))
        text += letter + numbers.removeprefix(" ") if letter else numbers
        last, here = command, there
        start = there if command == "M" else start
    return text


def _tenths(count):
    """Return a number of tenths as a path has it, with the blank or sign that parts it."""
    whole, tenth = divmod(abs(count), 10)
    return f"{'-' if count < 0 else ' '}{whole or ''}{f'.{tenth}' if tenth else '' if whole else 0}"


def decades(axis):
    """Mark the powers of ten of a logarithmic axis; where it spans few, also 2 and 5 times them."""
    axis.axes.autoscale_view()
    low, high = axis.get_view_interval()

    def label(value, _):
        exponent = math.floor(math.log10(value) + 1e-9)
        digit = round(value / 10.0**exponent)
        return f"{digit}·" * (digit > 1) + f"10{superscript(exponent)}"

    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,), numticks=12))
    axis.set_major_formatter(FuncFormatter(label))
    axis.set_minor_locator(NullLocator())


def write_csv(folder, name, frame):
    """Write the numbers behind a picture; return the file's path from the report's folder."""
    frame.to_csv(folder / f"{name}.csv", index=False, float_format="%.9g", lineterminator="\n")
    return f"{folder.parent.name}/{folder.name}/{name}.csv"
