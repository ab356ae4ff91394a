"""Two devices that name one board, and one type, through the workflow."""

import json

import pytest
import yaml

from bench.result_files import fault
from board.boards import SESSION, logs
from calibrate.devices import planned
from imuloop.simulate.truth import example_truth
from workflow.run import snakemake

DEVICES = ("left", "right")
BOARD = "results/boards/wing/board.json"
TYPE = "results/types/pair/type.json"


@pytest.fixture(scope="module")
def ran(repository, tmp_path_factory):
    folder, short = tmp_path_factory.mktemp("board"), {"initial_rest_s": 10.0, "rest_s": (2.0, 3.0)}
    found = logs(4, planned(example_truth(rate=50.0), poses=16, **short))
    entries = {}
    for name, log in zip(DEVICES, found, strict=False):
        log.to_csv(folder / f"{name}.csv", index=False)
        entries[name] = {"sessions": {"poses": {"kind": SESSION, "file": f"{name}.csv"}}}
    defaults = {"board": "wing", "type": "pair", "diagnose": {"draws": 100, "folds": 3}}
    (folder / "config.yaml").write_text(yaml.safe_dump({"defaults": defaults, "devices": entries}))
    return folder, snakemake(repository, folder, target=BOARD)


def test_a_board_waits_for_its_devices(ran):
    folder, done = ran
    assert done.returncode == 0, done.stderr
    content = json.loads((folder / BOARD).read_text())
    assert fault(folder / BOARD) is None
    assert content["status"] == "ok" and [*content["devices"]] == [*DEVICES]
    assert content["devices"]["right"]["arm"][0] == pytest.approx(0.02, abs=2e-3)


def test_a_type_waits_for_its_devices(repository, ran):
    folder, _ = ran
    done = snakemake(repository, folder, target=TYPE)
    assert done.returncode == 0, done.stderr
    assert fault(folder / TYPE) is None
    sensors = json.loads((folder / TYPE).read_text())["sensors"]
    # nothing was put into them
    assert sensors["accelerometer"]["status"] == "nothing" and not any(
        own["left_out"] for own in sensors.values()
    )


def test_the_report_waits_for_the_board_and_nothing_is_done_twice(repository, ran):
    folder, _ = ran
    (folder / BOARD).unlink()
    planned = snakemake(repository, folder, "-n").stdout
    assert "rule board" in planned and "rule report" in planned
    assert "rule ingest" not in planned and "rule diagnose" not in planned
