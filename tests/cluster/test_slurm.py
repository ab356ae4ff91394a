"""The workflow on a real SLURM of one node: the same bytes, failures reported, memory by size."""

import re
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from cluster.conftest import command, contents, run, write_config, write_devices
from workflow.conftest import copied

# longest time from the end of a job to Snakemake's word of it, s: the plugin's pauses grow to it
REPORTED = 180
# what is added to the script of the segmentation
HARM = """
import time

if device.name == "broken":
    raise RuntimeError("on purpose")
if device.name == "stuck":
    time.sleep(300)
if device.name == "hungry":
    held = b"1" * 400_000_000
    time.sleep(5)
"""
# what a job needs is worked out where memory is counted, else nowhere
LIMIT = ("--resources", "mem_mb=100000")
# what squeue is asked for: the job, its cores, memory and state, and where it was submitted
ASKED = ("%i", "%C", "%m", "%T", "%Z")


def queue(folder):
    """Return job, cores, memory and state of all jobs of a folder, the ended ones too."""
    listed = ["squeue", "--noheader", "--states=all", "--sort=i", f"--format={'|'.join(ASKED)}"]
    lines = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    jobs = [line.split("|") for line in lines]
    return [tuple(job[:-1]) for job in jobs if job[-1] == str(folder)]


@pytest.fixture(scope="module")
def started(repository, slurm, tmp_path_factory):
    """All runs on SLURM, at once because they mostly wait: the future of each function by name."""
    runs = (fail, take_too_much, three)
    # here, because pytest makes no folders for several threads at once
    folders = [tmp_path_factory.mktemp(each.__name__) for each in runs]
    with ThreadPoolExecutor() as pool:
        yield {
            each.__name__: pool.submit(each, repository, slurm, folder)
            for each, folder in zip(runs, folders, strict=True)
        }


def three(repository, profile, folder):
    """Run three devices here and on SLURM; return both folders, the jobs, and what was said."""
    local, remote = folder / "local", folder / "remote"
    names = [f"imu{number}" for number in range(3)]
    for each in (local, remote):
        each.mkdir()
        write_devices(each, names)
    with ThreadPoolExecutor() as both:
        here = both.submit(run, repository, local, "-c2")
        done = run(repository, remote, "--profile", repository / profile)
    assert here.result().returncode == 0, here.result().stderr
    assert done.returncode == 0, done.stderr
    return local, remote, queue(remote), done.stderr


def test_devices_on_slurm_give_the_same_bytes_as_here(started):
    local, remote, _, _ = started["three"].result()
    here, there = contents(local), contents(remote)
    # time and host stand in logs/ and benchmarks/ only
    assert set(here) == set(there)
    assert [path for path in here if here[path] != there[path]] == []


def test_a_device_is_one_submission(started):
    *_, jobs, said = started["three"].result()
    assert len(jobs) == 3
    assert {state for *_, state in jobs} == {"COMPLETED"}
    # its two sessions at once
    assert {cores for _, cores, *_ in jobs} == {"2"}
    assert "localrule report:" in said


def test_memory_is_asked_for_by_the_size_of_the_log(started, repository):
    local, _, jobs, _ = started["three"].result()
    asked = sorted(int(memory.rstrip("M")) for _, _, memory, *_ in jobs)
    # what both sessions' ingest asks for at once with hardly any log
    assert 1200 <= asked[0] <= asked[-1] < 1300
    small = (local / "imu0_static.csv").stat().st_size
    with open(local / "imu0_static.csv", "r+b") as log:
        # a hole: nothing is read beyond the head before the run
        log.truncate(2_000_000_000)
    planned = run(repository, local, "-n", *LIMIT, target="results/imu0/section.html").stdout
    with open(local / "imu0_static.csv", "r+b") as log:
        log.truncate(small)
    (diagnosis,) = re.findall(r"rule diagnose:\n(?: .*\n)*? +resources: .*mem_mb=(\d+)", planned)
    text = " ".join((repository / "docs/clusters.md").read_text().split())
    said = r"asks for ([\d.]+) GB, ([\d.]+) GB more for each GB of log, ([\d.]+) GB for each static"
    least, more, static = map(float, re.search(said, text).groups())
    assert int(diagnosis) == pytest.approx(1000 * (least + 2 * more + static), rel=0.01)


def harmed(repository, folder, *names):
    """Return a copy of the workflow with harm in it, and a folder with devices of these names."""
    edited, work = folder / "edited", folder / "work"
    edited.mkdir()
    work.mkdir()
    copied(repository, edited)
    with open(edited / "scripts/segment.py", "a") as script:
        script.write(HARM)
    devices = write_devices(work, names)
    for device in devices.values():
        del device["sessions"]["multi_position"]
    write_config(work, devices)
    return edited, work


def fail(repository, profile, folder):
    """Run a script that fails, and one that hangs until its job is cancelled.

    Return for each when it failed, and when and what Snakemake said of it.
    """
    edited, work = harmed(repository, folder, "broken", "stuck")
    line = command(edited, work, "--profile", edited / profile, "--retries", "0")
    ended, reported = [], []
    streams = {"stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL, "text": True}
    with subprocess.Popen(line, cwd=work, **streams) as running:
        for text in running.stderr:
            if reported and text.strip().startswith("log:") and len(reported[-1]) == 1:
                reported[-1].append(work / text.split()[1])
            if "Error in group device" in text:
                reported.append([time.time()])
                if len(reported) == 1:
                    ended.append((work / "logs/segment/broken/static.log").stat().st_mtime)
                    (stuck,) = [job for job, *_, state in queue(work) if state == "RUNNING"]
                    subprocess.run(["scancel", stuck], check=True)
                    ended.append(time.time())
    assert running.returncode == 1
    return ended, reported


def take_too_much(repository, profile, folder):
    """Run a script that takes more memory than its first job asks for; return jobs and logs."""
    edited, work = harmed(repository, folder, "hungry")
    eager = ["--retries", "1", "--slurm-init-seconds-before-status-checks", "2"]
    target = "results/hungry/static/segments.parquet"
    done = run(edited, work, "--profile", edited / profile, *eager, target=target)
    assert done.returncode == 0, done.stderr
    logs = sorted((work / ".snakemake/slurm_logs").rglob("*.log"), key=lambda log: int(log.stem))
    return queue(work), [log.read_text() for log in logs]


def test_a_failing_job_is_reported_within_minutes_with_a_log_that_says_why(started):
    ended, reported = started["fail"].result()
    assert 0 <= reported[0][0] - ended[0] < REPORTED
    assert "segment broken: on purpose" in reported[0][1].read_text()


def test_a_cancelled_job_is_reported_within_minutes(started):
    ended, reported = started["fail"].result()
    assert 0 <= reported[1][0] - ended[1] < REPORTED
    assert "CANCELLED" in reported[1][1].read_text()


def test_a_job_that_takes_more_memory_than_asked_for_is_tried_again_with_more(started):
    (first, second), logs = started["take_too_much"].result()
    assert first[-1] != "COMPLETED" and "exceeded memory limit" in logs[0], logs
    assert second[-1] == "COMPLETED"
    asked = [int(job[2].rstrip("M")) for job in (first, second)]
    assert asked[1] == pytest.approx(2 * asked[0], abs=1)
