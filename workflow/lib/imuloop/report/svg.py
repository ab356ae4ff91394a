"""Pictures as inline SVG: same bytes each time, colours that follow the page, ids of their own."""

from dataclasses import dataclass
from html import escape
from zlib import crc32

import pyarrow as pa
from markupsafe import Markup
from pyarrow import csv

from imuloop.core.cells import text_cells
from imuloop.core.files import replaced
from imuloop.report.axes import Axes
from imuloop.report.paths import GRID, INK, PAGE, SHADE

# colours that are told apart with any colour vision; the page defines a pair for each
PALETTE = tuple(f"var(--c{i})" for i in range(7))
BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, YELLOW = PALETTE
# colours of the axes x, y, z in every picture
AXES = (BLUE, VERMILLION, GREEN)
# the colours of a picture without a page: those of the light one
_ALONE = {
    INK: "#1b1f24",
    GRID: "#c8ced6",
    SHADE: "#eef1f4",
    PAGE: "#ffffff",
    BLUE: "#0244af",
    VERMILLION: "#b13311",
    GREEN: "#048e8b",
    PURPLE: "#c369cf",
    ORANGE: "#d87d15",
    SKY: "#4e90ff",
    YELLOW: "#937851",
}
# room that a key above an area needs, px
KEY = 26


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


def draw(
    name,
    alt,
    width,
    height,
    plot,
    margins=(58, 12, 12, 40),
    rows=(1,),
    columns=(1,),
    gap=(14, 10),
    sharex=False,
    sharey=False,
):
    """Return a drawing as inline SVG.

    Parameters
    ----------
    name : str
        Unique in the page; the drawing's ids are made from it.
    alt : str
        What the drawing shows, for who cannot see it.
    width, height : float
        Size, px; a key above the areas adds to it.
    plot : callable
        Draws on the `Axes`, or on the list of them, row by row, that it is given.
    margins : tuple of float
        Left, right, top and bottom, px.
    rows, columns : tuple of float
        Relative heights and widths of the areas.
    gap : tuple of float
        Between areas beside and below each other, px.
    sharex, sharey : bool
        Whether areas below (beside) each other have the same limits; only the last (first) then
        has numbers.

    Returns
    -------
    Markup
        The `svg` element.
    """
    left, right, top, bottom = margins
    wide = width - left - right - gap[0] * (len(columns) - 1)
    tall = height - top - bottom - gap[1] * (len(rows) - 1)
    widths = [wide * c / sum(columns) for c in columns]
    heights = [tall * r / sum(rows) for r in rows]
    areas = [[Axes(w, h) for w in widths] for h in heights]
    flat = [a for row in areas for a in row]
    plot(flat if len(flat) > 1 else flat[0])
    if sharex:
        for column in zip(*areas, strict=True):
            _share("x", column, column[-1])
    if sharey:
        for row in areas:
            _share("y", row, row[0])
    if any(a.key and not a.beside for a in flat) and top < KEY:
        top, height = KEY, height + KEY - top
    drawn, y = "", top
    short = f"p{crc32(name.encode()):08x}"
    for row in areas:
        x = left
        for area in row:
            area.outside = left - 12 if area is row[0] else area.outside
            drawn += area.svg(round(x, 1), round(y, 1), f"{short}.{flat.index(area)}")
            x += area.width + gap[0]
        y += row[0].height + gap[1]
    return Markup(
        f'<svg viewBox="0 0 {width:g} {height:g}" fill="currentColor" role="img" '
        f'aria-label="{escape(alt)}">{drawn}</svg>'
    )


def _share(which, areas, numbered):
    """Give areas the same limits; only one keeps its numbers."""
    spans = [a.span(which) for a in areas]
    for area in areas:
        area.limits[which] = min(s[0] for s in spans), max(s[1] for s in spans)
        if area is not numbered:
            area.numbered = area.numbered - {which}


def write_svg(folder, name, picture):
    """Write a picture as a file of its own, on white, in colours that need no page."""
    text = str(picture.svg)
    for variable, colour in _ALONE.items():
        text = text.replace(variable, colour)
    head = 'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" style="background:#ffffff"'
    text = text.replace("<svg ", f"<svg {head} ", 1)
    with replaced(folder / f"{name}.svg") as temporary:
        temporary.write_text(text + "\n", encoding="utf-8", newline="\n")


def write_csv(folder, name, columns):
    """Write the numbers behind a picture; return the file's path from the report's folder.

    Parameters
    ----------
    folder : Path
        Where to.
    name : str
        The file's, without its ending.
    columns : dict of str to sequence
        A column each; what is None or not a number stays empty.
    """
    table = pa.table({k: pa.array(v, from_pandas=True) for k, v in columns.items()})
    with replaced(folder / f"{name}.csv") as temporary:
        csv.write_csv(text_cells(table), temporary, csv.WriteOptions(quoting_style="needed"))
    return f"{folder.parent.name}/{folder.name}/{name}.csv"
