"""Two runs of the workflow on small configs, in folders of their own, for all tests of it."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml

from imuloop.core.samples import ANGULAR_RATE, CHANNELS
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth
from workflow.run import snakemake

PARTS = ("Snakefile", "profiles", "workflow", "scripts", "data/replicas")
QUICK = {"diagnose": {"draws": 100, "folds": 3}}
RESTING = {
    "label": "Rest & <b>peace</b>",
    "sessions": {"rest": {"kind": "static", "file": "rest.parquet"}},
}


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
    "zeros": ("static", zeros, "ok", "exactly zero on all axes"),
    "stuck": ("static", stuck, "ok", "stuck at one value: gy"),
    "swapped": (
        *("six_position", swapped, "ok"),
        "fits the turns of gravity with x as gy, y as gx, z as gz",
    ),
    "in_degrees": ("six_position", in_degrees, "rejected", "it looks like deg/s"),
    "missing": ("static", missing, "rejected", "non-finite"),
    "garbage": ("static", None, "rejected", ""),
}


def copied(repository, folder):
    """Copy the workflow to a folder."""
    for part in PARTS:
        source = repository / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / part)
    return folder


@pytest.fixture(scope="session")
def checkout(repository, tmp_path_factory):
    """A copy of the workflow, to be edited."""
    return copied(repository, tmp_path_factory.mktemp("checkout"))


@pytest.fixture(scope="session")
def logs():
    """Short logs of a simulated device by kind."""
    truth = example_truth(rate=50.0)
    plans, short = truth.sessions, {"initial_rest_s": 10.0, "rest_s": (2.0, 3.0)}
    truth = replace(
        truth,
        sessions={
            "static": replace(plans["static"], duration_s=60.0),
            "six_position": replace(plans["six_position"], **short),
            "multi_position": replace(plans["multi_position"], poses=16, **short),
        },
    )
    return {kind: simulate_session(truth, kind) for kind in truth.sessions}


@pytest.fixture(scope="session")
def config():
    return {
        "defaults": QUICK,
        "devices": {
            # its only static session is of no use: the noise has to come from a rest of the others
            "posed": {
                "sessions": {
                    "poses": {"kind": "multi_position", "file": "logs in/p.csv"},
                    "faces": {"kind": "six_position", "file": "faces.csv"},
                    "broken": {"kind": "static", "file": "broken.csv"},
                }
            },
            "resting": RESTING,
        },
    }


@pytest.fixture(scope="session")
def finished(checkout, config, logs, tmp_path_factory):
    """A folder in which the workflow ran once, and what it printed."""
    folder = tmp_path_factory.mktemp("work")
    (folder / "logs in").mkdir()
    write_log(folder / "logs in/p.csv", logs["multi_position"], {})
    write_log(folder / "faces.csv", logs["six_position"], {})
    write_log(folder / "rest.parquet", logs["static"], {})
    (folder / "broken.csv").write_text("t,ax,ay,az,gx,gy,gz\n" + "0,0,0,9.8,0,0,nan\n" * 50)
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return folder, snakemake(checkout, folder)


@pytest.fixture(scope="session")
def beside(repository, logs, tmp_path_factory):
    """The resting device beside one of faulty logs and one that fails in a stage."""
    source = copied(repository, tmp_path_factory.mktemp("failing"))
    path = source / "workflow/lib/imuloop/noise/noise.py"
    path.write_text(
        path.read_text() + "\n\ndef estimate_noise(device, *args, _own=estimate_noise, **more):\n"
        '    if device == "failing":\n        raise ArithmeticError("forced")\n'
        "    return _own(device, *args, **more)\n"
    )
    folder = tmp_path_factory.mktemp("beside")
    write_log(folder / "rest.parquet", logs["static"], {})
    for name, (kind, fault, *_) in FAULTY.items():
        if fault:
            changed = logs[kind].copy()
            fault(changed)
            write_log(folder / f"{name}.csv", changed, {})
        else:
            noise = np.random.default_rng(1).integers(0, 256, 20_000, dtype=np.uint8)
            (folder / f"{name}.csv").write_bytes(noise.tobytes())
    sessions = {name: {"kind": kind, "file": f"{name}.csv"} for name, (kind, *_) in FAULTY.items()}
    failing = {"sessions": RESTING["sessions"]}
    devices = {"faulty": {"sessions": sessions}, "failing": failing, "resting": RESTING}
    (folder / "config.yaml").write_text(yaml.safe_dump({"defaults": QUICK, "devices": devices}))
    return folder, snakemake(source, folder)
