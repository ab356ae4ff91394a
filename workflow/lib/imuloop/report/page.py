"""A page of the report: its style, its script, and the only script that it allows."""

import base64
import hashlib
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from imuloop.core.files import read_json, replaced

# the headings of a device's part, in its identifiers
PARTS = ("verdict", "data", "segments", "calibration", "noise", "diagnosis", "validation")


def render(template, **values):
    """Return a template filled in; all text is escaped, a value that is missing is an error."""
    environment = Environment(
        loader=FileSystemLoader(Path(template).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(Path(template).name).render(**values)


def write_page(path, template, style, script, **values):
    """Write a page that needs no other file.

    Parameters
    ----------
    path : path-like
        HTML file to write.
    template, style, script : path-like
        One that extends ``page.html.j2``, ``style.css`` and ``sorting.js``.
    **values
        What else the template lays out.
    """
    code = Path(script).read_text(encoding="utf-8")
    html = render(
        template,
        style=Markup(Path(style).read_text(encoding="utf-8")),
        script=Markup(code),
        # the page allows this script and no other
        script_hash=f"sha256-{base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()}",
        parts=PARTS,
        **values,
    )
    with replaced(path) as temporary:
        temporary.write_text(html, encoding="utf-8", newline="\n")


def write_device(path, section, summary, **files):
    """Write a device's part as a page of its own, ``results/<device>/report.html``.

    Parameters
    ----------
    path : path-like
        HTML file to write.
    section, summary : path-like
        Its part, and its row of the comparison, as `write_section` wrote them.
    **files
        Template, style and script, as for `write_page`.
    """
    device, label = (read_json(summary)[key] for key in ("device", "label"))
    # text was escaped when it was written; links are those of a page in the folder above
    text = Path(section).read_text(encoding="utf-8").replace(f'href="{device}/', 'href="')
    write_page(path, device=device, label=label, section=Markup(text), **files)
