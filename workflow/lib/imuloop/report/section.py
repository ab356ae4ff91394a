"""A device's part of the report: its section and page, its row of the comparison, its figures."""

import shutil

from markupsafe import Markup

# the library of effects joins by being loaded
import imuloop.effects  # noqa: F401
from imuloop.core.files import write_json
from imuloop.export.export import listed
from imuloop.model.calibration import UNEXPLAINED
from imuloop.report.advice import next_steps, what_next
from imuloop.report.figures.attitude import attitude_part
from imuloop.report.figures.drawing import Picture, write_svg
from imuloop.report.page import write, write_page
from imuloop.report.pictures import OF_RECORD, OF_SESSION, pictures
from imuloop.report.results import SENSORS, read_device
from imuloop.report.summary import summarise
from imuloop.report.tables import calibration, candidates, data, diagnosis, noise
from imuloop.report.verdict import ABOVE, PARTS, WORDS, blocks, sentence


def write_section(name, label, folder, sessions, data_sheet=None):
    """Write a device's section, its page, its row of the comparison and its figures.

    Takes name and label as in the config, the folder ``results/<device>``, the kind of each session
    by its name, and the device's ``data_sheet`` as in `device_figures`. The label is shown as it
    is, never as markup.
    """
    device = read_device(name, label, folder, sessions, data_sheet)
    if device.figures.exists():
        shutil.rmtree(device.figures)
    device.figures.mkdir(parents=True)
    values = content(device)
    whole = pictures(device, "loop")
    for picture in (*whole, *_inside(values)):
        write_svg(device.figures, picture.stem, picture)
    section = device.folder / "section.html"
    write(section, "section.html.j2", device=device, **values)
    summary = summarise(device, values["steps"])
    write_json(device.folder / "summary.json", summary)
    # text was escaped when it was written; links are those of a page in the folder above
    text = section.read_text("utf-8").replace(f'href="{device.name}/', 'href="')
    looks = {"device": device.name, "label": device.title, "section": Markup(text)}
    looks |= {"said": summary["card"], "loop_of": whole[0] if whole else None}
    write_page(device.folder / "report.html", "device.html.j2", **looks)


def _inside(values):
    """Return every picture of what is laid out."""
    if isinstance(values, Picture):
        return [values]
    parts = values.values() if isinstance(values, dict) else values
    return [p for part in parts if isinstance(part, (Picture, dict, list)) for p in _inside(part)]


def content(device):
    """Return what the section's template lays out, and write the figures' numbers."""
    final = device.calibrations["final"]

    def tables(make):
        return [table for sensor in SENSORS if (table := make(device, sensor))]

    parts = [diagnosis_part(device, *each) for each in blocks(device.diagnosis)]
    told = [p["next_step"] for p in parts]
    # the same of two sensors once
    for i, p in enumerate(parts):
        p["next_step"] = "" if told[i] in told[:i] else told[i]
    # what could not be tested comes last
    parts.sort(key=lambda p: p["verdict"] == "not_testable")
    verdicts = {}
    for p in parts:
        verdicts.setdefault(p["sentence"], []).append(p)
    return {
        "parts": parts,
        "verdicts": verdicts,
        "steps": next_steps(device),
        "exports": listed(device.folder / "exports.json"),
        "rejected": [s for s in device.sessions if s.rejected],
        "data": data.data_table(device),
        "warnings": [(s.name, text) for s in device.sessions for text in s.quality["warnings"]],
        "basis": [(s, calibration.METHOD_WORDS[getattr(final, s).method]) for s in SENSORS],
        "reasons": calibration.reasons(device),
        "unexplained": [s for s in SENSORS if getattr(final, s).unexplained],
        "unexplained_words": UNEXPLAINED,
        "parameters": tables(calibration.parameter_table),
        "model": tables(calibration.model_table),
        "coefficients": tables(noise.coefficient_table),
        "attitude": attitude_part(device),
        **{k: pictures(device, k) for k in ("poses", *OF_SESSION)},
    }


def diagnosis_part(device, sensor, part, block):
    """Return what is laid out of a sensor and kind of data."""
    verdict, above = block["verdict"], block["verdict"] in ABOVE
    tables = [diagnosis.steps_table(sensor, part, block)]
    tables += [diagnosis.effect_table(sensor, part, e) for e in block["effects"]]
    if part == "reference":
        tables.append(diagnosis.set_up_table(sensor, block))
    elif part == "static_record":
        tables.append(noise.noise_change_table(sensor, block))
    return {
        # where links lead
        "identity": f"{device.name}.{sensor}.{part}",
        "title": f"{sensor.capitalize()}, {PARTS[part]}",
        "verdict": verdict,
        # with which the sentence begins
        "words": WORDS[verdict],
        "sentence": sentence(sensor, block),
        "effects": [t for t in tables if t],
        "ranking": candidates.ranking_table(sensor, part, block),
        "next_step": what_next(block) if above else "",
        **{k: make(device, sensor, part, block) for k, make in OF_RECORD.items()},
    }
