"""The report of the plausible results, as the workflow's two rules make it."""

from imuloop.core.files import write_json
from imuloop.discover.family import no_type
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
    devices = write_results(folder)
    for device, (label, kinds) in devices.items():
        write_section(device, label, folder / device, kinds)
    path = folder / "boards/wing/board.json"
    write_json(path, plausible_board([*devices]))
    kind = folder / "types/pair/type.json"
    write_json(kind, plausible_type([*devices]))
    joined_report(folder, devices, folder, [path], [kind])
    return folder


def plausible_type(devices):
    """Return type.json of two devices, one of which has a formula, and of one without poses."""
    first, second, third = devices[:3]
    held = {"before": 2e-3, "after": 1e-3, "ratio": 0.5, "ratio_ci95": [0.4, 0.7]}
    shown = {"values": {"x: fy^2*fz": 3e-5}, "std": {"x: fy^2*fz": 2e-6}}
    one = {"has": True, "p_value": 1e-9, **shown, "residuals": {"gravity_norm": held}}
    found = {"status": "named", "why": None, "searched": 430, "chance": 1e-3, "margin": 12.0}
    found |= {"formula": "x: fy^2*fz", "imitators": ["z: fx*fy^2"], "left_out": {third: "<b>late"}}
    found["devices"] = {first: one, second: one | {"has": False, "p_value": 0.4}}
    return no_type("pair", None) | {"sensors": {"accelerometer": found}}


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


def joined_report(folder, devices, to, boards=(), types=()):
    folders = [folder / device for device in devices]
    write_report(folders, PROVENANCE, to / "report.html", to / "comparison.csv", boards, types)
