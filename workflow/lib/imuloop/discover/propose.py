"""An effect file of a formula that was found: complete, for a physicist to name and explain."""

import re
from pathlib import Path
from string import Template
from textwrap import fill

from imuloop.core.errors import ImuloopError
from imuloop.effects.discovered import MEANINGS, Discovered

TEMPLATES = Path(__file__).parents[1] / "templates"


def proposed(diagnosis, name):
    """Return the text of an effect file, and of its test.

    Takes the content of diagnosis.json and the name of the new effect. Raises an ImuloopError if
    the diagnosis names no formula, or the name is none.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise ImuloopError(f"'{name}' is no name of an effect: small letters, digits and _")
    named = (
        (sensor, record, entry, block["discovered"])
        for sensor, records in diagnosis["sensors"].items()
        for record, block in records.items()
        for entry in block["effects"]
        if entry["name"] == Discovered.name
    )
    sensor, record, entry, search = next(named, [None] * 4)
    if not entry:
        raise ImuloopError(f"{diagnosis['device']}: no formula was found, nothing to propose")
    effect, std, units = Discovered(**entry["constants"]), entry["std"], entry["units"]
    values = {k: float(v) for k, v in entry["parameters"].items()}
    terms = effect.formula.split("; ")
    products = (term.replace(":", f" += {p}") for p, term in zip(values, terms, strict=True))
    equation = "; ".join(f"e_{product}" for product in products)
    meanings = "; ".join(f"{letter}: {MEANINGS[letter]}" for letter in sorted(effect.letters))
    factors = f"Factors: {meanings}.".format(reference_temperature=effect.reference_temperature)
    sizes = (f"{k} = {v:.3g} ± {std[k]:.1g} {units[k]}" for k, v in values.items())
    errors = (
        f"{kind} {own['before']:.3g} before, {own['after']:.3g} after"
        for kind, own in search["residuals"].items()
    )
    words = {
        "device": re.sub(r"\W", "_", diagnosis["device"]),
        "cls": name.title().replace("_", ""),
        "name": name,
        "sensor": sensor,
        "record": record,
        "formula": ";\n".join(terms),
        "equation": equation if len(terms) < 4 else f"sum of {len(terms)} terms, see FORMULA",
        "factors": fill(factors, 100, initial_indent="    ", subsequent_indent="    "),
        "sizes": ";\n    ".join(sizes),
        "errors": ";\n    ".join(errors),
        "imitators": ",\n    ".join(search["imitators"]) or "nothing that was searched",
        "reference": effect.reference_temperature,
        "parameters": "\n".join(f'        "{k}": "{u}",' for k, u in effect.parameters.items()),
        "values": "\n".join(f'    "{k}": {v!r},' for k, v in values.items()),
        "limit": f"{10 * max(map(abs, values.values())):.1e}",
    }
    texts = (TEMPLATES / file for file in ("effect.py.template", "test_effect.py.template"))
    return tuple(Template(text.read_text("utf-8")).substitute(words) for text in texts)
