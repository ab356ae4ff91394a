"""A formula that a search found beyond the library, in words."""

from imuloop.core.errors import plural
from imuloop.report.numbers import number, percent, with_sigma
from imuloop.report.verdict import RESIDUAL_WORDS

# terms of a formula that are written out
WRITTEN = 3
LIKE_IT = " These data cannot tell it from {}."
PATTERN = " Noise cannot be predicted: a part of what passes for slow noise here is a pattern."


def words(block):
    """Return what a search beyond the library found, in sentences; nothing without a search."""
    search = block.get("discovered")
    if not search:
        return ""
    of = f"A search of {plural(search['searched'], 'composed effect')} beyond the library finds"
    if search["status"] == "nothing":
        chance = percent(search["chance"])
        return f" {of} nothing: chance shows as much with a probability of {chance}."
    gains = ", ".join(
        f"{RESIDUAL_WORDS[kind]} × {number(own['ratio'], 2)} (95 % interval "
        f"{number(own['ratio_ci95'][0], 2)} to {number(own['ratio_ci95'][1], 2)})"
        for kind, own in search["residuals"].items()
    )
    if search["status"] == "structure":
        if all(own["ratio_ci95"][1] >= 1 for own in search["residuals"].values()):
            return f" {of} what chance hardly shows, but held out it lowers no error: {gains}."
        text = f" {of} structure, but no formula that is certain. Held out, with what each part's "
        text += f"own search finds: {gains}."
        return text + PATTERN * bool(block.get("slow_noise"))
    text = f" {of} a formula, {formula(block)}, which wants a physicist (imuloop propose). "
    text += f"Held out: {gains}."
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
