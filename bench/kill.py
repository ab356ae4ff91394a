"""Kill a run with SIGKILL at random moments, run it again: are the results those of a calm run?

From the repository, its library on the path: ``python -m bench.kill --kills 30``. Each run goes on
from what the killed one left. Where a run ends before its kill, its results are compared and the
next one starts afresh; the last one is not killed.
"""

import argparse
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import yaml

from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth

TARGET = "results/report.html"
REPOSITORY = Path(__file__).resolve().parents[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        done = kills(REPOSITORY, Path(folder), options.kills, options.seed, say=print)
    print(f"{options.kills} kills, {done} finished runs, all with the results of a calm run")


def kills(repository, folder, count, seed, *, target=TARGET, say=lambda line: None):
    """Kill runs and finish them; return how many were finished.

    Parameters
    ----------
    repository : Path
        Where the workflow is; nothing in it may change meanwhile, the report names its commit.
    folder : Path
        An empty folder to work in.
    count : int
        Kills.
    seed : int
        Of the moments, which are uniform over the time that a calm run takes.
    target : str
        What is made.
    say : callable
        Takes a line on each kill.

    Raises
    ------
    AssertionError
        If results differ from those of a calm run, or anything else lies beside them.
    """
    moments, finished = random.Random(seed), 0
    snakemake = [sys.executable, "-m", "snakemake", "-s", str(repository / "Snakefile")]
    snakemake += ["-c2", "--configfile", "config.yaml"]
    run = [*snakemake, "--", target]
    calm, killed = folder / "calm", folder / "killed"
    write_device(calm)
    shutil.copytree(calm, killed)
    start = time.monotonic()
    call(run, calm)
    span, wanted = time.monotonic() - start, results(calm)
    for number in range(1, count + 1):
        moment = moments.uniform(0, span)
        if not kill(run, killed, moment):
            finished += 1
            compare(killed, wanted)
            shutil.rmtree(killed / "results")
        there = len(results(killed))
        say(f"kill {number} after {moment:.1f} of {span:.1f} s, {there} of {len(wanted)} files")
        call([*snakemake, "--unlock"], killed)
    call(run, killed)
    compare(killed, wanted)
    return finished + 1


def write_device(folder):
    """Write a simulated device's short logs and its config."""
    truth = example_truth()
    plans = {
        "static": replace(truth.sessions["static"], duration_s=60.0),
        "multi_position": replace(
            truth.sessions["multi_position"], poses=12, initial_rest_s=8.0, rest_s=(2.0, 2.5)
        ),
    }
    truth = replace(truth, sessions=plans)
    folder.mkdir()
    for name in plans:
        write_log(folder / f"{name}.csv", simulate_session(truth, name), {})
    sessions = {name: {"kind": name, "file": f"{name}.csv"} for name in plans}
    config = {
        "defaults": {"diagnose": {"draws": 100, "folds": 3}},
        "devices": {"imu": {"sessions": sessions}},
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(config))


def call(command, folder):
    """Run a command in a folder to its end."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def kill(command, folder, moment):
    """Start a command and kill its processes after `moment` s; return whether it still ran."""
    run = subprocess.Popen(
        command,
        cwd=folder,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert run.wait(moment) == 0, "the run failed"
        return False
    except subprocess.TimeoutExpired:
        return True
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
        while group_lives(run.pid):
            time.sleep(0.01)


def group_lives(group):
    """Return whether any process of a group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def results(folder):
    """Return the SHA-256 of each result file by its path."""
    files = sorted(p for p in (folder / "results").rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def compare(folder, wanted):
    """Tell which results are not those wanted."""
    found = results(folder)
    differ = sorted(name for name in {*found, *wanted} if found.get(name) != wanted.get(name))
    assert not differ, f"other than those of a calm run: {', '.join(differ)}"


if __name__ == "__main__":
    main()
