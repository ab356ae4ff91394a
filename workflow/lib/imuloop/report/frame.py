"""What surrounds an area: grid, axes, numbers at their marks, labels, and the key."""

from html import escape

from imuloop.report.paths import FONT, GRID, width_of


def frame(area, project):
    """Return grid, axes, the numbers at their marks and the labels."""
    wide, tall = round(10 * area.width), round(10 * area.height)
    grid, texts = "", ""
    for which in "xy":
        places, labels, factor = area.ticks(which)
        at = project(places, places)["xy".index(which)]
        at = [round(v) for v in at]
        if which in area.grid_of:
            grid += "".join(f"M{v} 0v{tall}" if which == "x" else f"M0 {v}h{wide}" for v in at)
        if which not in area.numbered:
            continue
        numbers = "".join(
            f'<text x="{v}" y="{tall + 150}">{escape(t, quote=False)}</text>'
            if which == "x"
            else f'<text x="-60" y="{v + 38}">{escape(t, quote=False)}</text>'
            for v, t in zip(at, labels, strict=True)
        )
        anchor = "middle" if which == "x" else "end"
        texts += f'<g text-anchor="{anchor}">{numbers}</g>'
        if factor:
            x, y = (wide, tall - 30) if which == "x" else (40, 90)
            end = ' text-anchor="end"' if which == "x" else ""
            texts += f'<text x="{x}" y="{y}"{end}>{factor}</text>'
    if area.label["x"] and "x" in area.numbered:
        texts += (
            f'<text x="{wide // 2}" y="{tall + 330}" text-anchor="middle">'
            f"{escape(area.label['x'], quote=False)}</text>"
        )
    if area.label["y"]:
        texts += (
            f'<text transform="translate(-{round(10 * area.outside)} {tall // 2})rotate(-90)" '
            f'text-anchor="middle">{escape(area.label["y"], quote=False)}</text>'
        )
    return (
        f'<path fill="none" stroke="{GRID}" stroke-width="6" d="{grid}"/>'
        f'<path fill="none" stroke="{GRID}" stroke-width="10" d="M0 0v{tall}h{wide}"/>'
        f'<g font-size="{10 * FONT}">{texts}</g>'
    )


def key(area):
    """Return the key: a look and a word each, from the right end, or one below the other."""
    parts, right = [], round(10 * area.width)
    for place, (handle, label) in enumerate(reversed(area.key)):
        if area.beside:
            x, y = right + 420, 80 + 170 * (len(area.key) - 1 - place)
            look, anchor = x - 300, ""
        else:
            x, y = right, -110
            look, anchor = x - round(10 * width_of(label, 10)) - 200, ' text-anchor="end"'
            right = look - 110
        line = f'<path {handle.style} d="M-85 0h170"/>' if handle.style else ""
        parts.append(
            f'<g transform="translate({look + 85} {y})">{line}{handle.shape}</g>'
            f'<text x="{x}" y="{y + 36}"{anchor}>{escape(label, quote=False)}</text>'
        )
    return f'<g font-size="100">{"".join(parts)}</g>' if parts else ""
