"""matplotlib's SVG as a page takes it: named, marked for the page's script, and small."""

import re
from xml.etree import ElementTree

_LINK = "{http://www.w3.org/1999/xlink}href"
# what the id of a group may mark for the page's script, as ``axis=x``
MARKS = ("area", "axis", "curve", "twin")
# what a page says once of all pictures
_NOT_NEEDED = ("metadata", "style")


def page_svg(text, alt, titles, ink, digits):
    """Return a drawing for a page, without ids, fonts and small parts of a pixel.

    Takes the text of matplotlib's SVG; what those get who cannot see it; by the id of a group the
    title of each of its marks; the colour that is said once for the whole picture; and how many
    digits of a pixel stay.
    """
    root = ElementTree.fromstring(text)
    # what is the same in most elements is said in the first
    common = {"font-size": "11px", "stroke-linecap": "square", "fill": ink}
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    for element in root.iter():
        for child in [c for c in element if c.tag in _NOT_NEEDED]:
            element.remove(child)
        element.tail = None
        if element.text:
            element.text = " ".join(element.text.split()) or None
        if _LINK in element.attrib:
            element.set("href", element.attrib.pop(_LINK))
        if element.tag == "g":
            _mark(element, element.attrib.pop("id", ""), titles)
        if "style" in element.attrib:
            _simplify_style(element, common)
        for key in {"d", "x", "y"} & element.attrib.keys():
            element.set(key, _rounded(element.get(key), digits))
    named = {"role": "img", "aria-label": alt, "fill": ink, "font-size": "11"}
    kept = {k: v for k, v in root.attrib.items() if k not in ("width", "height")}
    root.attrib = named | kept
    return ElementTree.tostring(root, encoding="unicode")


def _mark(group, identity, titles):
    """Keep of the id of a group what it marks; give its marks their titles."""
    name, _, value = identity.partition("=")
    if name in MARKS:
        group.set(f"data-{name}", value)
    if identity in titles:
        marks = (
            e for e in group.iter() if e.tag.endswith(("use", "path")) and "id" not in e.keys()
        )
        for mark, title in zip(marks, titles[identity], strict=True):
            ElementTree.SubElement(mark, "title").text = title


def _simplify_style(element, common):
    """Take from the style of an element what the whole picture says."""
    pairs = (part.partition(": ")[::2] for part in element.attrib.pop("style").split("; "))
    kept = {k: v for k, v in pairs if k != "font-family" and common.get(k) != v}
    if kept:
        element.set("style", "; ".join(f"{key}: {value}" for key, value in kept.items()))


def _rounded(places, digits):
    """Return coordinates with few digits."""
    return re.sub(r"-?\d+\.\d+", lambda number: f"{round(float(number[0]), digits):g}", places)
