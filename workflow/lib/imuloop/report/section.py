"""A device's part of the report: its section and page, its row of the comparison, its figures."""

import shutil
from pathlib import Path

from markupsafe import Markup

# the library of effects joins by being loaded
import imuloop.effects  # noqa: F401
from imuloop.core.failure import Failure, read_failures
from imuloop.core.files import write_json
from imuloop.export.export import listed
from imuloop.report import composed
from imuloop.report.advice import next_steps, what_next
from imuloop.report.figures.allan import (
    allan_pictures,
    corrected_pictures,
    definitions,
    deviation_pictures,
)
from imuloop.report.figures.arms import arm_pictures
from imuloop.report.figures.attitude import attitude_part
from imuloop.report.figures.bias import bias_pictures
from imuloop.report.figures.correlates import correlate_pictures
from imuloop.report.figures.correlations import correlation_matrices
from imuloop.report.figures.drawing import write_svg
from imuloop.report.figures.poses import pose_picture
from imuloop.report.figures.residuals import residual_pictures
from imuloop.report.figures.spectrum import correlation_pictures, density_pictures
from imuloop.report.figures.time_series import session_pictures
from imuloop.report.page import write, write_page
from imuloop.report.results import SENSORS, Device, read_device
from imuloop.report.summary import summarise
from imuloop.report.tables.calibration import METHOD_WORDS, model_table, parameter_table, reasons
from imuloop.report.tables.candidates import ranking_table, twin_table
from imuloop.report.tables.data import data_table, segment_table, source_table, warnings
from imuloop.report.tables.diagnosis import (
    effect_tables,
    heldout_by_session,
    heldout_table,
    session_tables,
    steps_table,
)
from imuloop.report.tables.noise import (
    coefficient_note,
    coefficient_table,
    noise_change_table,
    stability_table,
    statistics_tables,
    uncut_table,
)
from imuloop.report.verdict import ABOVE, PARTS, WORDS, blocks, sentence


def write_section(name, label, folder, sessions):
    """Write a device's section, its page, its row of the comparison and its figures.

    Parameters
    ----------
    name, label : str
        As in the config; the label is shown as it is, never as markup.
    folder : path-like
        ``results/<device>``, to read and to write.
    sessions : dict of str to str
        Kind of each session by its name.
    """
    device = read_device(name, label, folder, sessions)
    _empty(device.figures)
    values = content(device)
    # for snakemake --report
    for picture in (*values["allan"], *filter(None, [values["poses"]])):
        write_svg(device.figures, picture.name.removeprefix(f"{name}.").replace(".", "_"), picture)
    _write(device, "section.html.j2", **values)


def write_failed(name, label, folder, sessions, failed):
    """Write what `write_section` does, of a device whose part failed, with the `Failure`."""
    failures = (*read_failures(folder, sessions), (None, Failure(**failed)))
    device = Device(name, label, Path(folder), failures=failures)
    _empty(device.figures)
    _write(device, "failed.html.j2", steps=next_steps(device))


def _write(device, template, **values):
    section = device.folder / "section.html"
    write(section, template, device=device, **values)
    write_json(device.folder / "summary.json", summarise(device, values["steps"]))
    # text was escaped when it was written; links are those of a page in the folder above
    text = section.read_text("utf-8").replace(f'href="{device.name}/', 'href="')
    looks = {"device": device.name, "label": device.title, "section": Markup(text)}
    write_page(device.folder / "report.html", "device.html.j2", **looks)


def _empty(folder):
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)


def content(device):
    """Return what the section's template lays out, and write the figures' numbers."""
    final, used = device.calibrations["final"], device.used

    def tables(make):
        return [table for sensor in SENSORS if (table := make(device, sensor))]

    def pictures(make):
        return [picture for session in used for picture in make(device, session)]

    return {
        "parts": diagnosis_parts(device),
        "steps": next_steps(device),
        "exports": listed(device.folder / "exports.json"),
        "rejected": [s for s in device.sessions if s.rejected],
        "data": [data_table(device), source_table(device)],
        "warnings": warnings(device),
        "series": pictures(session_pictures),
        "segments": segment_table(device),
        "poses": pose_picture(device),
        "basis": [(s, METHOD_WORDS[getattr(final, s).method]) for s in SENSORS],
        "reasons": reasons(device),
        "parameters": tables(parameter_table),
        "matrices": correlation_matrices(device),
        "model": tables(model_table),
        "allan": pictures(allan_pictures),
        "spectra": pictures(density_pictures),
        "autocorrelations": pictures(correlation_pictures),
        "definitions": definitions(device),
        "deviations": pictures(deviation_pictures),
        "coefficients": tables(coefficient_table),
        "coefficient_note": coefficient_note(device),
        "uncut": tables(uncut_table),
        "stability": tables(stability_table),
        "statistics": statistics_tables(device),
        "heldout": heldout_table(device),
        "attitude": attitude_part(device),
    }


def diagnosis_parts(device):
    """Return what is laid out of each sensor and kind of data, in the order of reading."""
    return [_part(device, *each) for each in blocks(device.diagnosis)]


def _part(device, sensor, part, block):
    verdict = block["verdict"]
    above = verdict in ABOVE
    tables = [steps_table(sensor, part, block), *effect_tables(sensor, part, block)]
    allan, drawn = [], []
    if part != "static_record":
        drawn = residual_pictures(device, sensor, block) + arm_pictures(device, block)
        drawn += composed.composed_pictures(device, sensor, block)
    else:
        allan = corrected_pictures(device, sensor) if block["effects"] else []
        tables += [
            heldout_by_session(device, sensor, block),
            *session_tables(device, sensor, block),
            noise_change_table(sensor, block),
        ]
    return {
        # where links lead
        "identity": f"{device.name}.{sensor}.{part}",
        "title": f"{sensor.capitalize()}, {PARTS[part]}",
        "verdict": verdict,
        # with which the sentence begins
        "words": WORDS[verdict],
        "sentence": sentence(sensor, block) + composed.words(block),
        "poses": drawn,
        "bias": bias_pictures(device, sensor, block),
        "effects": [t for t in tables if t],
        "allan": allan,
        "ranking": ranking_table(sensor, part, block),
        "twins": twin_table(sensor, part, block),
        "left": correlate_pictures(device, sensor, part, block) if above else [],
        "next_step": what_next(block) if above else "",
    }
