"""The workflow from end to end, on a small config in its own folder."""

import hashlib
import json
import os
import re
import shutil
import subprocess

import pandas as pd
import pytest
import yaml

from imuloop import chain
from imuloop.config import STAGES, resolve
from workflow.conftest import CONFIG, QUICK, RESTING
from workflow.run import command, snakemake


def test_a_csv_log_becomes_a_report(finished_run):
    folder, done = finished_run
    assert done.returncode == 0, done.stderr
    report = (folder / "results/report.html").read_text()
    # a label from the config is text, never markup
    assert "posed" in report and "Rest &amp; &lt;b&gt;peace&lt;/b&gt;" in report
    assert "<b>peace" not in report


def test_a_rejected_session_stops_nothing_and_other_rests_stand_in(finished_run):
    results = finished_run[0] / "results/posed"
    assert "rejected" in (results / "section.html").read_text()
    for name in ("samples", "segments", "allan"):
        assert not len(pd.read_parquet(results / f"broken/{name}.parquet"))
        assert len(pd.read_parquet(results / f"poses/{name}.parquet"))
    noise = json.loads((results / "noise.json").read_text())
    assert noise["sessions"] == ["poses"]
    assert all(axis["N"]["identifiable"] for axis in noise["axes"].values())


def test_the_files_of_a_device_are_those_of_the_library_on_it_alone(finished_run, tmp_path):
    beside, single = finished_run[0] / "results/posed", tmp_path / "posed"
    declared = resolve(CONFIG)["posed"]
    sessions = declared["sessions"]
    settings = {
        key: declared[key] for key in ("label", "gravity", "nominal", "full_scale", *STAGES)
    }
    kinds = {name: session.pop("kind") for name, session in sessions.items()}
    device = chain.Device("posed", single, kinds, **settings)
    for name, file in (("poses", "logs in/p.csv"), ("broken", "broken.csv")):
        chain.ingest(device, name, sessions[name], [finished_run[0] / file])
    for stage in (chain.segment, chain.noise, chain.calibrate):
        stage(device)
    files = [path.relative_to(single) for path in single.rglob("*") if path.is_file()]
    assert len(files) >= 10
    assert [p for p in files if (single / p).read_bytes() != (beside / p).read_bytes()] == []


def test_faulty_logs_are_named_without_a_traceback(finished_run):
    folder, done = finished_run
    for log, kind, text in (
        ("resting/faces", "warnings", "fits the turns of gravity with x as gy, y as gx, z as gz"),
        ("posed/broken", "reasons", "missing or impossible values"),
    ):
        quality = json.loads((folder / f"results/{log}/quality.json").read_text())
        assert (quality["status"] == "rejected") == (kind == "reasons")
        assert any(text in line for line in quality[kind]), quality[kind]
        rejected = "rejected: " if kind == "reasons" else ""
        lines = [line for line in done.stderr.splitlines() if f"{log}: {rejected}" in line]
        assert any(text in line for line in lines), lines
        device, session = log.split("/")
        assert session in (folder / f"results/{device}/section.html").read_text()
    assert "Traceback" not in done.stdout + done.stderr
    assert [p for p in (folder / "logs").rglob("*.log") if "Traceback" in p.read_text()] == []
    rows = pd.read_csv(folder / "results/comparison.csv", index_col="device")
    assert set(rows["status"]) == {"ok"}
    assert rows["why"]["posed"].startswith("broken: 1 of 1 rows")


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
    assert done.returncode == 1 and not done.stdout and not (tmp_path / "results").exists()
    # Snakemake says first which profile it uses
    profile, *lines = done.stderr.splitlines()
    assert profile.startswith("Using")
    poses = "devices.my_imu.sessions.poses"
    assert sorted(line.rpartition(": ")[0].removeprefix("config.yaml line ") for line in lines) == [
        "3: devices.my_imu.lable",
        "4: devices.my_imu.gravity",
        *(f"6: {poses}.{key}" for key in ("file.sha256", "kind")),
        f"7: {poses}.units.time",
    ]


def test_a_config_that_cannot_be_read_is_one_line(checkout, tmp_path):
    done = snakemake(checkout, tmp_path, config=None)
    _, told = done.stderr.splitlines()
    assert done.returncode == 1 and told.startswith("config.yaml: there is no such file here")


