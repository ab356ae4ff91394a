"""The report of the plausible results, as the workflow's two rules make it."""

from imuloop.chain import Device
from imuloop.report.report import write_report
from imuloop.report.section import write_section
from report.plausible_results import write_results

PROVENANCE = {
    "imuloop": "0.2.0",
    "commit": "0123abc",
    "command": "snakemake -c2 results/report.html",
    "versions": {"numpy": "2.0"},
    "config": {"devices": {"board": {"label": "<b>&"}}},
}


def build(folder):
    devices = write_results(folder)
    for device, (label, kinds) in devices.items():
        write_section(Device(device, folder / device, kinds, label))
    joined_report(folder, devices, folder)
    return folder


def joined_report(folder, devices, to):
    folders = [folder / device for device in devices]
    write_report(folders, PROVENANCE, to / "report.html", to / "comparison.csv")
