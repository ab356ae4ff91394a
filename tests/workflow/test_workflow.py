"""The workflow from end to end, on a small config in a folder of its own."""

import hashlib
import json
import re

import pandas as pd
import pytest
import yaml

from workflow.run import snakemake


def test_a_csv_log_becomes_a_report(finished):
    folder, done = finished
    assert done.returncode == 0, done.stderr
    report = (folder / "results/report.html").read_text()
    assert "posed" in report
    # a label from the config is text, never markup
    assert "Rest &amp; &lt;b&gt;peace&lt;/b&gt;" in report
    assert "<b>peace" not in report
    comparison = pd.read_csv(folder / "results/comparison.csv")
    assert len(comparison) == 2
    for device, session in (("posed", "faces"), ("resting", "rest")):
        results = folder / "results" / device
        for name in ("noise", "six_position", "multi_position", "calibration", "diagnosis"):
            assert json.loads((results / f"{name}.json").read_text())["device"] == device
        for name in ("samples", "segments", "allan"):
            assert len(pd.read_parquet(results / session / f"{name}.parquet"))


def test_results_that_a_restored_cache_needs_are_all_there(finished):
    folder, _ = finished
    assert {path.name for path in folder.iterdir()} >= {"results", "logs", "benchmarks"}
    assert all(path.stat().st_size for path in (folder / "benchmarks").rglob("*.tsv"))


def test_a_rejected_session_stops_nothing_and_is_told(finished):
    folder, _ = finished
    quality = json.loads((folder / "results/posed/broken/quality.json").read_text())
    assert quality["status"] == "rejected"
    assert quality["reasons"]
    assert not len(pd.read_parquet(folder / "results/posed/broken/samples.parquet"))
    assert not len(pd.read_parquet(folder / "results/posed/broken/segments.parquet"))
    assert "rejected" in (folder / "results/posed/section.html").read_text()


def test_the_rests_of_other_sessions_stand_in_for_a_rejected_static_one(finished):
    folder, _ = finished
    noise = json.loads((folder / "results/posed/noise.json").read_text())
    assert noise["sessions"] == ["faces", "poses"]
    assert all(axis["N"]["identifiable"] for axis in noise["axes"].values())
    rows = {
        session: len(pd.read_parquet(folder / f"results/posed/{session}/allan.parquet"))
        for session in ("poses", "faces", "broken")
    }
    assert rows["faces"] and rows["poses"] and not rows["broken"]


def test_five_mistakes_are_five_lines(checkout, tmp_path):
    (tmp_path / "config.yaml").write_text(
        "devices:\n"
        "  my_imu:\n"
        "    lable: My IMU\n"
        "    gravity: 98.1\n"
        "    sessions:\n"
        "      poses: {kind: multi_pos, file: {url: 'https://host/p.csv', sha256: 12ab},\n"
        "              units: {time: sec}}\n"
    )
    done = snakemake(checkout, tmp_path)
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("config.yaml: ")]
    assert [line.split(": ")[1] for line in sorted(lines)] == [
        "devices.my_imu.gravity",
        "devices.my_imu.lable",
        "devices.my_imu.sessions.poses.file.sha256",
        "devices.my_imu.sessions.poses.kind",
        "devices.my_imu.sessions.poses.units.time",
    ]
    assert (
        "config.yaml: devices.my_imu.sessions.poses.units.time: 'sec' is not a unit; "
        in done.stderr
    )
    # beside them only the line that names the profile
    assert len(done.stderr.splitlines()) <= 6
    assert not (tmp_path / "results").exists()


def test_a_default_config_that_is_no_yaml_is_told_by_name(checkout, tmp_path):
    (tmp_path / "config.yaml").write_text("devices: {a: [")
    done = snakemake(checkout, tmp_path, config=None)
    assert done.returncode == 1
    assert "config.yaml: line 1, column 15: no YAML: " in done.stderr
    assert "Traceback" not in done.stderr


def test_a_failing_job_says_why_in_one_line_and_keeps_the_traceback(checkout, tmp_path):
    """A download that nobody can have: the mirror is empty and the address leads nowhere."""
    source = {"url": "http://127.0.0.1:9/none.csv", "sha256": hashlib.sha256(b"none").hexdigest()}
    sessions = {"rest": {"kind": "static", "file": source}}
    (tmp_path / "config.yaml").write_text(
        yaml.safe_dump({"devices": {"a": {"sessions": sessions}}})
    )
    done = snakemake(checkout, tmp_path, IMULOOP_MIRROR=str(tmp_path))
    assert done.returncode == 1
    [line] = [
        line for line in done.stderr.splitlines() if line.startswith("ingest_fetch none.csv: ")
    ]
    assert "127.0.0.1:9/none.csv" in line
    [log] = (tmp_path / "logs/ingest_fetch").rglob("*.log")
    assert "Traceback" in log.read_text()
    assert not list((tmp_path / "data/cache").rglob("none.csv"))


def test_a_mirror_serves_a_download(checkout, tmp_path, finished):
    content = (finished[0] / "broken.csv").read_bytes()
    (tmp_path / "mirror/deep").mkdir(parents=True)
    (tmp_path / "mirror/deep/log.csv").write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    source = {"url": "http://127.0.0.1:9/log.csv", "sha256": digest}
    sessions = {"rest": {"kind": "static", "file": source}}
    config = {"mirror": "mirror", "devices": {"a": {"sessions": sessions}}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    cached = f"data/cache/{digest}/log.csv"
    done = snakemake(checkout, tmp_path, target=cached)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / cached).read_bytes() == content


def test_the_library_never_imports_the_workflow_manager(repository):
    for path in (repository / "workflow/lib").rglob("*.py"):
        assert not re.search(r"^\s*(import|from) snakemake", path.read_text(), re.M), path


def test_the_scheduler_has_the_limits_that_a_local_run_lifts():
    """Of no documented setting: without them half of the time of many devices goes to timers."""
    from snakemake.scheduling.job_scheduler import JobScheduler

    assert {"job_rate_limiter", "subsample"} <= {*JobScheduler.__init__.__code__.co_names}


def test_a_path_of_a_script_is_taken_apart_by_the_name_that_is_cached():
    """Of no documented function: uncached it takes 0.4 ms of each job."""
    from snakemake.sourcecache import SourceFile

    assert "parse_uri" in SourceFile.get_cache_path.__code__.co_names


@pytest.mark.parametrize(
    ("target", "line"),
    [
        ("posted/report.html", "there is no device 'posted'; did you mean 'posed'?"),
        ("posed/face/quality.json", "there is no session 'face'; did you mean 'faces'?"),
    ],
)
def test_a_target_that_names_nothing_is_told(finished, checkout, target, line):
    done = snakemake(checkout, finished[0], "-n", target=f"results/{target}")
    assert done.returncode and line in done.stdout + done.stderr
