"""The workflow on a real SLURM of one node: the same bytes, failures reported, memory by size."""

import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

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
    held = b"1" * 800_000_000
    time.sleep(5)
"""
# what is added to the scripts of an array: a job waits at its end where a test has put a file, and
# writes down that it is done; one takes more memory than the array asks for
NOTED = """
import time

stage = Path(snakemake.log[0]).parts[1]
while Path(f"hold_{stage}").exists():
    time.sleep(0.1)
if (stage, device.name) == ("calibrate", "hungry"):
    held = b"1" * 1_500_000_000
    time.sleep(5)
with open("done", "a") as done:
    print(snakemake.log[0], file=done)
"""
NOTED_STAGES = ("ingest", "segment", "noise", "calibrate", "diagnose")
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
        kept = "--slurm-keep-successful-logs"
        done = run(repository, remote, "--profile", repository / profile, kept)
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
    assert {cores for _, cores, *_ in jobs} == {"2"}
    assert "localrule report:" in said


def test_all_stages_of_a_device_are_one_snakemake_in_its_submission(started):
    # of a group by --groups each job is one, and they run one after another
    _, remote, *_ = started["three"].result()
    logs = [path.read_text() for path in remote.glob(".snakemake/slurm_logs/**/*.log")]
    assert [text.count("Building DAG of jobs...") for text in logs] == [2] * 3


def test_memory_is_asked_for_by_the_size_of_the_log(started, repository):
    local, _, jobs, _ = started["three"].result()
    asked = sorted(int(memory.rstrip("M")) for _, _, memory, *_ in jobs)
    # what both sessions' ingest asks for at once with hardly any log
    assert 1900 <= asked[0] <= asked[-1] < 2000
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
    line = "segment broken: an error in the code of imuloop (RuntimeError)"
    assert line in reported[0][1].read_text()


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


def until(true, seconds=300):
    """Wait until a function says so."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f"not within {seconds} s"
        time.sleep(0.2)


def states(folder):
    """Return the states of the jobs of a folder that are in the queue, and have not ended."""
    listed = ["squeue", "--noheader", "--array", "--format=%T|%Z"]
    lines = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    return [line.split("|")[0] for line in lines if line.endswith(f"|{folder}")]


def restart_controller(meanwhile):
    """End SLURM's controller, and start it again after a function is called."""
    conf = Path("/etc/slurm/slurm.conf").read_text()
    pid = int(Path(re.search(r"(?m)^SlurmctldPidFile=(.*)$", conf)[1]).read_text())
    os.kill(pid, signal.SIGTERM)
    until(lambda: subprocess.run(["scontrol", "ping"], capture_output=True).returncode)
    meanwhile()
    subprocess.run(["slurmctld"], check=True)
    until(lambda: not subprocess.run(["scontrol", "ping"], capture_output=True).returncode)


def set_node(state):
    (node,) = re.findall(r"(?m)^NodeName=(\S+)", Path("/etc/slurm/slurm.conf").read_text())
    update = ["scontrol", "update", f"NodeName={node}", f"State={state}", "Reason=test"]
    return subprocess.run(update, capture_output=True).returncode


@pytest.fixture(scope="module")
def suffered(repository, slurm, started, tmp_path_factory):
    """An array of three devices that all goes wrong for, one thing after another.

    One has logs that are no records; the controller is ended and started again, the node goes
    down, Snakemake is interrupted, and a job takes more memory than there is. What was seen.
    """
    local, work, edited = (tmp_path_factory.mktemp(name) for name in ("local", "array", "copy"))
    for each in (local, work):
        write_devices(each, ["bad", "good", "hungry"])
        for log in each.glob("bad_*.csv"):
            log.write_text("".join(log.read_text().splitlines(keepends=True)[:10]))
    copied(repository, edited)
    for stage in NOTED_STAGES:
        with open(edited / f"scripts/{stage}.py", "a") as script:
            script.write(NOTED)

    def sbatch(*options):
        words = [edited / "profiles/slurm/array.sh", sys.executable, "-m", "snakemake"]
        words += ["-s", edited / "Snakefile", "--configfile", "config.yaml"]
        line = ["sbatch", "--parsable", *options, *words]
        done = subprocess.run(list(map(str, line)), cwd=work, capture_output=True, text=True)
        return done.stdout.strip().partition(";")[0]

    def holding(stage, files):
        (work / f"hold_{stage}").touch()
        return lambda: len({p.relative_to(work).parts[1] for p in work.glob(files)}) == 3

    def said():
        return [path.read_text() for path in sorted(work.glob("slurm-*.out"))]

    # the runs that wait for nothing go first: the node will take theirs down as well
    for each in started.values():
        each.exception()
    seen = SimpleNamespace(local=local, work=work)
    with ThreadPoolExecutor() as pool:
        here = pool.submit(run, edited, local, "-c1")
        at_segments = holding("segment", "results/*/*/segments.parquet")
        first = sbatch("--array=1-3", "--mem=1500")
        until(at_segments)
        at_noise = holding("noise", "results/*/noise.json")
        restart_controller(meanwhile=(work / "hold_segment").unlink)
        seen.after_restart = states(work)
        until(at_noise)
        assert set_node("DOWN") == 0
        until(lambda: set(states(work)) == {"PENDING"})
        # unless the node's next word to the controller brought it back
        set_node("RESUME")
        again = re.compile("NODE FAILURE.*localrule noise:", re.S)
        until(lambda: sum(bool(again.search(text)) for text in said()) == 3 and at_noise())
        seen.running_again = states(work)
        subprocess.run(["scancel", "--full", "--signal=INT", first], check=True)
        until(lambda: not states(work))
        seen.interrupted = "".join(said())
        (work / "hold_noise").unlink()
        sbatch("--array=1-3", "--mem=1500")
        sbatch("--dependency=singleton", "--wait")
        seen.said = said()
        assert here.result().returncode == 0, here.result().stderr
    return seen


def test_an_array_goes_on_where_the_controller_is_started_again(suffered):
    assert suffered.after_restart == ["RUNNING"] * 3


def test_an_array_is_started_again_by_a_node_that_comes_back(suffered):
    assert suffered.running_again == ["RUNNING"] * 3
    assert "NODE FAILURE" in suffered.interrupted


def test_an_array_that_was_interrupted_is_taken_up(suffered):
    assert suffered.interrupted.count("Terminating processes on user request") == 3


def test_a_job_of_an_array_that_takes_too_much_memory_is_killed_alone(suffered):
    assert ["exceeded memory limit" in text for text in suffered.said].count(True) == 1


def test_no_job_of_an_array_runs_twice_that_was_done(suffered):
    here, there = (
        Counter((folder / "done").read_text().splitlines())
        for folder in (suffered.local, suffered.work)
    )
    assert there == here and set(there.values()) == {1}


def test_an_array_that_suffered_gives_the_same_bytes_as_here(suffered):
    here, there = contents(suffered.local), contents(suffered.work)
    assert set(here) == set(there)
    assert [path for path in here if here[path] != there[path]] == []


def test_a_bad_device_of_an_array_is_named(suffered):
    assert re.search(r"(?m)^bad/static: rejected", "".join(suffered.said))
    page = (suffered.work / "results/report.html").read_text()
    assert '<h2 id="rejected">Rejected sessions</h2>\n<ul>\n<li><a href="#bad">bad</a>' in page
