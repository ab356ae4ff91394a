"""A run that is killed at any moment and continued ends with the results of a calm run."""

import os
import shutil
import signal
import subprocess
import time
from contextlib import suppress

import pytest
import yaml

from workflow.run import command, snakemake

TARGET = "results/imu/static/segments.parquet results/imu/six_position/segments.parquet"


def results(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.glob("results/*/*/*.*")}


@pytest.mark.study
def test_a_run_that_was_killed_is_continued(checkout, logs, tmp_path):
    calm, sessions = tmp_path / "calm", {}
    calm.mkdir()
    for kind in ("static", "six_position"):
        logs[kind].to_csv(calm / f"{kind}.csv", index=False)
        sessions[kind] = {"kind": kind, "file": f"{kind}.csv"}
    (calm / "config.yaml").write_text(yaml.safe_dump({"devices": {"imu": {"sessions": sessions}}}))
    folders = [shutil.copytree(calm, tmp_path / name) for name in ("early", "late")]
    start = time.monotonic()
    subprocess.run(command(checkout, calm, target=TARGET), cwd=calm, check=True)
    span, wanted = time.monotonic() - start, results(calm)
    assert len(wanted) == 6
    for folder, share in zip(folders, (0.5, 0.8), strict=True):
        run = subprocess.Popen(
            command(checkout, folder, target=TARGET), cwd=folder, start_new_session=True
        )
        with suppress(subprocess.TimeoutExpired):
            run.wait(share * span)
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        assert snakemake(checkout, folder, "--unlock", target=None).returncode == 0
        done = snakemake(checkout, folder, target=TARGET)
        assert done.returncode == 0, done.stderr
        assert results(folder) == wanted
