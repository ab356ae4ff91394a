"""One area of a picture with its two axes: what is drawn on it, and how it becomes SVG.

The methods are the few that the report's pictures need, named as matplotlib names them. Inside the
area everything is in tenths of a pixel, so that paths are whole numbers.
"""

from dataclasses import dataclass
from html import escape

import numpy as np

from imuloop.report.frame import frame, key
from imuloop.report.paths import (
    FONT,
    INK,
    PAGE,
    ROUND,
    SHADE,
    look,
    marks,
    outline,
    polyline,
    stroke,
)
from imuloop.report.ticks import decade_ticks, linear_ticks

# opacity below which a cell looks empty
PALEST = 0.05
# a mark of an axis needs about this much room, px
ROOM = {("x", "linear"): 70, ("y", "linear"): 30, ("x", "decade"): 36, ("y", "decade"): 20}


@dataclass(frozen=True)
class Handle:
    """How a line or mark looks, for the key: its name, a line's style or a mark at (0, 0)."""

    label: str | None
    style: str
    shape: str = ""


class Axes:
    """An area with two axes.

    Parameters
    ----------
    width, height : float
        Size of the area, px.
    """

    def __init__(self, width, height):
        self.width, self.height = width, height
        self.lines, self.key, self.beside = [], [], False
        # functions of the projection that return SVG: clipped at the edge of the area, and not
        self._inside, self._free = [], []
        self._seen = {"x": [], "y": []}
        self.limits = {"x": None, "y": None}
        self.least = {"x": None, "y": None}
        self._logarithmic = set()
        self._ticks, self.label = {}, {"x": "", "y": ""}
        self.grid_of, self.numbered = {"x", "y"}, {"x", "y"}
        self.shown = True
        # distance of the label of axis y from the area, px
        self.outside = 46

    def plot(
        self,
        x,
        y,
        fmt="-",
        color=INK,
        lw=1.3,
        ls="-",
        ms=5,
        hollow=False,
        label=None,
        alpha=None,
        titles=None,
    ):
        """Draw a line (`fmt` "-"), marks (a letter of `SHAPES`) or both ("-o"); return their look.

        `titles` is what each mark says when it is pointed at.
        """
        x, y = (np.atleast_1d(np.asarray(v, float)) for v in (x, y))
        self._see(x, y)
        faint = "" if alpha is None else f' opacity="{alpha:g}"'
        style, drawn, shape = "", "", fmt.strip("-")
        if "-" in fmt:
            style = f'fill="none"{stroke(color, lw, ls)}{faint}'
            self._inside.append(lambda p: f'<path {style} d="{polyline(*p(x, y))}"/>')
        if shape:
            looks = [look(shape, ms, color) + faint]
            if hollow:
                looks.append(look(shape, ms - 2.4, PAGE))
            path = outline(shape, ms)
            self._free.append(lambda p: marks(*p(x, y), path, looks, titles))
            drawn = "".join(f'<path{each} d="M0 0{path}"/>' for each in looks)
        self.lines.append(Handle(label, style, drawn))
        return self.lines[-1:]

    def loglog(self, x, y, **look):
        """Draw as `plot`, both axes logarithmic."""
        self._logarithmic.add("y")
        return self.semilogx(x, y, **look)

    def semilogx(self, x, y, **look):
        """Draw as `plot`, axis x logarithmic."""
        self._logarithmic.add("x")
        return self.plot(x, y, **look)

    def fill_between(self, x, low, high, color=INK, alpha=0.2):
        """Fill the area between two curves."""
        x, low, high = (np.asarray(v, float) for v in (x, low, high))
        self._see(x, low), self._see(x, high)

        def item(p):
            (px, bottom), (_, top) = p(x, low), p(x, high)
            ends = [np.append(px, px[::-1]), np.append(bottom, top[::-1])]
            keep = np.isfinite(ends).all(axis=0)
            outline = polyline(*(e[keep] for e in ends), "z")
            return f'<path fill="{color}" opacity="{alpha:g}" d="{outline}"/>'

        self._inside.append(item)

    def axvspan(self, start, end, color=SHADE, alpha=1.0, lw=0):
        """Shade the area from x = start to end; both may be arrays, a stretch each."""
        start, end = (np.atleast_1d(np.asarray(v, float)) for v in (start, end))
        edge = stroke(color, lw) if lw else ""

        def item(p):
            left, right = (np.rint(p(v, v)[0]).astype(int).tolist() for v in (start, end))
            tall = round(10 * self.height)
            path = "".join(
                f"M{a} 0h{b - a}v{tall}h{a - b}z" for a, b in zip(left, right, strict=True)
            )
            return f'<path fill="{color}" opacity="{alpha:g}"{edge} d="{path}"/>'

        if len(start):
            self._inside.append(item)

    def axhline(self, y, color=INK, lw=0.8, ls="-"):
        """Draw a level from side to side."""
        self._seen["y"].append([y])
        style, wide = stroke(color, lw, ls), round(10 * self.width)
        self._inside.append(lambda p: f'<path{style} d="M0 {_whole(p([y], [y])[1])}h{wide}"/>')

    def axvline(self, x, color=INK, lw=0.8, ls="-", label=""):
        """Draw an upright from bottom to top, named along its upper end."""
        self._seen["x"].append([x])
        style, tall = stroke(color, lw, ls), round(10 * self.height)
        self._inside.append(lambda p: f'<path{style} d="M{_whole(p([x], [x])[0])} 0v{tall}"/>')
        if label:
            name = (
                f'font-size="{10 * FONT:g}" text-anchor="end">{escape(label, quote=False)}</text>'
            )

            def item(p):
                beside = _whole(p([x], [x])[0]) + 10 * FONT
                return f'<text transform="translate({beside} 30)rotate(-90)" {name}'

            self._free.append(item)

    def flag(self, x, color):
        """Set a triangle at the upper edge."""
        self._seen["x"].append([x])
        path = outline("v", 6)
        self._free.append(
            lambda p: f'<path fill="{color}" d="M{_whole(p([x], [x])[0])} 40{path}"/>'
        )

    def barh(self, place, length, color, height=0.62):
        """Draw bars to the right from 0; `color` has one for each."""
        place, length = (np.asarray(v, float) for v in (place, length))
        self._see(np.zeros(len(place)), place - 0.5), self._see(length, place + 0.5)

        def item(p):
            left, top = p(np.zeros(len(place)), place + height / 2)
            right, bottom = p(length, place - height / 2)
            return "".join(
                f'<path fill="{c}" d="M{a:.0f} {t:.0f}H{b:.0f}V{u:.0f}H{a:.0f}z"/>'
                for c, a, b, t, u in zip(color, left, right, top, bottom, strict=True)
            )

        self._inside.append(item)

    def errorbar(self, x, y, xerr, fmt="o", color=INK, ms=5, lw=1.5):
        """Draw marks with an interval to the left and right."""
        x, y, xerr = (np.asarray(v, float) for v in (x, y, xerr))
        self._see(x - xerr, y), self._see(x + xerr, y)

        def item(p):
            (left, at), (right, _) = p(x - xerr, y), p(x + xerr, y)
            path = "".join(
                f"M{a:.0f} {v:.0f}H{b:.0f}" for a, b, v in zip(left, right, at, strict=True)
            )
            return f'<path{stroke(color, lw)} d="{path}"/>'

        self._inside.append(item)
        return self.plot(x, y, fmt, color=color, ms=ms)

    def cells(self, color, strength, titles):
        """Draw a matrix of squares, row 0 on top.

        Parameters
        ----------
        color, strength, titles : sequence of sequences
            Colour, opacity, and what it says when it is pointed at, of each cell; a cell without
            a colour stays empty.
        """
        count = len(color)
        self.set_xlim(-0.5, count - 0.5)
        self.set_ylim(count - 0.5, -0.5)

        def item(p):
            x, y = (np.rint(v).astype(int) + 4 for v in p(*[np.arange(count) - 0.5] * 2))
            wide, tall = (round(10 * v / count) - 8 for v in (self.width, self.height))
            square = f"h{wide}v{tall}h-{wide}z"
            ground, cells = "", ""
            for i, row in enumerate(zip(color, strength, titles, strict=True)):
                for j, (c, s, t) in enumerate(zip(*row, strict=True)):
                    if c:
                        ground += f"M{x[j]} {y[i]}{square}"
                    if c and s >= PALEST:
                        cells += (
                            f'<path fill="{c}" opacity="{s:.2g}" d="M{x[j]} {y[i]}{square}">'
                            f"<title>{escape(t)}</title></path>"
                        )
            return f'<path fill="{SHADE}" d="{ground}"/>{cells}'

        self._inside.append(item)

    def text(self, x, y, s, ha="left", va="center", color=None, fontsize=FONT, rotation=0):
        """Write a text at a place of the area."""
        anchor = {"left": "", "center": ' text-anchor="middle"', "right": ' text-anchor="end"'}[ha]
        down = {"baseline": 0, "center": 3.6, "top": 8, "bottom": -2.5}[va] * fontsize
        look = anchor + (f' fill="{color}"' if color else "")

        def item(p):
            px, py = _whole(p([x], [y])[0]), _whole(p([x], [y])[1])
            turn = f' transform="rotate({-rotation:g} {px} {py})"' if rotation else ""
            return (
                f'<text x="{px}" y="{py + round(down)}" font-size="{10 * fontsize:g}"{look}{turn}>'
                f"{escape(s, quote=False)}</text>"
            )

        self._free.append(item)

    def legend(self, handles=None, labels=None, beside=False):
        """Name what is drawn, above the area or beside it."""
        known = [h for h in self.lines if h.label]
        handles = known if handles is None else handles
        labels = [h.label for h in known] if labels is None else labels
        self.key, self.beside = list(zip(handles, labels, strict=True)), beside

    def set_xlabel(self, text):
        """Name axis x, with its unit."""
        self.label["x"] = text

    def set_ylabel(self, text):
        """Name axis y, with its unit."""
        self.label["y"] = text

    def set_xlim(self, low, high):
        """Set the limits of axis x."""
        self.limits["x"] = (low, high)

    def set_ylim(self, low, high=None):
        """Set the limits of axis y, or the lower one alone."""
        if high is None:
            self.least["y"] = low
        else:
            self.limits["y"] = (low, high)

    def set_yscale(self, scale):
        """Make axis y logarithmic ("log")."""
        self._logarithmic |= {"y"} if scale == "log" else set()

    def set_xticks(self, places, labels):
        """Set the marks of axis x and what they say."""
        self._ticks["x"] = list(places), list(labels), ""

    def set_yticks(self, places, labels):
        """Set the marks of axis y and what they say."""
        self._ticks["y"] = list(places), list(labels), ""

    def set_axis_off(self):
        """Draw neither axis nor grid, one unit as long in x as in y."""
        self.shown = False

    def _see(self, x, y):
        self._seen["x"].append(x)
        self._seen["y"].append(y)

    def span(self, which):
        """Return the limits of an axis: those set, else of what is drawn with a margin."""
        # limits of what never changes leave no room
        if self.limits[which] and self.limits[which][0] < self.limits[which][1]:
            return self.limits[which]
        logarithmic = which in self._logarithmic
        values = np.concatenate([np.ravel(v) for v in self._seen[which]] or [[0.0, 1.0]])
        values = values[np.isfinite(values) & (values > 0 if logarithmic else True)]
        low, high = (values.min(), values.max()) if len(values) else (1.0, 10.0)
        # what differs by rounding is one value
        wide = high - low > 1e-9 * max(abs(low), abs(high))
        if logarithmic:
            margin = (high / low) ** 0.04 if wide else 2.0
            return low / margin, high * margin
        margin = 0.04 * (high - low) if wide else abs(high) * 0.1 or 1.0
        least = self.least[which]
        return low - margin if least is None else least, high + margin

    def _projection(self):
        """Return the function from data to tenths of a pixel from the upper left corner."""
        ends = []
        for which, size in (("x", self.width), ("y", self.height)):
            low, high = self.span(which)
            scale = np.log10 if which in self._logarithmic else np.asarray
            low, high = scale(low), scale(high)
            ends.append((scale, low, 10 * size / (high - low)))

        def project(x, y):
            with np.errstate(divide="ignore", invalid="ignore"):
                px, py = (
                    (scale(np.asarray(v, float)) - low) * factor
                    for v, (scale, low, factor) in zip((x, y), ends, strict=True)
                )
            return px, 10 * self.height - py

        return project

    def svg(self, left, top, clip):
        """Return the area as SVG, its upper left corner at a place, px; `clip` is an id."""
        project = self._projection()
        around = frame(self, project) if self.shown else ""
        box = f'width="{10 * self.width:g}" height="{10 * self.height:g}"'
        inside = "".join(item(project) for item in self._inside)
        free = "".join(item(project) for item in self._free)
        return (
            f'<g transform="translate({left:g} {top:g})scale(.1)">{around}'
            f'<clipPath id="{clip}"><rect {box}/></clipPath>'
            f'<g clip-path="url(#{clip})" {ROUND}>{inside}</g>{free}{key(self)}'
            "</g>"
        )

    def ticks(self, which):
        """Return places, labels and factor of the marks of an axis."""
        low, high = self.span(which)
        if which in self._ticks:
            return self._ticks[which]
        size = self.width if which == "x" else self.height
        if which in self._logarithmic:
            return decade_ticks(low, high, size / ROOM[which, "decade"])
        return linear_ticks(min(low, high), max(low, high), max(size / ROOM[which, "linear"], 2))


def _whole(values):
    return round(float(values[0]))
