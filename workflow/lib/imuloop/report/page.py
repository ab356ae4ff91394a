"""A page of the report: its style, its script, and the only script that it allows."""

import base64
import hashlib
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from imuloop.core.files import replaced

TEMPLATES = Path(__file__).parents[1] / "templates"
FILES = ("style.css", "page.js")
# the headings of a device's part, in its identifiers
PARTS = ("verdict", "diagnosis", "calibration", "noise", "data")


def write(path, template, **values):
    """Write a template filled in; all text is escaped, a value that is missing is an error."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    html = environment.get_template(template).render(**values)
    with replaced(path) as temporary:
        temporary.write_text(html, encoding="utf-8", newline="\n")


def write_page(path, template, **values):
    """Write a page that needs no other file, from a template that extends ``page.html.j2``."""
    style, script = ((TEMPLATES / name).read_text("utf-8") for name in FILES)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    looks = {"style": Markup(style), "script": Markup(script), "script_hash": f"sha256-{digest}"}
    write(path, template, parts=PARTS, **looks, **values)
