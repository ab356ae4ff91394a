"""Draw how to record, and the method: ``python docs/drawings.py`` writes the drawings next to it.

Each drawing has its own background, so that it is readable on a light and on a dark page.
"""

from itertools import product
from pathlib import Path

import numpy as np

from imuloop.core.rotation import exponential, matrix, shortest_turn
from imuloop.plan.advice import FULL_TURN_S, INITIAL_REST_S, MOVE_S, POSES, REST_S
from imuloop.plan.directions import largest_hole

STYLE = """
  .ground { fill: #f6f8fa; stroke: #d0d7de }
  .ink { fill: #1b1f24 } .soft { fill: #57606a } .line { stroke: #57606a; fill: none }
  .rest { fill: #0f66b8 } .turn { fill: #b14a00 } .arrow { stroke: #b14a00; fill: none }
  .good { stroke: #00664b; fill: none } .mark { fill: #0f66b8 } .side { stroke: #1b1f24 }
  .a { fill: #cfe0f2 } .b { fill: #9fc1e4 } .c { fill: #6f9fd0 }
  @media (prefers-color-scheme: dark) {
    .ground { fill: #1d232a; stroke: #39424c }
    .ink { fill: #e4e8ec } .soft { fill: #a3adb8 } .line { stroke: #a3adb8 }
    .rest { fill: #6cb2f5 } .turn { fill: #f0883e } .arrow { stroke: #f0883e }
    .good { stroke: #4fd1a5 } .mark { fill: #6cb2f5 } .side { stroke: #e4e8ec }
    .a { fill: #4b6a8c } .b { fill: #3a5573 } .c { fill: #2b425c }
  }"""
# half edges of the box that is drawn, px, along its x, y, z
BOX = np.array([34.0, 22.0, 13.0])
# seen from a little to the right and above: rows are right, up and towards the reader
LOOK = matrix(exponential([np.radians(22), 0, 0])) @ matrix(exponential([0, np.radians(-28), 0]))
FACES, EDGES, CORNERS = (
    np.array([v for v in product((-1, 0, 1), repeat=3) if np.abs(v).sum() == n]) for n in (1, 2, 3)
)


def text(x, y, words, css="ink", anchor="middle", size=14):
    """Return a line of text."""
    return (
        f'<text class="{css}" x="{x:g}" y="{y:g}" text-anchor="{anchor}" '
        f'font-size="{size}">{words}</text>'
    )


def path(points, css, width=2, head=""):
    """Return a line through points; ``head`` marks its ends."""
    d = "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path class="{css}" d="{d}" stroke-width="{width}"{head}/>'


def seen(points, at):
    """Return where points of the room (right, up, towards the reader) are drawn."""
    return np.asarray(points) @ LOOK[:2].T * [1, -1] + at


def box(at, up, half=BOX, axes=True):
    """Return a box at a place, with a direction of its body axes up.

    Without rotation body x is right in the room, y away from the reader and z up.
    """
    room = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    turned = room @ matrix(exponential(shortest_turn([0, 0, 1.0], up)))
    drawn = []
    for normal in FACES:
        towards = LOOK[2] @ turned @ normal
        if towards <= 0:
            continue
        i = np.abs(normal).argmax()
        j, k = (i + 1) % 3, (i + 2) % 3
        corners = np.tile(normal * half, (4, 1)).astype(float)
        corners[:, j] = half[j] * np.array([-1, 1, 1, -1])
        corners[:, k] = half[k] * np.array([-1, -1, 1, 1])
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in seen(corners @ turned.T, at))
        drawn.append(f'<polygon class="side {"abc"[i]}" points="{points}"/>')
        if axes:
            (x, y), sign = seen((turned @ (normal * half))[None], at)[0], "−+"[int(normal[i] > 0)]
            drawn.append(text(x, y + 4, f"{sign}{'xyz'[i]}", size=12))
    return "".join(drawn)


def upward(x, y, length=26):
    """Return an arrow up from a place."""
    return path([(x, y), (x, y - length)], "arrow", 2.5, ' marker-end="url(#head)"')


