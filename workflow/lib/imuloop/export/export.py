"""The folder of a device's exports: a file per tool, and README.txt that lists them."""

import hashlib
import shutil
from functools import cache
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

# a calibration may hold any effect of the library
import imuloop.effects  # noqa: F401
from imuloop.core.errors import Lacking
from imuloop.core.files import read_json, write_json
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.export import c_code, formulas, text
from imuloop.export.values import Exported, reasons, values
from imuloop.model.calibration import Calibration

README = "README.txt"
TEMPLATES = resources.files("imuloop") / "templates/export"


class ExportFormat(NamedTuple):
    """A format of exports: a file for another tool, written by a template.

    The template is ``templates/export/<file>.j2``.
    """

    file: str
    title: str  # the tool
    needs: tuple[str, ...]  # parts that the file needs, by their names in `reasons`

    def text(self, exported):
        """Return the text of the file for the device of `exported`, an `Exported`.

        Raises Lacking if the device lacks a part that the file needs.
        """
        lacking = reasons(exported)
        for need in self.needs:
            if need in lacking:
                raise Lacking(lacking[need])
        return render(self.file, values(exported))


# a new format is a line in formats.yaml and a template next to it; nothing is added here
FORMATS = tuple(
    ExportFormat(file, row["title"], tuple(row["needs"]))
    for file, row in yaml.safe_load((TEMPLATES / "formats.yaml").read_text("utf-8")).items()
)


@cache
def environment():
    """Return the jinja2 environment of the templates; it raises an error for a missing value."""
    jinja = Environment(
        loader=PackageLoader("imuloop", "templates/export"),
        undefined=StrictUndefined,
        finalize=text.written,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.globals |= {"formulas": formulas, "c": c_code, "np": np, "zip": zip}
    jinja.filters |= {name: getattr(text, name) for name in text.FILTERS}
    return jinja


def render(file, content):
    """Return the text of the exported file with the name `file`.

    It is the template of this file, filled with the values of the dict `content`.
    """
    return environment().get_template(f"{file}.j2").render(content)


def read_exported(device):
    """Return the `Exported` of a device, the results to export, from its result files.

    `device` is a `chain.Device`. quality.json of its sessions gives the temperatures, and the
    sampling rate if noise.json lacks it. diagnosis.json gives time offset and lever arm relative to
    a reference.
    """
    content = read_json(device.file("noise.json"))
    fit = Calibration.from_json(device.file("calibration.json"))
    # if noise.json has no rates, it is not known which sensors the logs hold
    rates = content.get("rates_hz") or SENSORS
    used = [q for f in device.sessions.values() if (q := read_json(f["quality"]))["status"] == "ok"]
    longest = max(used, key=lambda quality: quality["rows"], default={})
    spans = [span for quality in used if (span := quality["temperature_range"])]
    return Exported(
        device.name,
        device.label or device.name,
        fit,
        NoiseModel.from_dict(content),
        content["rate_hz"] or longest.get("rate_hz"),
        tuple(content["notes"]),
        (min(map(min, spans)), max(map(max, spans))) if spans else None,
        reference_parameters(read_json(device.file("diagnosis.json")), used),
        tuple(s for s in SENSORS if s in rates or getattr(fit, s).measured),
    )


def reference_parameters(diagnosis, qualities):
    """Return the parameters of the effects that a comparison with a reference showed, SI.

    The result is a dict. Its keys are tuples of the names of a sensor and of an effect; each value
    is a dict with the value of each parameter of this effect by name. `diagnosis` is the content of
    diagnosis.json, and `qualities` has the content of quality.json of each session. Exception: the
    time offset is left out if the reference has its own clock, because the next recording has
    another offset.
    """
    own_clock = any(q.get("reference", {}).get("clock", {}).get("own") for q in qualities)
    return {
        (sensor, effect["name"]): effect["parameters"]
        for sensor, parts in diagnosis["sensors"].items()
        for effect in parts.get("reference", {}).get("effects", ())
        if not (own_clock and effect["name"] == "time_offset")
    }


def export_files(exported):
    """Return the texts of the exported files of a device, a dict by file name.

    `exported` is the Exported. README.txt lists the files, and says for each format that is left
    out which part is missing.
    """
    files, written, left_out = {}, [], []
    for form in FORMATS:
        try:
            files[form.file] = form.text(exported)
            written.append(f"{form.file}: {form.title}")
        except Lacking as reason:
            left_out.append(f"{form.file} ({form.title}): {reason}")
    files[README] = render(README, values(exported) | {"written": written, "left_out": left_out})
    return files


def write_exports(folder, files):
    """Replace the content of `folder` by `files`, texts by name, and write their SHA-256.

    The SHA-256 of each file is written, by its name, to a JSON file next to the folder:
    ``exports.json`` for the folder ``exports``.
    """
    folder = Path(folder)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8", newline="\n")
    hashes = {name: hashlib.sha256(content.encode()).hexdigest() for name, content in files.items()}
    write_json(folder.with_suffix(".json"), {"sha256": hashes})


def listed(path):
    """Return the file name of each exported file and its tool, a list of (file name, tool).

    `path` is the path of ``exports.json``.
    """
    names = read_json(path)["sha256"]
    return [(form.file, form.title) for form in FORMATS if form.file in names]
