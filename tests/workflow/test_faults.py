"""A good device beside faulty ones, through the whole workflow: its results stay the same."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from imuloop.core.samples import ANGULAR_RATE, CHANNELS
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth
from workflow.run import snakemake

GOOD = {"sessions": {"faces": {"kind": "six_position", "file": "faces.csv"}}}


def zeros(log):
    log.loc[500:600, list(CHANNELS)] = 0.0


def stuck(log):
    log.loc[500:900, "gy"] = log["gy"].iloc[500]


def swapped(log):
    log[["gx", "gy"]] = log[["gy", "gx"]].to_numpy()


def missing(log):
    log.loc[::3, "az"] = np.nan


def in_degrees(log):
    log[list(ANGULAR_RATE)] = np.degrees(log[list(ANGULAR_RATE)])


# name: (log, fault, status, text of a warning or reason)
FAULTY = {
    "zeros": ("rest", zeros, "ok", "exactly zero on all axes"),
    "stuck": ("rest", stuck, "ok", "stuck at one value: gy"),
    "swapped": ("faces", swapped, "ok", "fits the turns of gravity with x as gy, y as gx, z as gz"),
    "in_degrees": ("faces", in_degrees, "rejected", "it looks like deg/s"),
    "missing": ("rest", missing, "rejected", "non-finite"),
    "garbage": ("rest", None, "rejected", ""),
}


def ran(checkout, folder, logs, devices, target):
    """Run the workflow on devices; return the folder and the finished process."""
    for name, log in logs.items():
        write_log(folder / f"{name}.csv", log, {})
    for name, (log, fault, *_) in FAULTY.items():
        if fault:
            changed = logs[log].copy()
            fault(changed)
            write_log(folder / f"{name}.csv", changed, {})
        else:
            noise = np.random.default_rng(1).integers(0, 256, 20_000, dtype=np.uint8)
            (folder / f"{name}.csv").write_bytes(noise.tobytes())
    quick = {"diagnose": {"draws": 100, "folds": 3}}
    (folder / "config.yaml").write_text(yaml.safe_dump({"defaults": quick, "devices": devices}))
    return folder, snakemake(checkout, folder, target=target)


@pytest.fixture(scope="module")
def runs(checkout, tmp_path_factory):
    """The good device alone, and among faulty ones."""
    truth = example_truth(rate=50.0)
    static = replace(truth.sessions["static"], duration_s=40.0)
    faces = replace(truth.sessions["six_position"], initial_rest_s=8.0, rest_s=(2.0, 3.0))
    truth = replace(truth, sessions={"static": static, "six_position": faces})
    logs = {
        "rest": simulate_session(truth, "static"),
        "faces": simulate_session(truth, "six_position"),
    }
    kinds = {"rest": "static", "faces": "six_position"}
    sessions = {
        name: {"kind": kinds[log], "file": f"{name}.csv"} for name, (log, *_) in FAULTY.items()
    }
    alone, beside = (tmp_path_factory.mktemp(name) for name in ("alone", "beside"))
    return (
        ran(checkout, alone, logs, {"good": GOOD}, "results/good/section.html"),
        ran(
            *(checkout, beside, logs),
            {"faulty": {"sessions": sessions}, "good": GOOD},
            "results/report.html",
        ),
    )


def test_the_results_of_a_good_device_are_the_same_beside_faulty_ones(runs):
    (alone, first), (beside, second) = runs
    assert first.returncode == 0, first.stderr
    assert second.returncode == 0, second.stderr

    def digests(folder):
        files = sorted(p for p in (folder / "results/good").rglob("*") if p.is_file())
        return {
            str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files
        }

    assert len(digests(alone)) > 10
    assert digests(alone) == digests(beside)


def test_each_fault_is_told_without_a_traceback(runs):
    _, (folder, done) = runs
    for name, (_, _, status, text) in FAULTY.items():
        quality = json.loads((folder / f"results/faulty/{name}/quality.json").read_text())
        assert quality["status"] == status, name
        said = quality["reasons"] if status == "rejected" else quality["warnings"]
        assert any(text in line for line in said), (name, said)
        rejected = "rejected: " if status == "rejected" else ""
        told = [line for line in done.stderr.splitlines() if f"faulty/{name}: {rejected}" in line]
        assert any(" ".join(text.split()) in line for line in told), (name, told)
        assert name in (folder / "results/faulty/section.html").read_text()
    texts = {p: p.read_text() for p in (folder / "logs").rglob("*") if p.is_file()}
    assert len(texts) > 10
    assert not [p for p, text in texts.items() if "Traceback" in text]
    assert "Traceback" not in done.stdout + done.stderr
