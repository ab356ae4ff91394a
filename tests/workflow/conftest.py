"""A run of the workflow on a small config for all tests of it."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml

from family.test_prior import ERROR, calibration_of
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth
from workflow.run import snakemake

PARTS = ("Snakefile", "profiles", "workflow", "scripts", "data/replicas")
QUICK = {"diagnose": {"folds": 3}}
RESTING = {
    "label": "Rest & <b>peace</b>",
    "sessions": {"rest": {"kind": "static", "file": "rest.parquet"}},
}
FACES = {"faces": {"kind": "six_position", "format": "euroc", "file": "faces"}}
CONFIG = {
    "defaults": QUICK,
    "devices": {
        # its only static session is of no use: the noise has to come from a rest of the others
        "posed": {
            "type": "pair",
            "sessions": {
                "poses": {"kind": "multi_position", "file": "logs in/p.csv"},
                "broken": {"kind": "static", "file": "broken.csv"},
            },
        },
        # one of its logs is faulty
        "resting": RESTING | {"prior": "earlier.json", "sessions": RESTING["sessions"] | FACES},
    },
}
# columns of a sensor's folder of EuRoC
EUROC = {f"g{x}": f"w_RS_S_{x} [rad s^-1]" for x in "xyz"}
EUROC |= {f"a{x}": f"a_RS_S_{x} [m s^-2]" for x in "xyz"}


def copy_checkout(repository, folder):
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
    return copy_checkout(repository, tmp_path_factory.mktemp("checkout"))


@pytest.fixture(scope="session")
def truth():
    truth = example_truth(rate=50.0)
    plans, short = truth.sessions, {"initial_rest_s": 10.0, "rest_s": (2.0, 3.0)}
    return replace(
        truth,
        sessions={
            "static": replace(plans["static"], duration_s=60.0),
            "six_position": replace(plans["six_position"], **short),
            "multi_position": replace(plans["multi_position"], poses=16, **short),
        },
    )


@pytest.fixture(scope="session")
def logs(truth):
    return {kind: simulate_session(truth, kind) for kind in truth.sessions}


@pytest.fixture(scope="session")
def finished_run(checkout, logs, truth, tmp_path_factory):
    """A folder in which the workflow ran once, and its output."""
    folder = tmp_path_factory.mktemp("work")
    for name in ("logs in", "faces"):
        (folder / name).mkdir()
    write_log(folder / "logs in/p.csv", logs["multi_position"], {})
    swapped = {"gx": logs["six_position"]["gy"], "gy": logs["six_position"]["gx"]}
    faces = logs["six_position"].assign(**swapped)[["t", *EUROC]].rename(columns=EUROC)
    faces = faces.assign(t=(1e9 * faces["t"]).round().astype(int))
    faces.rename(columns={"t": "#timestamp [ns]"}).to_csv(folder / "faces/data.csv", index=False)
    write_log(folder / "rest.parquet", logs["static"], {})
    earlier = calibration_of("resting", np.zeros(len(ERROR)))
    earlier.to_json(folder / "earlier.json")
    (folder / "broken.csv").write_text("t,ax,ay,az,gx,gy,gz\n" + "0,0,0,9.8,0,0,nan\n" * 50)
    (folder / "config.yaml").write_text(yaml.safe_dump(CONFIG, sort_keys=False))
    return folder, snakemake(checkout, folder, target=None)
