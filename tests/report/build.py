"""The report of the plausible results, as the workflow's two rules make it."""

from imuloop.report.page import write_device
from imuloop.report.report import write_report
from imuloop.report.section import write_section
from report.plausible_results import write_results

PROVENANCE = {
    "commit": "0123abc",
    "command": "snakemake -c2 results/report.html",
    "versions": {"numpy": "2.0"},
    "config": {"devices": {"board": {"label": "<b>&"}}},
}


def build(folder, repository):
    """Write results and report of all devices into `folder`; return it."""
    devices = write_results(folder)
    for device, (label, kinds) in devices.items():
        write_section(
            device=device,
            label=label,
            folder=folder / device,
            sessions=kinds,
            template=repository / "workflow/templates/section.html.j2",
            section_path=folder / device / "section.html",
            summary_path=folder / device / "summary.json",
            figures_folder=folder / device / "figures",
        )
        device_page(folder / device, repository)
    joined_report(folder, devices, repository, folder)
    return folder


def device_page(folder, repository):
    """Write the page of a device whose part is in its folder."""
    templates = repository / "workflow/templates"
    write_device(
        folder / "report.html",
        folder / "section.html",
        folder / "summary.json",
        template=templates / "device.html.j2",
        style=templates / "style.css",
        script=templates / "sorting.js",
    )


def joined_report(folder, devices, repository, to):
    """Write report and comparison of some devices of a results folder."""
    templates = repository / "workflow/templates"
    write_report(
        sections=[folder / device / "section.html" for device in devices],
        summaries=[folder / device / "summary.json" for device in devices],
        exports=[folder / device / "exports.json" for device in devices],
        template=templates / "report.html.j2",
        style=templates / "style.css",
        script=templates / "sorting.js",
        provenance=PROVENANCE,
        report_path=to / "report.html",
        comparison_path=to / "comparison.csv",
    )
