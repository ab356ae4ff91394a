"""A device's part of the report: its section, its row of the comparison, its figures' numbers."""

import shutil
from pathlib import Path

# the library of effects joins by being loaded
import imuloop.effects  # noqa: F401
from imuloop.core.failure import Failure, read_failures
from imuloop.core.files import replaced, write_json
from imuloop.export.export import listed
from imuloop.report.advice import next_steps
from imuloop.report.allan_plot import allan_pictures
from imuloop.report.attitude_plot import attitude_part
from imuloop.report.calibration_tables import (
    METHOD_WORDS,
    model_table,
    parameter_table,
    reasons,
)
from imuloop.report.data_tables import data_table, segment_table, source_table, warnings
from imuloop.report.deviation_plot import deviation_pictures
from imuloop.report.diagnosis_parts import diagnosis_parts
from imuloop.report.diagnosis_tables import heldout_table
from imuloop.report.noise_statistics import stability_table, statistics_tables
from imuloop.report.noise_tables import coefficient_note, coefficient_table, uncut_table
from imuloop.report.page import render
from imuloop.report.parameter_plot import correlation_matrices
from imuloop.report.pose_plot import pose_picture
from imuloop.report.results import SENSORS, Device, read_device
from imuloop.report.spectrum_plot import correlation_pictures, density_pictures
from imuloop.report.summary import summarise
from imuloop.report.svg import write_svg
from imuloop.report.time_series import session_pictures


def write_section(
    *, device, label, folder, sessions, template, section_path, summary_path, figures_folder
):
    """Write a device's section, its row of the comparison and the numbers behind its figures.

    Parameters
    ----------
    device, label : str
        Name and label, as in the config; the label is shown as it is, never as markup.
    folder : path-like
        ``results/<device>``.
    sessions : dict of str to str
        Kind of each session by its name.
    template : path-like
        ``section.html.j2``.
    section_path, summary_path : path-like
        HTML and JSON file to write.
    figures_folder : path-like
        Where a CSV file for each figure goes; emptied first.
    """
    found = read_device(device, label, folder, sessions)
    figures = emptied(figures_folder)
    values = content(found, figures)
    html = render(template, device=found, sensors=tuple(SENSORS), **values)
    # for snakemake --report
    for picture in (*values["allan"], *filter(None, [values["poses"]])):
        name = picture.name.removeprefix(f"{found.name}.").replace(".", "_")
        write_svg(figures, name, picture)
    write_json(summary_path, summarise(found, values["steps"]))
    with replaced(section_path) as temporary:
        temporary.write_text(html, encoding="utf-8", newline="\n")


def write_failed(
    *, device, label, folder, sessions, template, section_path, summary_path, figures_folder, failed
):
    """Write what `write_section` does, of a device whose part could not be made: why.

    Parameters are those of `write_section`, and ``failed``, the content of a `Failure`.
    """
    failures = (*read_failures(folder, sessions), (None, Failure(**failed)))
    found = Device(device, label, Path(folder), (), {}, {}, {}, failures)
    emptied(figures_folder)
    write_json(summary_path, summarise(found, next_steps(found)))
    html = render(Path(template).with_name("failed.html.j2"), device=found)
    with replaced(section_path) as temporary:
        temporary.write_text(html, encoding="utf-8", newline="\n")


def emptied(folder):
    """Return a folder that is there and empty."""
    folder = Path(folder)
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    return folder


def content(device, figures):
    """Return what the section's template lays out.

    Parameters
    ----------
    device : Device
        Its results.
    figures : Path
        Where the CSV files go.
    """
    final = device.calibrations.get("final")
    poses = pose_picture(device, figures)
    return {
        "parts": diagnosis_parts(device, figures),
        "steps": next_steps(device),
        "exports": listed(device.folder / "exports.json"),
        "rejected": [s for s in device.sessions if s.rejected],
        "data": [data_table(device), source_table(device)],
        "warnings": warnings(device),
        "series": [p for s in device.used for p in session_pictures(device, s, figures)],
        "segments": segment_table(device),
        "poses": poses,
        "basis": [
            (sensor, METHOD_WORDS[getattr(final, sensor).method]) for sensor in SENSORS if final
        ],
        "reasons": reasons(device),
        "parameters": [t for s in SENSORS if (t := parameter_table(device, s))],
        "matrices": correlation_matrices(device, figures),
        "model": [model_table(device, s) for s in SENSORS if final],
        "allan": [
            p for s in device.used if s.has_allan for p in allan_pictures(device, s, figures)
        ],
        "spectra": [p for s in device.used for p in density_pictures(device, s, figures)],
        "autocorrelations": [
            p for s in device.used for p in correlation_pictures(device, s, figures)
        ],
        "deviations": [p for s in device.used for p in deviation_pictures(device, s, figures)],
        "coefficients": [coefficient_table(device, s) for s in SENSORS if device.noise],
        "coefficient_note": coefficient_note(device),
        "uncut": [t for s in SENSORS if (t := uncut_table(device, s))],
        "stability": [stability_table(device, s) for s in SENSORS if device.noise],
        "statistics": statistics_tables(device),
        "heldout": heldout_table(device),
        "attitude": attitude_part(device, figures),
    }
