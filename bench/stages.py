"""Processor time of every stage of a factory's device: `make bench`, or alone.

The device is simulated: a multi-position session and a static one, both 100 Hz. Each stage is its
call in `imuloop.chain`, in a process of its own, one thread; without Snakemake's share.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from bench.memory import peak_memory

REPOSITORY = Path(__file__).parents[1]
ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "PYTHONPATH": os.pathsep.join([str(REPOSITORY / "workflow/lib"), str(REPOSITORY)]),
}
KINDS = {"poses": "multi_position", "rest": "static"}
# each with its session, None for all
STAGES = [("ingest", session) for session in KINDS]
STAGES += [(s, None) for s in "segment noise calibrate diagnose allan export report_device".split()]


def run(stage, folder, kinds=KINDS, session=None, repeats=1):
    """Run a stage in a process of its own.

    Parameters
    ----------
    stage : str
        A function of `imuloop.chain`.
    folder : Path
        Where ``<session>.csv`` lies, and the results are.
    kinds : dict of str to str
        Kind by session.
    session : str, optional
        That is to be ingested.
    repeats : int
        Runs after the first.

    Returns
    -------
    dict
        Seconds of processor time: `process`, from the start of Python to the end of a first run,
        and `work`, the least of the others; and `memory` at the peak, bytes.
    """
    given = json.dumps([stage, str(folder), kinds, session, repeats])
    command = [sys.executable, "-m", "bench.stages", "--one", given]
    environment = {**os.environ, **ONE_THREAD}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{stage}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def one(stage, folder, kinds, session, repeats):
    """Run a stage in this process, and print what `run` returns."""
    from imuloop import chain

    device = chain.Device("imu", Path(folder), kinds)
    arguments = [device]
    if stage == "ingest":
        from imuloop.config import resolve

        entry = {"sessions": {session: {"kind": kinds[session], "file": f"{session}.csv"}}}
        declared = resolve({"devices": {"imu": entry}})["imu"]["sessions"][session]
        declared.pop("kind")
        arguments += [session, declared, [f"{folder}/{session}.csv"]]
    taken = []
    for _ in range(1 + repeats):
        if failures := getattr(chain, stage)(*arguments):
            sys.exit(str(failures[0]))
        taken.append(time.process_time())
    work = min(after - before for before, after in pairwise(taken))
    print(json.dumps({"process": taken[0], "work": work, "memory": peak_memory()}))


def simulate(folder, static):
    """Write the device's logs, the static one of so many seconds; return rows by session."""
    from imuloop.simulate.simulate import simulate_session, write_log
    from imuloop.simulate.truth import example_truth

    truth, rows = example_truth(), {}
    sessions = {name: truth.sessions[kind] for name, kind in KINDS.items()}
    sessions["rest"] = replace(sessions["rest"], duration_s=static)
    for name in sessions:
        log = simulate_session(replace(truth, sessions=sessions), name)
        write_log(folder / f"{name}.csv", log, {})
        rows[name] = len(log)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--static", type=float, default=1200.0, help="static session, s")
    parser.add_argument("--rounds", type=int, default=3, help="processes a stage, the best counts")
    parser.add_argument("--one", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        return one(*options.one)
    print("| stage | process, s | work, s |\n|---|--:|--:|")
    total = {"process": 0.0, "work": 0.0}
    with tempfile.TemporaryDirectory() as folder:
        rows = simulate(Path(folder), options.static)
        for stage, session in STAGES:
            each = [run(stage, folder, session=session) for _ in range(options.rounds)]
            best = {key: min(found[key] for found in each) for key in total}
            total = {key: total[key] + best[key] for key in total}
            figures = " | ".join(f"{seconds:.2f}" for seconds in best.values())
            name = f"{stage}, {session}" if session else stage
            print(f"| {name} | {figures} |", flush=True)
    print(f"| all | {total['process']:.2f} | {total['work']:.2f} |")
    counts = ", ".join(f"{name} {count:,}" for name, count in rows.items())
    print(
        f"\nRows: {counts}. Process: from the start of Python to the end of the stage. Work: the "
        "stage once more, in the same process. Without Snakemake's share."
    )


if __name__ == "__main__":
    main()