def test_a_failing_download_says_why_in_one_line_and_a_mirror_serves_it(
    checkout, finished_run, tmp_path
):
    """All paths are relative to another folder than the folder of the results."""
    folder, sessions, cached = tmp_path / "else where", {}, {}
    (folder / "mirror/deep").mkdir(parents=True)
    (folder / "rest.parquet").symlink_to(finished_run[0] / "rest.parquet")
    for name in ("here", "gone"):
        content = f"t,ax,ay,az,gx,gy,gz,{name}\n".encode() + b"0,0,0,9.8,0,0,0,0\n" * 50
        digest = hashlib.sha256(content).hexdigest()
        source = {"url": f"http://127.0.0.1:9/{name}.csv", "sha256": digest}
        sessions[name] = {"kind": "static", "file": source}
        cached[name] = f"data/cache/{digest}/{name}.csv"
        if name == "here":
            (folder / "mirror/deep/here.csv").write_bytes(content)
    config = {"mirror": "mirror", "devices": {"a": {"sessions": sessions}, "resting": RESTING}}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    source, samples = os.path.relpath(checkout, tmp_path), "results/resting/rest/samples.parquet"
    how = {"target": " ".join([*cached.values(), samples]), "config": "else where/config.yaml"}
    done = snakemake(source, folder, "-k", cwd=tmp_path, **how)
    [line] = [x for x in done.stderr.splitlines() if x.startswith("ingest_fetch gone.csv: ")]
    assert done.returncode == 1 and "127.0.0.1:9/gone.csv" in line
    failed = [p for p in (folder / "logs/ingest_fetch").rglob("*.log") if p.stat().st_size]
    assert len(failed) == 1 and "Traceback" in failed[0].read_text()
    assert [(folder / path).exists() for path in cached.values()] == [True, False]
    files = {path.name for path in (folder / samples).parent.iterdir()}
    assert files == {"samples.parquet", "quality.json"}


@pytest.mark.study
def test_another_workflow_has_it_as_a_module(checkout, finished_run, tmp_path):
    (tmp_path / "rest.parquet").symlink_to(finished_run[0] / "rest.parquet")
    config = {"imu": {"defaults": QUICK, "devices": {"resting": RESTING}}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    (tmp_path / "Snakefile").write_text(
        'configfile: "config.yaml"\n'
        f'module imuloop:\n    snakefile: "{checkout}/Snakefile"\n    config: config["imu"]\n'
        "use rule * from imuloop as imu_*\n"
    )
    samples = "results/resting/rest/samples.parquet"
    done = snakemake(tmp_path, tmp_path, target=samples, config=None)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / samples).read_bytes() == (finished_run[0] / samples).read_bytes()


def test_a_target_that_names_nothing_is_refused(finished_run, checkout):
    target = "results/resting/face/quality.json"
    done = snakemake(checkout, finished_run[0], "-n", target=target)
    line = "there is no session 'face'; did you mean 'faces'?"
    assert done.returncode and line in done.stdout + done.stderr


@pytest.mark.study
def test_snakemake_makes_its_own_report(finished_run, checkout):
    folder, _ = finished_run
    done = snakemake(checkout, folder, "--report", "own.html")
    assert done.returncode == 0, done.stderr
    page = (folder / "own.html").read_text(encoding="utf-8")
    marked = set(re.findall(r'"(results/[^"]+\.(?:html|csv|svg))": \{', page))
    assert {"results/report.html", "results/comparison.csv"} <= marked
    assert "results/resting/figures/rest_allan_gyroscope.svg" in marked


def test_jobs_ask_for_more_memory_than_they_take(finished_run):
    """Protects: a cluster kills a job above its request, so 1.3 times the peak is asked."""
    folder, done = finished_run
    jobs = re.findall(
        r"log: logs/(\S+)\.log\n(?: .*\n)*? +resources: .*?mem_mb=(\d+)", done.stdout + done.stderr
    )
    peaks = {}
    for job, asked in jobs:
        table = folder / f"benchmarks/{job}.tsv"
        if table.exists():
            peaks[job] = pd.read_csv(table, sep="\t")["max_rss"].max() / int(asked)
    assert len(peaks) > 15
    assert {job: share for job, share in peaks.items() if share > 1 / 1.3} == {}


def test_the_terminal_has_a_line_per_device_and_stage_and_the_verdicts(
    finished_run, checkout, tmp_path
):
    folder = shutil.copytree(finished_run[0], tmp_path / "work")
    logger = {"PYTHONPATH": str(checkout / "workflow/logger")}
    again = ("--logger", "imuloop", "--forcerun", "results/resting/section.html", "report")
    how = {"cwd": folder, "env": os.environ | logger, "capture_output": True, "text": True}
    done = subprocess.run(command(checkout, folder, *again), **how)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if not line.startswith("Using profile")]
    assert "resting  report_device" in lines
    assert len(lines) <= 4 * len(CONFIG["devices"])
    assert any(re.match("posed: accelerometer .*gyroscope ", line) for line in lines)
