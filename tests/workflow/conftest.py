"""One run of the workflow on a small config in a folder of its own, for all tests of it."""

import shutil
from dataclasses import replace

import pytest
import yaml

from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth
from workflow.run import snakemake

PARTS = ("Snakefile", "profiles", "workflow", "scripts", "data/replicas")


@pytest.fixture(scope="session")
def checkout(repository, tmp_path_factory):
    """A copy of the workflow, to be edited."""
    folder = tmp_path_factory.mktemp("checkout")
    for part in PARTS:
        source = repository / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / part)
    return folder


@pytest.fixture(scope="session")
def config():
    quick = {"draws": 100, "folds": 3}
    return {
        "defaults": {"diagnose": quick},
        "devices": {
            # its only static session is of no use: the noise has to come from a rest of the others
            "posed": {
                "sessions": {
                    "poses": {"kind": "multi_position", "file": "logs in/p.csv"},
                    "faces": {"kind": "six_position", "file": "faces.csv"},
                    "broken": {"kind": "static", "file": "broken.csv"},
                }
            },
            "resting": {
                "label": "Rest & <b>peace</b>",
                "sessions": {"rest": {"kind": "static", "file": "rest.parquet"}},
            },
        },
    }


@pytest.fixture(scope="session")
def finished(checkout, config, tmp_path_factory):
    """A folder in which the workflow ran once, and what it printed."""
    folder = tmp_path_factory.mktemp("work")
    truth = example_truth()
    sessions = {
        **truth.sessions,
        "static": replace(truth.sessions["static"], duration_s=120.0),
        "multi_position": replace(
            truth.sessions["multi_position"], poses=16, initial_rest_s=10.0, rest_s=(2.0, 3.0)
        ),
    }
    truth = replace(truth, sessions=sessions)
    (folder / "logs in").mkdir()
    write_log(folder / "logs in/p.csv", simulate_session(truth, "multi_position"), {})
    write_log(folder / "faces.csv", simulate_session(truth, "six_position"), {})
    write_log(folder / "rest.parquet", simulate_session(truth, "static"), {})
    (folder / "broken.csv").write_text("t,ax,ay,az,gx,gy,gz\n" + "0,0,0,9.8,0,0,nan\n" * 50)
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return folder, snakemake(checkout, folder)
