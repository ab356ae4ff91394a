"""The report of the plausible results, as the workflow's two rules make it."""

from imuloop.core.files import write_json
from imuloop.report.report import write_report
from imuloop.report.section import write_section
from report.plausible_results import write_results

PROVENANCE = {
    "commit": "0123abc",
    "command": "snakemake -c2 results/report.html",
    "versions": {"numpy": "2.0"},
    "config": {"devices": {"board": {"label": "<b>&"}}},
}


def build(folder):
    """Write results and report of all devices into `folder`; return it."""
    devices = write_results(folder)
    for device, (label, kinds) in devices.items():
        write_section(device, label, folder / device, kinds)
    path = folder / "boards/wing/board.json"
    write_json(path, plausible_board([*devices]))
    joined_report(folder, devices, folder, [path])
    return folder


def plausible_board(devices):
    """Return board.json of two devices and of one without a log."""
    test = {"n": 20, "error": 2e-3, "floor": 1e-3, "p_value": 0.3, "p_value_slow_noise": 0.9}
    sound, slow = test | {"verdict": "consistent", "why": None}, "it is slow"
    axes = {"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "rotation_std": [1e-4] * 3}
    place = axes | {"arm": [0.02, -0.01, 0.0], "arm_std": [1e-4] * 3}
    first, second, third = devices[:3]
    return {
        "format": 1,
        "board": "wing",
        "status": "ok",
        "why": None,
        "reference": first,
        "sessions": {"a": {"why": None, "rests": 9, "moves": 8}, "b": {"why": "<b>late</b>"}},
        "devices": {
            first: place | {"turn": sound, "gravity_norm": sound},
            second: place
            | {"turn": test | {"verdict": "undecided", "why": slow}}
            | {"gravity_norm": {"verdict": "not_testable", "why": "no scale"}},
            third: {"why": "all its sessions were rejected"},
        },
        "common": {"closure": test | {"verdict": "common", "why": None}, "gravity_norm": sound},
    }


def joined_report(folder, devices, to, boards=()):
    """Write report and comparison of some devices of a results folder."""
    folders = [folder / device for device in devices]
    write_report(folders, PROVENANCE, to / "report.html", to / "comparison.csv", boards)
