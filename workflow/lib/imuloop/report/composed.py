"""A formula that a search found beyond the library, in words."""

from imuloop.core.errors import plural
from imuloop.report.numbers import interval_text, joined, number, p_text, percent, with_sigma
from imuloop.report.tables.table import Table
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


def type_part(content, labels):
    """Return name, texts and table of type.json; `labels` are the devices' names in the report."""
    texts, rows = [f"Not testable: {content['why']}"] * bool(content["why"]), []
    for sensor, own in content["sensors"].items():
        texts.append(_joint(sensor.capitalize(), own, labels))
        texts += [f"{sensor.capitalize()} of {labels[n]}: {w}" for n, w in own["left_out"].items()]
        rows += [_member(labels[name], sensor, each) for name, each in own["devices"].items()]
    columns = ("Device", "Sensor", "Has it", "Size ± σ, SI", "Held-out error ×", "p")
    note = "Held out, each device is predicted with what the others choose; 95 % intervals."
    table = Table("What the devices show of the formula", columns, rows, note)
    return {"name": content["type"], "texts": texts, "table": table}


def _joint(sensor, own, labels):
    """Return a sentence on what the devices of a type show together of one sensor."""
    if own["status"] == "not_testable":
        return f"{sensor}: not testable, {own['why']}."
    searched = plural(own["searched"], "composed effect")
    if own["status"] == "nothing":
        share = percent(own["chance"])
        return f"{sensor}: of {searched} none is in the devices alike ({share} of draws show more)."
    having = [labels[name] for name, each in own["devices"].items() if each["has"]]
    who = f"It holds of {joined(having)}." if having else "It holds of no device for certain."
    if own["status"] == "structure":
        return f"{sensor}: of {searched} the best is no formula that is certain. {who}"
    formula = own["formula"].replace("*", " ")
    text = f"{sensor}: of {searched} one is shared, {formula}, which wants a physicist. {who}"
    if alike := own["imitators"][:WRITTEN]:
        text += LIKE_IT.format(" or ".join(a.replace("*", " ") for a in alike))
    return text


def _member(label, sensor, each):
    terms = list(each["values"])
    sizes = [with_sigma(each["values"][t], each["std"][t]) for t in terms[:WRITTEN]]
    more = [f"and {len(terms) - WRITTEN} more"] * (len(terms) > WRITTEN)
    ratios = [
        f"{RESIDUAL_WORDS[kind]} {number(own['ratio'], 2)} ({interval_text(own['ratio_ci95'])})"
        for kind, own in each["residuals"].items()
    ]
    has = "yes" if each["has"] else "no"
    return (label, sensor, has, "\n".join(sizes + more), "\n".join(ratios), p_text(each["p_value"]))