def session():
    """Return the course of a multi-position session."""
    drawn, x, base = [], 24.0, 96
    drawn.append(f'<rect class="rest" x="{x}" y="{base - 8}" width="190" height="8"/>')
    drawn.append(text(x + 95, base - 20, f"{INITIAL_REST_S:g} s: do not touch", "rest"))
    x += 190
    for _ in range(8):
        top = [(x + 26 * s, base - 58 * np.sin(np.pi * s) ** 2) for s in np.linspace(0, 1, 21)]
        drawn.append(path([*top, (x + 26, base), (x, base)], "turn", 0))
        drawn.append(f'<rect class="rest" x="{x + 26:g}" y="{base - 8}" width="40" height="8"/>')
        x += 66
    drawn.append(text(x + 24, base, "…", size=22))
    drawn.append(path([(18, base), (796, base)], "line", 1.5, ' marker-end="url(#tip)"'))
    drawn.append(text(119, base + 24, "first rest", "soft"))
    words = (
        f"turn, {MOVE_S:g} s or so – rest, {REST_S:g} s or more – turn … about {POSES} attitudes"
    )
    drawn.append(text(490, base + 24, words, "soft"))
    drawn.append(text(214, 26, "height: how fast it turns", "soft", "start", 13))
    minutes = (INITIAL_REST_S + POSES * (REST_S + MOVE_S)) / 60
    title = f"Course of a multi-position session, {minutes:.0f} minutes at least"
    about = (
        f"A first rest of {INITIAL_REST_S:g} s, then turns of about {MOVE_S:g} s and rests of "
        f"{REST_S:g} s or more take turns, until about {POSES} attitudes are covered."
    )
    return title, about, 820, 140, drawn


def attitudes():
    """Return faces, edges and corners, and how they cover the sphere."""
    drawn = []
    named = (
        (95, (0, 0, 1), f"{len(FACES)} faces"),
        (260, (0, -0.7, 0.7), f"{len(EDGES)} edges"),
        (425, (0.5, -0.6, 0.6), f"{len(CORNERS)} corners"),
    )
    for x, up, words in named:
        drawn += [box((x, 116), up), upward(x, 62), text(x, 196, words)]
    drawn.append(text(260, 222, "stand it on each, leaning on a book, each of them up", "soft"))
    corner = np.concatenate(
        [d / np.linalg.norm(d, axis=1)[:, None] for d in (FACES, EDGES, CORNERS)]
    )
    more_up = corner
    while len(more_up) < POSES:
        more_up = np.vstack([more_up, largest_hole(more_up)[0]])
    between = more_up[len(corner) :]
    for x, up, words, more in (
        (590, more_up, "good: all over", f"{len(between)} more between"),
        (735, FACES[FACES[:, 2] >= 0], "too few: faces,", "and one half only"),
    ):
        drawn.append(f'<circle class="line" cx="{x}" cy="110" r="56" stroke-width="1.5"/>')
        for u in up @ LOOK.T:
            px, py = x + 56 * u[0], 110 - 56 * u[1]
            css = 'class="mark"' if u[2] >= 0 else 'class="mark" opacity="0.3"'
            drawn.append(f'<circle {css} cx="{px:.1f}" cy="{py:.1f}" r="4"/>')
        drawn += [text(x, 196, words), text(x, 222, more, "soft")]
    drawn.append(text(662, 32, "side that was up, on a sphere (pale: behind)", "soft"))
    about = (
        f"A box with one of its {len(FACES)} faces, {len(EDGES)} edges and {len(CORNERS)} corners "
        f"up. Beside it two spheres: with {len(between)} attitudes more in between, the "
        "directions that were up cover all of it; five faces leave most of it empty."
    )
    return f"About {POSES} attitudes all over the sphere", about, 820, 240, drawn


