"""Lines and marks as SVG: whole numbers in tenths of a pixel, colours of the page."""

from html import escape

import numpy as np

# text and axes, grid, faint fill, ground: the page's own colours, light or dark
INK, GRID, SHADE, PAGE = "currentColor", "var(--grid)", "var(--shade)", "var(--page)"
DASHES = {"-": "", "--": "50 28", ":": "12 24"}
# outline of a mark about its place; d its size, r the half and h the quarter of it; a disc is a
# line of no length with round ends
SHAPES = {
    "o": "h0",
    "s": "m-{r}-{r}h{d}v{d}h-{d}z",
    "^": "m0-{r}l{r} {d}h-{d}z",
    "v": "m0 {r}l{r}-{d}h-{d}z",
    "D": "m0-{r}l{r} {r}l-{r} {r}l-{r}-{r}z",
    "p": "m-{r} 0l{r}-{r}l{r} {r}l-{h} {r}h-{r}z",
}
ROUND = 'stroke-linecap="round"'
FONT = 11


def integers(values):
    """Return whole numbers as an SVG path has them, without blanks that nothing needs."""
    return " ".join(map(str, values)).replace(" -", "-")


def polyline(x, y, end=""):
    """Return the path through points, rounded; it is broken where one is not a number.

    Places are rounded before their differences are taken, so that no error adds up.
    """
    points = np.column_stack([x, y])
    known = np.isfinite(points).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known, [0]])))
    text = ""
    for first, last in edges.reshape(-1, 2):
        part = np.rint(points[first:last]).astype(np.int64)
        steps = np.diff(part, axis=0)
        steps = steps[steps.any(axis=1)]
        # a lone point is a line of no length, which round ends show
        path = integers(steps.ravel().tolist() or [0, 0])
        text += f"M{integers(part[0].tolist())}l{path}{end}"
    return text


def width_of(text, size=FONT):
    """Return about how wide a text is, px; rather too wide than too narrow."""
    narrow = sum(c in "ijlt1.,:;'|!()[] \u202f·" for c in text)
    return size * (0.67 * len(text) - 0.3 * narrow)


def stroke(color, lw, ls="-"):
    """Return the style of a line; `ls` as in `DASHES`."""
    dash = f' stroke-dasharray="{DASHES[ls]}"' if DASHES[ls] else ""
    return f' stroke="{color}" stroke-width="{10 * lw:g}"{dash}'


def look(shape, size, color):
    """Return the style of a mark."""
    return f"{stroke(color, size)} {ROUND}" if shape == "o" else f' fill="{color}"'


def outline(shape, size):
    """Return the outline of a mark, from its place on."""
    r = round(5 * size)
    return SHAPES[shape].format(r=r, d=2 * r, h=r // 2)


def marks(x, y, path, looks, titles):
    """Return marks: one path for each look, or one a mark where they have something to say."""
    keep = np.isfinite(x) & np.isfinite(y)
    places = [f"M{a:.0f} {b:.0f}{path}" for a, b in zip(x[keep], y[keep], strict=True)]
    if titles is None:
        return "".join(f'<path{look} d="{"".join(places)}"/>' for look in looks)
    said = [escape(t) for t, k in zip(titles, keep, strict=True) if k]
    each = "".join(
        f'<path d="{d}"><title>{t}</title></path>' for d, t in zip(places, said, strict=True)
    )
    return "".join(f"<g{look}>{each}</g>" for look in looks)
