"""A stage that fails is a result of its device: the others are whole, the report names it first."""

import csv
import hashlib
import json
import re
import shutil
from dataclasses import replace

import pyarrow.parquet as pq
import pytest
import yaml

from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth
from workflow.conftest import PARTS
from workflow.run import snakemake

STAGES = ("ingest", "segment", "noise", "calibrate", "diagnose", "export", "report_device")
GOOD = ("good_a", "good_b")
LOGS = {"rest": "static", "faces": "six_position"}
# put before the work of a stage: an error that nobody foresaw
WORK = "    try:\n        work()\n"
FORCED = """
    def forced(work=work):
        if device.name == f"bad_{stage}":
            raise ArithmeticError(f"forced in {stage}")
        work()

    work = forced
"""


@pytest.fixture(scope="module")
def runs(repository, tmp_path_factory):
    """Two good devices alone, and beside one device for each stage that fails in it."""
    checkout = tmp_path_factory.mktemp("checkout")
    for part in PARTS:
        source = repository / part
        copy = shutil.copytree if source.is_dir() else shutil.copy
        copy(source, checkout / part)
    truth = example_truth(rate=50.0)
    static = replace(truth.sessions["static"], duration_s=40.0)
    faces = replace(truth.sessions["six_position"], initial_rest_s=8.0, rest_s=(2.0, 3.0))
    truth = replace(truth, sessions={"rest": static, "faces": faces})
    folders = [tmp_path_factory.mktemp(name) for name in ("alone", "beside")]
    bad = tuple(f"bad_{stage}" for stage in STAGES)
    done = []
    for folder, names in zip(folders, (GOOD, (GOOD[0], *bad, GOOD[1])), strict=True):
        for name in LOGS:
            write_log(folder / f"{name}.csv", simulate_session(truth, name), {})
        sessions = {name: {"kind": kind, "file": f"{name}.csv"} for name, kind in LOGS.items()}
        config = {
            "defaults": {"diagnose": {"draws": 100, "folds": 3}},
            "devices": {name: {"sessions": sessions} for name in names},
        }
        (folder / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))
        if folder == folders[1]:
            path = checkout / "workflow/lib/imuloop/core/failure.py"
            source = path.read_text()
            assert source.count(WORK) == 1
            path.write_text(source.replace(WORK, FORCED + WORK))
        done.append(snakemake(checkout, folder))
    return list(zip(folders, done, strict=True))


def test_the_run_ends_well_and_the_terminal_says_what_failed(runs):
    _, (folder, done) = runs
    assert done.returncode == 0, done.stderr
    for stage in STAGES:
        logs = f"logs/{stage}/bad_{stage}" + ("/rest" if stage == "ingest" else "") + ".log"
        line = f"bad_{stage}: {stage} failed: forced in {stage}; the traceback is in {logs}"
        # written at once; what Snakemake has begun to write may stand before it
        assert f"{line}\n" in done.stderr
        assert "ArithmeticError: forced in" in (folder / logs).read_text()
    assert "Traceback" not in done.stdout + done.stderr


def test_the_files_of_good_devices_are_the_same_bytes(runs):
    (alone, first), (beside, _) = runs
    assert first.returncode == 0, first.stderr
    for device in GOOD:
        files = sorted(p for p in (alone / "results" / device).rglob("*") if p.is_file())
        assert len(files) > 20
        for path in files:
            other = beside / path.relative_to(alone)
            digests = [hashlib.sha256(p.read_bytes()).hexdigest() for p in (path, other)]
            assert digests[0] == digests[1], path


@pytest.mark.parametrize("stage", STAGES)
def test_what_follows_is_not_testable_with_the_reason(runs, stage):
    folder = runs[1][0] / "results" / f"bad_{stage}"
    reason = f"{stage} failed: forced in {stage}"

    def read(name):
        return json.loads((folder / name).read_text())

    if stage in ("ingest", "segment"):
        # of a session alone; here it is each of them, and nothing is left
        assert read("noise.json")["axes"]["ax"]["N"]["upper95"] is None
        assert read("calibration.json")["accelerometer"]["method"] == "nominal"
    if stage in ("noise", "calibrate"):
        assert read("multi_position.json")["accelerometer"]["not_testable"] == reason
    if stage in ("noise", "calibrate", "diagnose"):
        for sensor in read("diagnosis.json")["sensors"].values():
            for part in sensor.values():
                assert (part["verdict"], part["why"]) == ("not_testable", reason)
        assert read("attitude.json")["why"] == reason
        for name, count in (("poses", 6), ("moves", 0)):
            good, bad = (
                pq.read_table(path / f"{name}.parquet")
                for path in (folder.parent / GOOD[0], folder)
            )
            assert (len(good), len(bad)) == (count, 0)
            assert good.schema == bad.schema
    if stage in ("noise", "calibrate", "diagnose", "export"):
        assert list(read("exports.json")["sha256"]) == ["README.txt"]
        assert reason in (folder / "exports/README.txt").read_text()
    summary = read("summary.json")
    assert summary["status"] == "failed"
    assert {f["stage"] for f in summary["failed"]} == {stage}
    section = (folder / "section.html").read_text()
    assert f"forced in {stage}" in section and "Nothing needed" not in section


def test_the_report_and_the_comparison_name_the_failed_first(runs):
    folder = runs[1][0]
    page = (folder / "results/report.html").read_text()
    first = page.index("Devices in which a stage failed")
    assert first < page.index('id="rejected"')
    for stage in STAGES:
        assert page.index(f"bad_{stage}</a>", first) < page.index("Which device is better")
        assert f"logs/{stage}/bad_{stage}" in page
    # no link leads nowhere
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(re.findall(r'id="([^"]+)"', page))
    with open(folder / "results/comparison.csv", encoding="utf-8") as file:
        rows = {row["device"]: row for row in csv.DictReader(file)}
    assert [row["status"] for row in rows.values()] == ["failed"] * len(STAGES) + ["ok"] * 2
    for stage in STAGES:
        assert f"{stage} failed: forced in {stage}" in rows[f"bad_{stage}"]["why"]
    assert not rows["good_a"]["why"]