def turns():
    """Return turns about each axis, both ways, with the axis level."""
    drawn = []
    for i, (x, axis) in enumerate(zip((135, 405, 675), "xyz", strict=True)):
        half = np.roll(BOX, -i)
        room = np.array([x, 92.0])
        drawn.append(path(seen([[-100, 0, 0], [100, 0, 0]], room), "line", 1.5))
        drawn.append(box(room, (0, 0, 1), half, axes=False))
        angle = np.radians(np.linspace(-50, 230, 60))
        ring = np.stack([np.full(60, 68.0), 34 * np.sin(angle), 34 * np.cos(angle)], axis=1)
        ends = ' marker-start="url(#head)" marker-end="url(#head)"'
        drawn.append(path(seen(ring, room), "arrow", 2.5, ends))
        end = seen([[112, 0, 0]], room)[0]
        drawn += [text(*end, axis, size=16), text(x, 176, f"about {axis}, {axis} level")]
    words = f"a full turn in {FULL_TURN_S:g} s or more, and back; some fast, some slow"
    drawn.append(text(405, 204, words, "soft"))
    about = (
        "A box turned about its x, y and z axis in turn, the axis level each time, with an arrow "
        "that has a head at both ends."
    )
    return "Turns both ways about each axis", about, 820, 220, drawn


def faces():
    """Return the six faces in turn."""
    drawn = []
    for i, up in enumerate(FACES[[5, 0, 4, 1, 3, 2]]):
        x = 75 + 134 * i
        drawn.append(path([(x - 56, 140), (x + 56, 140)], "line", 2))
        j = np.abs(up).argmax()
        drawn += [box((x, 134 - BOX[j] - 12), up), upward(x, 50 if j else 34, 20)]
        drawn.append(text(x, 168, f"{'−+'[int(up[j] > 0)]}{'xyz'[j]} up"))
    about = "A box on a level table with +x, −x, +y, −y, +z and −z up in turn."
    return "Six faces on a level table, ten seconds each", about, 820, 188, drawn


def static():
    """Return where to lay a device for a night."""
    drawn = []
    for x, words, what in (
        (205, "good: on a stone slab or the floor,", "taped, at an even temperature, alone"),
        (615, "not: on a desk that somebody uses,", "by a fan, in the sun, on its cable"),
    ):
        heavy = x < 400
        drawn.append(box((x, 62), (0, 0, 1), BOX * 0.8, axes=False))
        high, wide = (44, 260) if heavy else (8, 220)
        drawn.append(
            f'<rect class="side c" x="{x - wide / 2:g}" y="84" width="{wide}" height="{high}"/>'
        )
        if not heavy:
            for leg in (x - 96, x + 96):
                drawn.append(path([(leg, 92), (leg, 128)], "line", 4))
            for k in range(3):
                wave = [(x + 64 + 12 * k, 40), (x + 70 + 12 * k, 54), (x + 64 + 12 * k, 68)]
                drawn.append(path(wave, "arrow", 2))
        drawn.append(path([(x - 150, 128), (x + 150, 128)], "line", 2))
        drawn += [text(x, 154, words), text(x, 174, what, "soft")]
    about = (
        "Left, good: the device lies on a heavy slab on the floor. Right, bad: it lies on a light "
        "desk that shakes, with a draught from the side."
    )
    return "Where to lay a device for hours", about, 820, 192, drawn


def temperature():
    """Return a good and a bad course of temperature."""
    drawn = []
    for x, course, words, css in (
        (60, [0, 1, 0, 1, 0], "good: each temperature comes four times", "good"),
        (460, [0, 0.45, 0.7, 0.85, 0.93], "not: what only rises is time", "arrow"),
    ):
        drawn.append(path([(x, 24), (x, 118), (x + 300, 118)], "line", 1.5))
        share = np.linspace(0, 4, 81)
        high = np.interp(share, range(5), course)
        drawn.append(path(np.stack([x + 8 + share * 68, 108 - high * 74], axis=1), css, 3))
        drawn.append(text(x - 8, 30, "°C", "soft", "end"))
        drawn.append(text(x + 300, 136, "time", "soft", "end"))
        drawn.append(text(x + 140, 160, words))
    about = (
        "Left, good: the temperature rises and falls twice within one record. Right, bad: it only "
        "rises."
    )
    return "Heat and cool, twice, within one record", about, 820, 178, drawn


