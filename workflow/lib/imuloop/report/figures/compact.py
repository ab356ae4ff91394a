"""A drawing of matplotlib as an element of a page, smaller than its SVG file."""

import re

# parts of a drawing that show nothing, or that the page has once for all drawings
NOTHING = re.compile(
    r"<metadata>.*?</metadata>|<style.*?</style>|(?<=<g) id=\"[^\"]*\"|"
    r" transform=\"rotate\(-0[^\"]*\"|(?<=>)\s+(?=<)",
    re.DOTALL,
)
# properties that the page gives to every text, and the drawing's root to every line
GIVEN = re.compile(r"font-size: 12px; font-family: [^;]*; |; fill: #1b1f24|fill: none; ")
EMPTY = re.compile(r"<g/>|<g></g>|<defs></defs>|<path d=\"[^\"]*\" style=\"fill: none\"/>")
# a group with one child
ALONE = re.compile(r"<g>(<(?:path|text|use)[^<]*(?:/>|</text>))</g>")


def compact(svg):
    """Return the content of an SVG drawing as short text, without the tags of its root element.

    `svg` is the text of the drawing as matplotlib writes it. What the page sets for all drawings,
    such as the font, is left out. Coordinates are rounded to a tenth of a pixel.
    """
    svg = GIVEN.sub("", NOTHING.sub("", svg)).replace("xlink:href", "href")
    svg = re.sub(r' d="([^"]*)"', lambda match: f' d="{relative(match[1])}"', svg)
    svg = re.sub(r'( (?:x|y)="-?\d+\.\d)\d*', r"\1", svg)
    for _ in range(3):
        svg = ALONE.sub(r"\1", EMPTY.sub("", svg))
    return svg.partition("<svg ")[2].partition(">")[2]


def relative(path):
    """Return the data of an SVG path in which each point is relative to the point before it.

    `path` is the data with absolute points, the text of the attribute ``d``.
    """
    parts, last = [], (0, 0)
    for letter, numbers in re.findall("([A-Zz])([^A-Zz]*)", path):
        values, start, words = [round(10 * float(v)) for v in numbers.split()], last, ""
        for point in zip(values[::2], values[1::2], strict=True):
            words += "".join(f" {(a - b) / 10:g}" for a, b in zip(point, start, strict=True))
            last = point
        parts.append(letter.lower() + words.replace(" -", "-").lstrip())
    return "".join(parts)
