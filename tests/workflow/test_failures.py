"""A stage that fails is a result of its device: later stages say so, the report names it first."""

import csv
import json
import re
import shutil
import warnings
from functools import partial

import numpy as np
import pyarrow.parquet as pq
import pytest

from imuloop import chain
from imuloop.report.report import write_report
from quick import DRAW, blank

# for the user, in place of what a numerical library says
WHY = "an error in the code of imuloop (LinAlgError)"
STAGES = ("ingest", "segment", "noise", "calibrate", "diagnose", "allan", "export", "report_device")


@pytest.fixture(scope="module")
def results(logs, tmp_path_factory):
    """Results of a good device and of one for each stage, which fails in it; and their report."""
    folder = tmp_path_factory.mktemp("results")
    logs["six_position"].to_parquet(folder / "faces.parquet")
    attempt, settings = chain.attempt, {"diagnose": {"draws": 100, "folds": 3}}

    def failing(device, stage, work, *others):
        def forced():
            raise np.linalg.LinAlgError(f"forced in {stage}")

        return attempt(device, stage, forced if device.name == f"bad_{stage}" else work, *others)

    def work(name):
        device = chain.Device(name, folder / name, {"faces": "six_position"}, **settings)
        ingest = partial(chain.ingest, device, "faces", {}, [folder / "faces.parquet"])
        others = (*chain.stages(), chain.export, chain.report_device)
        return [ingest, *(partial(stage, device) for stage in others)]

    good = work("good")
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        # what counts is in the results
        warnings.simplefilter("ignore")
        patch.setattr(chain, "attempt", failing)
        patch.setattr(DRAW, blank)
        for place, stage in enumerate(STAGES):
            # up to that stage it is the good device
            if place:
                shutil.copytree(folder / "good", folder / f"bad_{stage}")
            failures = [each for left in work(f"bad_{stage}")[place:] for each in left()]
            assert [failure.stage for failure in failures] == [stage]
            assert good[place]() == []
    provenance = {"imuloop": "0", "commit": "", "command": "", "config": {}, "versions": {}}
    folders = [folder / name for name in (*(f"bad_{stage}" for stage in STAGES), "good")]
    write_report(folders, provenance, folder / "report.html", folder / "comparison.csv")
    return folder


@pytest.mark.parametrize("stage", STAGES)
def test_what_follows_is_not_testable_with_the_reason(results, stage):
    folder, reason = results / f"bad_{stage}", f"{stage} failed: {WHY}"

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
                pq.read_table(path / f"{name}.parquet") for path in (results / "good", folder)
            )
            assert (len(good), len(bad), good.schema) == (count, 0, bad.schema)
    if stage in ("noise", "calibrate", "diagnose", "export"):
        assert list(read("exports.json")["sha256"]) == ["README.txt"]
        assert reason in (folder / "exports/README.txt").read_text()
    if stage != "allan":
        summary = read("summary.json")
        assert summary["status"] == "failed"
        assert {f["stage"] for f in summary["failed"]} == {stage}
        section = (folder / "section.html").read_text()
        assert WHY in section and "Nothing needed" not in section


def test_the_report_and_the_comparison_name_the_failed_first(results):
    page = (results / "report.html").read_text()
    first = page.index("Devices in which a stage failed")
    for stage in set(STAGES) - {"allan"}:
        assert page.index(f"bad_{stage}</a>", first) < page.index("Accelerometers, value")
    # no link leads nowhere
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(re.findall(r'id="([^"]+)"', page))
    with open(results / "comparison.csv", encoding="utf-8") as file:
        rows = {row["device"]: row for row in csv.DictReader(file)}
    for stage in set(STAGES) - {"allan"}:
        assert rows[f"bad_{stage}"]["status"] == "failed"
        assert f"{stage} failed: {WHY}" in rows[f"bad_{stage}"]["why"]
    assert rows["good"]["status"] == "ok" and not rows["good"]["why"]


def test_curves_that_were_cut_fail_their_stage_alone(results, tmp_path):
    folder = shutil.copytree(results / "good", tmp_path / "cut")
    raw = folder / "allan_raw.parquet"
    raw.write_bytes(raw.read_bytes()[:-100])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (failure,) = chain.allan(chain.Device("cut", folder, {"faces": "six_position"}))
    assert "allan_raw.parquet: no whole Parquet file" in failure.why
    curves, whole = (
        pq.read_table(path / "faces/allan.parquet") for path in (folder, results / "good")
    )
    assert (len(curves), curves.schema) == (0, whole.schema)