def held_out():
    """Return the drawing of the choice of an effect: ten parts, and errors next to the floor."""
    drawn = [text(24, 30, "ten parts of a recording", "soft", "start")]
    for part in range(10):
        css = "turn" if part == 7 else "rest"
        drawn.append(f'<rect class="{css}" x="{24 + 42 * part}" y="42" width="36" height="26"/>')
    drawn += [
        text(24, 92, "nine: fit, and search for effects", "rest", "start"),
        text(442, 92, "the tenth is predicted", "turn", "end"),
        path([(452, 55), (512, 55)], "line", 2, ' marker-end="url(#tip)"'),
        text(524, 52, "held-out error, over all ten:", "soft", "start"),
        text(524, 72, "before (no effect), after (effects added)", "soft", "start"),
    ]
    floor, tall = 206, 80
    # heights of the error before and after above the floor, as shares: a picture, not data
    for x, (before, after), verdict in (
        (120, (0, None), "consistent"),
        (310, (1, 0), "explained"),
        (500, (1, 0.45), "partly explained"),
        (690, (1, None), "unexplained"),
    ):
        for at, share, words in ((-36, before, "before"), (36, after, "after")):
            css, high = ("side c", "side a")[words == "after"], 22 + tall * (share or 0)
            shown = share is not None
            if shown:
                drawn.append(
                    f'<rect class="{css}" x="{x + at - 20:g}" y="{floor + 22 - high:g}" width="40" '
                    f'height="{high:g}"/>'
                )
            named = words if shown else "nothing added"
            drawn.append(text(x + at, floor + 40, named, "soft", size=12))
        drawn.append(text(x, floor + 66, verdict))
    drawn.append(
        f'<path class="good" d="M40 {floor}H770" stroke-width="2" stroke-dasharray="7 5"/>'
    )
    drawn.append(text(776, floor + 5, "floor", "soft", "start", 13))
    about = (
        "Ten parts of a recording: the fit and the search for effects see nine of them, and the "
        "tenth is predicted. Below, the held-out error before and after, next to the floor of the "
        "noise: at the floor with no effect is consistent; at the floor after effects were added "
        "is explained; lower, but above it, is partly explained; above it with nothing added is "
        "unexplained."
    )
    return "How an effect is chosen, and the meaning of the verdicts", about, 820, 290, drawn


