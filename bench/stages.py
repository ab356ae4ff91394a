"""Processor time of every job of a factory's device: `make bench`, or alone.

The device is simulated: a multi-position session and a static one, both 100 Hz. Each job is the
workflow's own script in a process of its own, one thread; without Snakemake's share.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from bench.study.tables import table
from imuloop.config import resolve
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth

REPOSITORY = Path(__file__).parents[1]
ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "PYTHONPATH": os.pathsep.join([str(REPOSITORY / "workflow/lib"), str(REPOSITORY)]),
}


def simulate(folder, static):
    """Write the device's logs, the static one of so many seconds; return rows by session."""
    truth = example_truth()
    sessions = {
        "poses": truth.sessions["multi_position"],
        "rest": replace(truth.sessions["static"], duration_s=static),
    }
    truth, rows = replace(truth, sessions=sessions), {}
    for name in sessions:
        log = simulate_session(truth, name)
        write_log(folder / f"{name}.csv", log, {})
        rows[name] = len(log)
    return rows


def jobs(folder, kinds):
    """Yield stage, session or None, and job of a device in the order of the workflow.

    Parameters
    ----------
    folder : Path
        Where ``<session>.csv`` lies, and the results go.
    kinds : dict of str to str
        Kind by session.
    """
    declared = {name: {"kind": kind, "file": f"{name}.csv"} for name, kind in kinds.items()}
    device = resolve({"devices": {"imu": {"sessions": declared}}})["imu"]

    def job(stage, output, *settings, session=None, more=None, **content):
        own = {session: kinds[session]} if session else kinds
        settings = {"name": "imu", "kinds": own, **{key: device[key] for key in settings}}
        output = {Path(name).stem: f"{folder}/{name}" for name in output}
        given = {"params": {"device": settings, **(more or {})}, "output": output}
        return stage, session, given | {"log": [f"{folder}/{stage}.log"], "threads": 1, **content}

    for name in kinds:
        (folder / name).mkdir(exist_ok=True)
        yield job(
            "ingest",
            [f"{name}/samples.parquet", f"{name}/quality.json"],
            *("nominal", "full_scale", "gravity"),
            session=name,
            more={"declared": {k: v for k, v in device["sessions"][name].items() if k != "kind"}},
            input={"log": [f"{folder}/{name}.csv"]},
        )
    for name in kinds:
        yield job("segment", [f"{name}/segments.parquet"], "segment", session=name)
    yield job("noise", ["noise.json"], "noise")
    calibrations = ["six_position.json", "multi_position.json"]
    yield job("calibrate", calibrations, "gravity", "calibrate")
    yield job("diagnose", ["diagnosis.json"], "gravity", "noise", "calibrate", "diagnose")
    for name in kinds:
        yield job("allan", [f"{name}/allan.parquet"], session=name)
    yield job("export", ["exports"], "label")
    yield job("report_device", ["section.html"], "label")


def run(stage, job, folder, repeats=1):
    """Run a job in a process of its own; return its seconds, ``process`` and ``work``."""
    (folder / "job.json").write_text(json.dumps(job))
    script = REPOSITORY / f"scripts/{stage}.py"
    command = [sys.executable, "-m", "bench.job", script, folder / "job.json"]
    done = subprocess.run(
        [str(each) for each in (*command, repeats)],
        env={**os.environ, **ONE_THREAD},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise RuntimeError(f"{stage}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--static", type=float, default=1200.0, help="static session, s")
    parser.add_argument("--rounds", type=int, default=3, help="processes a job, the best counts")
    options = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        rows = simulate(Path(folder), options.static)
        kinds = {"poses": "multi_position", "rest": "static"}
        for stage, session, job in jobs(Path(folder), kinds):
            each = [run(stage, job, Path(folder)) for _ in range(options.rounds)]
            process, work = (min(one[key] for one in each) for key in ("process", "work"))
            count = rows[session] if session else sum(rows.values())
            found.append((stage, session or "all", count, process, work))
    total = [sum(column) for column in list(zip(*found, strict=True))[3:]]
    lines = [
        (*words, f"{count:,}", f"{process:.2f}", f"{work:.2f}")
        for *words, count, process, work in found
    ]
    lines.append(("all", "", "", *(f"{seconds:.2f}" for seconds in total)))
    print(table(("stage", "session", "rows", "process, s", "work, s"), lines))
    print(
        "\nProcess: from the start of Python to the end of the script. Work: the script once more, "
        "in the same process. Snakemake's share is in neither."
    )


if __name__ == "__main__":
    main()
