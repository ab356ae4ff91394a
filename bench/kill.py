"""Kill a run with SIGKILL at random moments, run it again: are the results those of a calm run?

From the repository, its library on the path: ``python -m bench.kill --kills 30``. A copy of what is
committed is run, so that work may go on meanwhile. The first kill of a run is at a moment uniform
over the time that a calm run takes; the next run goes on from what was left, and may be killed in
its turn. One that comes to its end is compared, and the next starts afresh.
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
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import yaml

from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth

TARGET = "results/report.html"
MARK = "IMULOOP_KILLED_RUN"
REPOSITORY = Path(__file__).resolve().parents[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        copy, work = Path(folder) / "copy", Path(folder) / "work"
        work.mkdir()
        # the report names the commit
        call(["git", "clone", "--quiet", str(REPOSITORY), str(copy)], work)
        done = kills(copy, work, options.kills, options.seed, say=partial(print, flush=True))
    print(f"{options.kills} kills, {done} finished runs, all with the results of a calm run")


def kills(repository, folder, count, seed, *, target=TARGET, say=lambda line: None):
    """Kill runs and finish them; return how many were finished.

    Parameters
    ----------
    repository : Path
        Where the workflow is; nothing in it may change meanwhile.
    folder : Path
        An empty folder to work in.
    count, seed : int
        Kills, and seed of their moments.
    target : str
        What is made.
    say : callable
        Takes a line on each kill.

    Raises
    ------
    AssertionError
        If results differ from those of a calm run, or anything else lies beside them.
    """
    moments, finished, killed_runs = random.Random(seed), 0, 0
    snakemake = [sys.executable, "-m", "snakemake", "-s", str(repository / "Snakefile")]
    snakemake += ["-c2", "--configfile", "config.yaml"]
    run = [*snakemake, "--", target]
    calm, killed, given = folder / "calm", folder / "killed", folder / "given"
    write_device(given)
    shutil.copytree(given, calm)
    shutil.copytree(given, killed)
    start = time.monotonic()
    call(run, calm)
    span, wanted = time.monotonic() - start, results(calm)
    while True:
        moment = moments.uniform(0, span)
        if killed_runs < count and kill(run, killed, moment):
            killed_runs += 1
            say(f"kill {killed_runs} after {moment:.1f} of {span:.1f} s")
            if any((killed / ".snakemake/locks").glob("*")):
                # a run in a locked folder says what to do, and changes nothing
                before = results(killed)
                done = subprocess.run(run, cwd=killed, capture_output=True, text=True)
                assert done.returncode and "--unlock" in done.stdout + done.stderr, done.stderr
                assert results(killed) == before
                call([*snakemake, "--unlock"], killed)
            continue
        if killed_runs == count:
            call(run, killed)
        finished += 1
        found = results(killed)
        differ = sorted(n for n in {*found, *wanted} if found.get(n) != wanted.get(n))
        assert not differ, f"other than those of a calm run: {', '.join(differ)}"
        if killed_runs == count:
            return finished
        shutil.rmtree(killed)
        shutil.copytree(given, killed)


def write_device(folder):
    """Write a simulated device's short logs and its config."""
    truth = example_truth()
    short = {"poses": 12, "initial_rest_s": 8.0, "rest_s": (2.0, 2.5)}
    plans = {
        "static": replace(truth.sessions["static"], duration_s=60.0),
        "multi_position": replace(truth.sessions["multi_position"], **short),
    }
    truth = replace(truth, sessions=plans)
    folder.mkdir()
    for name in plans:
        write_log(folder / f"{name}.csv", simulate_session(truth, name), {})
    sessions = {name: {"kind": name, "file": f"{name}.csv"} for name in plans}
    defaults = {"diagnose": {"draws": 100, "folds": 3}}
    config = {"defaults": defaults, "devices": {"imu": {"sessions": sessions}}}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))


def call(command, folder):
    """Run a command in a folder to its end."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def kill(command, folder, moment):
    """Start a command and kill its processes after `moment` s; return whether it still ran."""
    # by which its processes are known, those that left its group too
    mark = f"{MARK}={time.monotonic_ns()}"
    environment = os.environ | dict([mark.split("=")])
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    run = subprocess.Popen(command, cwd=folder, start_new_session=True, env=environment, **quiet)
    try:
        assert run.wait(moment) == 0, "the run failed"
        return False
    except subprocess.TimeoutExpired:
        return True
    finally:
        while left := marked(mark):
            for process in left:
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            run.poll()
            time.sleep(0.01)


def marked(mark):
    """Return the processes whose environment has a mark."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        # of others, or gone meanwhile
        with suppress(OSError):
            if mark.encode() in path.read_bytes().split(b"\0"):
                found.append(int(path.parent.name))
    return found


def results(folder):
    """Return the SHA-256 of each result file by its path."""
    files = sorted(p for p in (folder / "results").rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


if __name__ == "__main__":
    main()