def sensor_model():
    """Return the errors of the sensor model, one panel each, with the equation above them."""
    drawn = [text(410, 36, "x = T · ( K · ( raw − b ) − e )", size=20)]
    centers = (90, 250, 410, 570, 730)
    names = ("bias b", "scale factor K", "misalignment T", "g-sensitivity, in e", "lever arm, in e")
    meanings = (
        "output at zero input",
        "input per output",
        "axes not square",
        "gyroscope reads a rate",
        "axes in different places",
    )
    seconds = ("", "", "", "at rest, by attitude", "feel a rotation differently")
    for lines in zip(centers, names, meanings, seconds, strict=True):
        x, name, meaning, second = lines
        drawn += [text(x, 216, name), text(x, 238, meaning, "soft", size=12)]
        drawn.append(text(x, 256, second, "soft", size=12))
    tip, head = ' marker-end="url(#tip)"', ' marker-end="url(#head)"'
    # output over input: the ideal sensor is dashed
    for x, offset, slope in ((centers[0], 34, 1), (centers[1], 0, 1.45)):
        drawn.append(path([(x - 60, 128), (x + 60, 128)], "line", 1.5, tip))
        drawn.append(path([(x, 190), (x, 66)], "line", 1.5, tip))
        drawn.append(path([(x - 50, 178), (x + 50, 78)], "good", 2, ' stroke-dasharray="6 4"'))
        ends = [(x + run, 128 - offset - slope * run) for run in (-36, 28)]
        drawn.append(path(ends, "arrow", 3))
        drawn += [text(x + 58, 146, "input", "soft", "end", 12)]
        drawn.append(text(x - 6, 74, "output", "soft", "end", 12))
    drawn.append(path([(centers[0], 126), (centers[0], 98)], "arrow", 3, head))
    drawn.append(text(centers[0] - 8, 122, "b", "turn", "end"))
    # axes of the sensor next to square axes
    x, y = centers[2] - 46, 178
    for angle, ideal, name in ((8, 0, "x"), (79, 90, "y")):
        for degrees, css, end in (
            (ideal, "good", ' stroke-dasharray="6 4"'),
            (angle, "arrow", head),
        ):
            c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            drawn.append(path([(x, y), (x + 100 * c, y - 100 * s)], css, 2.5, end))
        drawn.append(text(x + 114 * c, y - 112 * s, name, "turn"))
    # a box at rest in two attitudes, and the rate that it reads
    for x, up, high in ((centers[3] - 38, (0, 0, 1), 34), (centers[3] + 38, (1, 0, 0), 12)):
        drawn += [box((x, 122), up, BOX * 0.6, axes=False), upward(x, 96, 22)]
        drawn.append(
            f'<rect class="turn" x="{x - 8:g}" y="{194 - high}" width="16" height="{high}"/>'
        )
        drawn.append(path([(x - 24, 194), (x + 24, 194)], "line", 1.5))
    drawn.append(text(centers[3], 84, "f", "turn"))
    drawn.append(text(centers[3], 182, "w", "turn"))
    # two axes of an accelerometer on a body that turns
    x, y = centers[4], 128
    drawn.append(f'<rect class="side a" x="{x - 56}" y="88" width="112" height="84"/>')
    ring = np.radians(np.linspace(200, 340, 40))
    drawn.append(
        path(np.stack([x + 66 * np.cos(ring), y + 62 * np.sin(ring)], 1), "arrow", 2.5, head)
    )
    for px, py, name in ((x - 34, y + 24, "z"), (x + 34, y - 6, "x")):
        drawn.append(f'<circle class="mark" cx="{px}" cy="{py}" r="5"/>')
        drawn.append(text(px, py - 10, name, "ink", size=13))
    drawn.append(path([(x - 28, y + 21), (x + 26, y - 2)], "side", 2, tip))
    drawn.append(text(x + 2, y + 26, "r", "ink"))
    drawn.append(text(x + 70, 76, "w", "turn"))
    about = (
        "Five panels. Bias: the line of output over input is shifted. Scale factor: it is steeper. "
        "Misalignment: the axes of the sensor are not square. G-sensitivity: a gyroscope at rest "
        "reads a rate that depends on its attitude. Lever arm: the axes of the accelerometer lie "
        "in different places of a body that turns."
    )
    return "The errors of the sensor model", about, 820, 276, drawn


# by the name of the file
DRAWINGS = {
    f"recording_{draw.__name__}": draw
    for draw in (session, attitudes, turns, static, faces, temperature)
} | {"method_held_out": held_out, "method_sensor_model": sensor_model}


def svg(title, about, width, height, drawn):
    """Return a drawing as text."""
    heads = "".join(
        f'<marker id="{name}" viewBox="0 0 8 8" refX="{ref}" refY="4" markerWidth="{size}" '
        f'markerHeight="{size}" orient="auto-start-reverse">'
        f'<path class="{css}" d="M0 0 8 4 0 8z"/></marker>'
        for name, css, ref, size in (("head", "turn", 5, 5), ("tip", "soft", 7, 7))
    )
    shapes = "\n  ".join(drawn)
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" \
aria-labelledby="title about" font-family="system-ui, sans-serif">
  <title id="title">{title}</title>
  <desc id="about">{about}</desc>
  <style>{STYLE}
  </style>
  <defs>{heads}</defs>
  <rect class="ground" x="1" y="1" width="{width - 2}" height="{height - 2}" rx="10"/>
  {shapes}
</svg>
"""


if __name__ == "__main__":
    for name, draw in DRAWINGS.items():
        target = Path(__file__).with_name(f"{name}.svg")
        target.write_text(svg(*draw()), encoding="utf-8")
