"""The report of simulated devices, one of each kind that a report meets, through all stages."""

from dataclasses import replace

import numpy as np

from diagnose.test_search import G_SENSITIVITY, MATRIX, with_effect
from imuloop import Calibration, chain
from imuloop.core.files import read_json, write_json
from imuloop.effects.temperature import BiasTemperature
from imuloop.report.report import write_report
from imuloop.simulate.simulate import log_metadata, simulate_session, write_log
from imuloop.simulate.truth import SessionTruth, example_truth
from quick import hurry

PROVENANCE = {
    "imuloop": "0.2.0",
    "commit": "0123abc",
    "command": "snakemake -c2 results/report.html",
    "versions": {"numpy": "2.0"},
    "config": {"devices": {"board": {"label": "<b>&"}}},
}
HOSTILE = '<script>alert(1)</script> $x_2$ & "_b"'
DEVICES = {
    # all kinds of sessions, an effect, and errors that none explains
    "board": ("Board A", {"long": "static", "faces": "six_position", "turns": "multi_position"}),
    # biases that go with the temperature
    "still": (HOSTILE, {"night": "static"}),
    "partly": ("_Board B $\\frac{1}{2}$", {"rest": "static", "turns": "multi_position"}),
    "nothing": ("Board C", {"turns": "multi_position"}),
}
REJECTED = {("partly", "turns"), ("nothing", "turns")}
PLANS = {
    "static": SessionTruth("static", duration_s=1200.0),
    "six_position": SessionTruth("six_position", initial_rest_s=10.0),
    "multi_position": SessionTruth("multi_position", poses=16, initial_rest_s=10.0),
}
WARM = replace(PLANS["static"], temperature=((0, 20), (600, 40), (1200, 25)))
PLAIN = example_truth(rate=25.0, sessions=PLANS)


def warming(truth):
    """Return the device, at rest alone, with biases that go with its temperature."""
    for sensor, slope in (("accelerometer", 3e-3), ("gyroscope", 2e-4)):
        truth = with_effect(sensor, BiasTemperature(1, 25.0), [slope, -slope, 2 * slope], truth)
    return replace(truth, sessions={"static": WARM})


SENSITIVE = with_effect("gyroscope", G_SENSITIVITY, np.ravel(MATRIX).tolist(), PLAIN)
TRUTHS = {"board": SENSITIVE, "still": warming(PLAIN), "partly": PLAIN, "nothing": PLAIN}


def build(folder):
    """Write results/<device>/… of all devices and the report into a folder; return it."""
    for name, (label, kinds) in DEVICES.items():
        device = chain.Device(name, folder / name, kinds, label, diagnose={"folds": 3})
        for seed, (session, kind) in enumerate(kinds.items()):
            path = folder.parent / f"{name}_{session}.parquet"
            log = simulate_session(TRUTHS[name], kind, seed)
            if (name, session) in REJECTED:
                log["gx"] = np.nan
            # only the logs of `still` say that they are simulated
            about = log_metadata(TRUTHS[name], kind)
            write_log(path, log, about) if name == "still" else log.to_parquet(path)
            chain.ingest(device, session, {}, [path], reject=True)
        with hurry(name):
            for stage in chain.stages():
                stage(device)
        if name == "board":
            doubt_gyroscope(device)
        chain.report_device(device)
    joined_report(folder, DEVICES, folder)
    return folder


def doubt_gyroscope(device):
    """Have errors of a device's gyroscope at rest unexplained."""
    diagnosis = read_json(device.file("diagnosis.json"))
    diagnosis["sensors"]["gyroscope"]["static_record"]["verdict"] = "unexplained"
    write_json(device.file("diagnosis.json"), diagnosis)
    calibration = Calibration.from_json(device.file("calibration.json"))
    gyroscope = replace(calibration.gyroscope, verdict="unexplained")
    replace(calibration, gyroscope=gyroscope).to_json(device.file("calibration.json"))


def joined_report(folder, devices, to):
    folders = [folder / device for device in devices]
    write_report(folders, PROVENANCE, to / "report.html", to / "comparison.csv")
