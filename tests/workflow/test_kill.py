"""A run that is killed at any moment and run again ends with the results of a calm run."""

import os
import shutil
import signal
import subprocess
import time
from contextlib import suppress

import numpy as np
import pytest
import yaml

from workflow.run import command, snakemake

TARGET = "results/imu/static/segments.parquet results/imu/six_position/segments.parquet"


def results(folder):
    files = [path for path in (folder / "results").rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.study
def test_killed_runs_end_with_the_results_of_a_calm_one(checkout, logs, tmp_path):
    given, calm, killed = (tmp_path / name for name in ("given", "calm", "killed"))
    given.mkdir()
    for kind in ("static", "six_position"):
        logs[kind].to_csv(given / f"{kind}.csv", index=False)
    sessions = {kind: {"kind": kind, "file": f"{kind}.csv"} for kind in ("static", "six_position")}
    (given / "config.yaml").write_text(yaml.safe_dump({"devices": {"imu": {"sessions": sessions}}}))
    shutil.copytree(given, calm)
    start = time.monotonic()
    assert snakemake(checkout, calm, target=TARGET).returncode == 0
    span, wanted = time.monotonic() - start, results(calm)
    for moment in np.random.default_rng(1).uniform(0.2, 1, 2) * span:
        shutil.rmtree(killed, ignore_errors=True)
        shutil.copytree(given, killed)
        run = subprocess.Popen(
            command(checkout, killed, target=TARGET),
            **{"cwd": killed, "start_new_session": True},
            **dict.fromkeys(("stdout", "stderr"), subprocess.DEVNULL),
        )
        with suppress(subprocess.TimeoutExpired):
            assert run.wait(moment) == 0
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        if any((killed / ".snakemake/locks").glob("*")):
            # a run in a locked folder says what to do, and changes nothing
            before, done = results(killed), snakemake(checkout, killed, target=TARGET)
            assert done.returncode and "--unlock" in done.stdout + done.stderr
            assert results(killed) == before
            assert snakemake(checkout, killed, "--unlock", target=None).returncode == 0
        done = snakemake(checkout, killed, target=TARGET)
        assert done.returncode == 0, done.stderr
        assert results(killed) == wanted
