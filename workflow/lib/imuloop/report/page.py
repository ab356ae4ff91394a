"""Pages and sentences of the report, from its templates."""

import base64
import hashlib
import re
from functools import cache
from pathlib import Path

import yaml
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from imuloop.core.errors import joined, plural
from imuloop.core.files import replaced
from imuloop.report import numbers
from imuloop.report.units import QUANTITIES, data_sheet

TEMPLATES = Path(__file__).parents[1] / "templates"
# the words for the names in result files
WORDS = yaml.safe_load((TEMPLATES / "words.yaml").read_text("utf-8"))
RECORDS = WORDS["records"]
RESIDUALS = {name: words[0] for name, words in WORDS["residuals"].items()}
# the headings of a device's part, in its identifiers
PARTS = ("verdict", "diagnosis", "calibration", "noise", "data")


def effect_words(effect):
    """Return the words for an effect of a sensor, such as "bias over temperature".

    `effect` is a mapping with its ``name`` and perhaps its ``constants``, as in diagnosis.json.
    """
    constants = effect.get("constants") or {}
    if "formula" in constants:
        return f"{constants['formula']} on {constants['axis']}"
    return WORDS["effects"].get(effect["name"], effect["name"].replace("_", " "))


@cache
def environment(escape):
    """Return the jinja2 environment with the report's templates, functions and filters.

    A name in a template without a value is an error. If `escape`, every text is escaped, as in
    HTML.
    """
    jinja = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=escape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.globals |= {"phrase": phrase, "plural": plural, "WORDS": WORDS, "RESIDUALS": RESIDUALS}
    jinja.globals |= {"coefficient": numbers.coefficient_text, "QUANTITIES": QUANTITIES}
    jinja.filters |= {"joined": joined, "effect": effect_words, "shown": shown, "valued": valued}
    names = ("duration", "interval_text", "number", "p_text", "percent", "with_unit")
    jinja.filters |= {name: getattr(numbers, name) for name in names}
    return jinja


def shown(value, unit, digits=3):
    """Return a value with its unit as text, in the unit that data sheets use.

    `value` is in SI, `unit` is its SI unit, and `digits` the number of significant digits.
    """
    return data_sheet(unit).text(value, digits)


def valued(text):
    """Return the `text` of a table cell as HTML in which its standard error or limit is grey.

    The grey part is "± σ" after a value, or the whole text if it has only a limit or a tolerance.
    """
    if text.startswith(("<\u202f", "±")):
        return Markup("<small>{}</small>").format(text)
    value, sign, error = text.partition("\u202f±")
    return Markup("{}<small>{}</small>").format(value, sign + error) if sign else text


def phrase(code, **values):
    """Return a sentence of the report from a macro of the template ``phrases.j2``.

    `code` is the name of the macro, and `values` are its arguments.
    """
    macro = getattr(environment(escape=False).get_template("phrases.j2").module, code)
    text = re.sub("[ \n]+", " ", macro(**values))
    return re.sub(" ([.,;:?)])", r"\1", text).strip()


def sentence(text):
    """Return `text` with a capital letter first, and a full stop or a question mark last."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith(('.', '?')) else '.'}"


def write(path, template, **values):
    """Write an HTML file to `path`: the `template`, a file name, filled with `values` by name."""
    html = environment(escape=True).get_template(template).render(**values)
    with replaced(path) as temporary:
        temporary.write_text(html, encoding="utf-8", newline="\n")


def write_page(path, template, **values):
    """Write an HTML page that needs no other file, because style and script are inside it.

    `path` is the path of the page. `template` is the file name of a template that extends
    ``page.html.j2``, and `values` are its values by name.
    """
    style, script = ((TEMPLATES / name).read_text("utf-8") for name in ("style.css", "page.js"))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    looks = {"style": Markup(style), "script": Markup(script), "script_hash": f"sha256-{digest}"}
    write(path, template, parts=PARTS, **looks, **values)
