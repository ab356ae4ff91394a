"""A formula that a search found beyond the library: in words, and the residual against it."""

import numpy as np

from imuloop.report.figures.drawing import BLUE, INK, ORANGE, PAGE, drawn
from imuloop.report.numbers import number, percent, plural, with_sigma
from imuloop.report.units import RESIDUAL
from imuloop.report.verdict import RESIDUAL_WORDS

# terms of a formula that are written out
WRITTEN = 3
LIKE_IT = " These data cannot tell it from {}."


def words(block):
    """Return what a search beyond the library found, in sentences; nothing without a search."""
    search = block.get("discovered")
    if not search:
        return ""
    of = f"A search of {plural(search['searched'], 'composed effect')} beyond the library finds"
    if search["status"] == "nothing":
        return f" {of} nothing: chance shows as much in {percent(search['chance'])} of draws."
    gains = ", ".join(
        f"{RESIDUAL_WORDS[kind]} to {number(own['ratio'], 2)} of it, 95 % interval "
        f"{number(own['ratio_ci95'][0], 2)} to {number(own['ratio_ci95'][1], 2)}"
        for kind, own in search["residuals"].items()
    )
    if search["status"] == "structure":
        return (
            f" {of} structure, but no formula that stands out. Held out, what each part's own "
            f"search finds changes the {gains}."
        )
    text = f" {of} a formula, {formula(block)}, which wants a physicist. Held out: {gains}."
    if alike := search["imitators"][:WRITTEN]:
        text += LIKE_IT.format(" or ".join(a.replace("*", " ") for a in alike))
    return text


def formula(block):
    """Return the formula that was added, with its coefficients ± σ, SI."""
    (effect,) = [e for e in block["effects"] if e["name"] == "discovered"] or [None]
    terms = block["discovered"]["formula"].split("; ")
    if effect is None or len(terms) > WRITTEN:
        return f"the sum of {plural(len(terms), 'term')} ({terms[0].replace('*', ' ')}, …)"
    parts = []
    for term, (name, value) in zip(terms, effect["parameters"].items(), strict=True):
        axis, _, product = term.partition(": ")
        size = with_sigma(value, effect["std"][name])
        parts.append(f"e_{axis} = ({size}) {product.replace('*', ' ')}")
    return "; ".join(parts)


def composed_pictures(device, sensor, block):
    """Return a picture of each kind of residual against what the formula adds to it."""
    search = block.get("discovered")
    found = []
    for kind, series in (search or {}).get("points", {}).items():
        unit = RESIDUAL[block["residuals"][kind]["unit"]]
        own = {name: unit.factor * np.array(values) for name, values in series.items()}

        def plot(area, own=own, unit=unit):
            ends = np.array([own["input"].min(), own["input"].max()])
            area.plot(ends, ends, color=INK, lw=1, label="the formula")
            for name, colour in (("before", ORANGE), ("after", BLUE)):
                area.plot(own["input"], own[name], "o", color=colour, mec=PAGE, label=name)
            area.set(xlabel=f"what the formula adds, {unit.unit}")
            area.set(ylabel=f"residual, {unit.unit}")
            area.legend()

        size = {name: number(np.sqrt(np.mean(v**2)), 2) for name, v in own.items()}
        caption = (
            f"The {RESIDUAL_WORDS[kind]} in the fit, component by component: root mean square "
            f"{size['before']}\u202f{unit.unit} with what the formula "
            f"{search['formula'][:80]} adds, {size['after']}\u202f{unit.unit} without it."
        )
        title = f"{sensor.capitalize()}: residual against the composed input"
        found.append(drawn(device, f"{sensor}_{kind}_composed", title, caption, plot, own))
    return found
