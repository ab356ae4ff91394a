"""The workflow on a real SLURM of one node: the same bytes, failures told, memory by size."""

import os
import re
import subprocess
import time

import pytest

from cluster.conftest import (
    command,
    contents,
    copy_of_workflow,
    run,
    write_config,
    write_devices,
)

# longest time from the end of a job to Snakemake's word of it, s
TOLD = 60
# what a job needs is worked out where memory is counted, else nowhere
LIMIT = ("--resources", "mem_mb=100000")
# squeue: what a device's submission asked for
ASKED = "%i|%C|%m|%k|%T"


def queue(form):
    """Return what squeue says of all jobs, the ended ones too, a tuple each."""
    listed = ["squeue", "--noheader", "--states=all", f"--format={form}"]
    lines = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    return [tuple(line.split("|")) for line in lines]


@pytest.fixture(scope="module")
def six(repository, slurm, tmp_path_factory):
    """Six devices run on this machine and on SLURM; both folders, the jobs, and what was said."""
    local, remote = (tmp_path_factory.mktemp(name) for name in ("local", "remote"))
    names = [f"imu{number}" for number in range(6)]
    for folder in (local, remote):
        write_devices(folder, names)
    done = run(repository, local, "-c2")
    assert done.returncode == 0, done.stderr
    before = {job for job, *_ in queue(ASKED)}
    done = run(repository, remote, "--profile", repository / slurm)
    assert done.returncode == 0, done.stderr
    return local, remote, [job for job in queue(ASKED) if job[0] not in before], done.stderr


def test_six_devices_on_slurm_give_the_same_bytes_as_here(six):
    local, remote, _, _ = six
    here, there = contents(local), contents(remote)
    # time and host stand in logs/ and benchmarks/ only
    assert set(here) == set(there)
    assert [path for path in here if here[path] != there[path]] == []


def test_a_device_is_one_submission(six):
    *_, jobs, said = six
    assert len(jobs) == 6
    assert {state for *_, state in jobs} == {"COMPLETED"}
    # its two sessions at once
    assert {cores for _, cores, *_ in jobs} == {"2"}
    assert "localrule report:" in said


def test_memory_is_asked_for_by_the_size_of_the_log(six, repository):
    local, _, jobs, _ = six
    asked = sorted(int(memory.rstrip("M")) for _, _, memory, *_ in jobs)
    # what the diagnosis asks for with hardly any log
    assert 1200 <= asked[0] <= asked[-1] < 1300
    small = (local / "imu0_static.csv").stat().st_size
    with open(local / "imu0_static.csv", "r+b") as log:
        # a hole: nothing is read beyond the head before the run
        log.truncate(2_000_000_000)
    planned = run(repository, local, "-n", *LIMIT, target="results/imu0/section.html").stdout
    with open(local / "imu0_static.csv", "r+b") as log:
        log.truncate(small)
    (diagnosis,) = re.findall(
        r"rule diagnose_\d+:\n(?: .*\n)*? +resources: .*mem_mb=(\d+)", planned
    )
    assert int(diagnosis) == pytest.approx(1200 + 2 * 5000, rel=0.01)


@pytest.fixture(scope="module")
def failed(repository, slurm, tmp_path_factory):
    """A run with a script that fails, and one that hangs until its job is cancelled.

    Returns the folder, for each when it failed, and when and what Snakemake said of it.
    """
    work = tmp_path_factory.mktemp("failing")
    edited = copy_of_workflow(repository, tmp_path_factory.mktemp("edited"))
    with open(edited / "scripts/segment.py", "a") as script:
        script.write('if params.device == "broken":\n    raise RuntimeError("on purpose")\n')
        script.write('if params.device == "stuck":\n    import time\n\n    time.sleep(300)\n')
    devices = write_devices(work, ["broken", "stuck"])
    for device in devices.values():
        del device["sessions"]["multi_position"]
    write_config(work, devices)
    line = command(edited, work, "--profile", edited / slurm, "--retries", "0")
    ended, told = [], []
    streams = {"stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL, "text": True}
    with subprocess.Popen(line, cwd=work, env=os.environ, **streams) as running:
        for text in running.stderr:
            if told and text.strip().startswith("log:") and len(told[-1]) == 1:
                told[-1].append(work / text.split()[1])
            if "Error in group device" in text:
                told.append([time.time()])
                if len(told) == 1:
                    ended.append((work / "logs/segment/broken.log").stat().st_mtime)
                    (stuck,) = [job for job, state in queue("%i|%T") if state == "RUNNING"]
                    subprocess.run(["scancel", stuck], check=True)
                    ended.append(time.time())
    assert running.returncode == 1
    return ended, told


def test_a_failing_job_is_told_within_a_minute_with_a_log_that_says_why(failed):
    ended, told = failed
    assert 0 <= told[0][0] - ended[0] < TOLD
    assert "segment broken: on purpose" in told[0][1].read_text()


def test_a_cancelled_job_is_told_within_a_minute(failed):
    ended, told = failed
    assert 0 <= told[1][0] - ended[1] < TOLD
    assert "CANCELLED" in told[1][1].read_text()
