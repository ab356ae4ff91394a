"""The part of a device in the report: its section, page, summary.json and figures."""

import shutil

from markupsafe import Markup

# loading it registers the library of effects
import imuloop.effects  # noqa: F401
from imuloop.core.files import write_json
from imuloop.export.export import listed
from imuloop.model.calibration import UNEXPLAINED
from imuloop.report import effect_tables, tables
from imuloop.report.comparison import summarise
from imuloop.report.data_tables import data_table
from imuloop.report.figures.attitude import attitude_finding
from imuloop.report.figures.drawing import Picture
from imuloop.report.figures.opening import opening_pictures
from imuloop.report.findings import blocks, record_title
from imuloop.report.page import RECORDS, WORDS, phrase, write, write_page
from imuloop.report.pictures import OF_RECORD, OF_SESSION, pictures
from imuloop.report.results import SENSORS, read_device


def write_section(device):
    """Write the part of a device in the report, and its page, summary.json and figures.

    `device` is the `chain.Device`, into whose folder the files are written. Its label is shown as
    plain text, never as markup.
    """
    device = read_device(device)
    if device.figures.exists():
        shutil.rmtree(device.figures)
    device.figures.mkdir(parents=True)
    values = content(device)
    loop = pictures(device, "loop")
    for picture in (*loop, *_inside(values)):
        picture.write(device.figures)
    section = device.folder / "section.html"
    write(section, "section.html.j2", device=device, **values)
    summary = summarise(device)
    write_json(device.folder / "summary.json", summary)
    # text was escaped when it was written; links are relative to the folder above
    text = section.read_text("utf-8").replace(f'href="{device.name}/', 'href="')
    looks = {"device": device.name, "label": device.title, "section": Markup(text)}
    looks |= {"said": summary["card"], "loop_of": loop[0] if loop else None}
    write_page(device.folder / "report.html", "device.html.j2", **looks)


def _inside(values):
    """Return all Pictures in `values`, at any depth, as a list, to write their files.

    `values` is a Picture, or a dict or list that may contain Pictures, dicts and lists.
    """
    if isinstance(values, Picture):
        return [values]
    parts = values.values() if isinstance(values, dict) else values
    return [p for part in parts if isinstance(part, (Picture, dict, list)) for p in _inside(part)]


def content(device):
    """Return the values that fill the template of a device's section in the report, a dict.

    `device` is a DeviceResults, all results of one device.
    """
    final = device.calibrations["final"]

    def of_sensors(make):
        """Return the tables of all sensors, a list; a sensor without a table is left out.

        `make` is a function that takes a DeviceResults and the name of a sensor, and returns a
        Table or None.
        """
        return [table for sensor in SENSORS if (table := make(device, sensor))]

    parts = [diagnosis_part(device, block) for block in blocks(device.diagnosis)]
    # parts that could not be tested come last
    parts.sort(key=lambda p: p["verdict"] == "not_testable")
    verdicts = {}
    for p in parts:
        verdicts.setdefault(p["sentence"], []).append(p)
    methods = {sensor: getattr(final, sensor).method for sensor in SENSORS}
    return {
        "parts": parts,
        "verdicts": verdicts,
        "exports": listed(device.folder / "exports.json"),
        "data": data_table(device),
        "basis": {sensor: WORDS["methods"][method] for sensor, method in methods.items()},
        "reasons": tables.reasons(device),
        "unexplained": [s for s in SENSORS if getattr(final, s).unexplained],
        "unexplained_words": UNEXPLAINED,
        "parameters": of_sensors(tables.parameter_table),
        "misalignments": of_sensors(tables.misalignment_table),
        "model": of_sensors(tables.model_table),
        "coefficients": of_sensors(tables.coefficient_table),
        "attitude": attitude_finding(device),
        "opening": opening_pictures(device),
        "filter": pictures(device, "attitude"),
        **{kind: pictures(device, kind) for kind in ("poses", *OF_SESSION)},
    }


def diagnosis_part(device, block):
    """Return the values that fill the template for one diagnosis, a dict.

    `device` is a DeviceResults, and `block` the diagnosis of a sensor in one kind of data, as
    `block_of` returns it.
    """
    tables = [effect_tables.steps_table(block)]
    tables += [effect_tables.effect_table(block, effect) for effect in block["effects"]]
    if block["part"] == "reference":
        tables.append(effect_tables.set_up_table(block))
    return {
        # target of the links to this part
        "identity": f"{device.name}.{block['sensor']}.{block['part']}",
        "title": record_title(block),
        "place": f"{RECORDS[block['part']]} of the {block['sensor']}",
        "verdict": block["verdict"],
        # words with which the sentence begins
        "words": block["verdict"].replace("_", " "),
        "sentence": phrase("verdict", b=block, short=True),
        "effects": [t for t in tables if t],
        "ranking": effect_tables.ranking_table(block),
        **{kind: make(device, block) for kind, make in OF_RECORD.items()},
    }
