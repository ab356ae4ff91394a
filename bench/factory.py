"""A factory's devices through the workflow: `python -m bench.factory FOLDER --devices 20,200`.

Each device has biases, scale factors and misalignments of its own, a multi-position session of 6
minutes and a static one of 20 minutes, both at 100 Hz, as CSV: 20 MB, kept in the folder for the
next time. Timed are a dry run, the whole run, the run with nothing to do, and the runs after one
device is added, one default is changed and one script is edited, in a copy of the repository.
Refused is a run whose jobs are not those it should have, and results of the first devices that
are not the same bytes among few devices as among many.
"""

import argparse
import os
import re
import resource
import shutil
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml

from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import SessionTruth, example_truth

REPOSITORY = Path(__file__).parents[1]
STATIC_S = 1200.0
# of so many devices one follows the changed default, the others have a setting of their own
FOLLOWS = 10
# jobs of one device by rule
WHOLE = {
    "ingest": 2,
    "segment_1": 1,
    "noise_1": 1,
    "calibrate": 1,
    "diagnose_1": 1,
    "export": 1,
    "report_device": 1,
}
# of these the code is edited and a default changed
EDITED = {"export": 1, "report_device": 1}
DEFAULT = {"calibrate": 1, "diagnose_1": 1, "export": 1, "report_device": 1}


def main():
    """Make the devices, run, print the table; exit with 1 where a run did other jobs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "folder",
        type=Path,
        nargs="?",
        default=REPOSITORY / "build/factory",
        help="of the logs, which are kept, and of the runs, made anew",
    )
    parser.add_argument("--devices", default="20,200", help="how many, from few to many")
    parser.add_argument("--cores", type=int, default=2)
    options = parser.parse_args()
    counts = [int(count) for count in options.devices.split(",")]
    make_logs(options.folder / "data", max(counts) + 1, options.cores)
    print("| devices | run | jobs | wall, s | processor, s | processor s a device |")
    print("|---|---|---|---|---|---|")
    runs = [measure(options.folder, count, options.cores) for count in counts]
    faults = [fault for each in runs for fault in each]
    for few, many in pairwise(counts):
        faults += differences(options.folder, few, many)
    print(*faults or ["each run did the jobs it should; results are the same bytes"], sep="\n")
    sys.exit(bool(faults))


def make_logs(folder, count, workers):
    """Write the logs of so many devices, those that are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [i for i in range(count) if not all(log(folder, i, k).exists() for k in sessions(i))]
    with ProcessPoolExecutor(workers) as pool:
        list(pool.map(make_log, [folder] * len(missing), missing))


def log(folder, number, kind):
    """Return the path of one session of a device."""
    return Path(folder) / f"{device(number)}_{kind}.csv"


def device(number):
    """Return the name of a device."""
    return f"d{number:04}"


def sessions(number):
    """Return the sessions of a device, from its number alone."""
    return {
        "multi_position": SessionTruth("multi_position", seed=10 * number),
        "static": SessionTruth("static", seed=10 * number + 1, duration_s=STATIC_S),
    }


def make_log(folder, number):
    """Write the logs of a device: an example, with errors drawn by its number."""
    rng, truth = np.random.default_rng(number), example_truth()

    def drawn(sensor, bias):
        return replace(
            sensor,
            T=sensor.T + np.triu(rng.normal(0, 2e-3, (3, 3)), 1),
            K=sensor.K * (1 + rng.normal(0, 3e-3, 3)),
            b=sensor.b + rng.normal(0, bias, 3),
        )

    truth = replace(
        truth,
        name=device(number),
        accelerometer=drawn(truth.accelerometer, 0.05),
        gyroscope=drawn(truth.gyroscope, 5e-3),
        sessions=sessions(number),
    )
    for kind in truth.sessions:
        write_log(log(folder, number, kind), simulate_session(truth, kind), {})


def measure(folder, count, cores):
    """Time the runs of so many devices; print a line each, return what they did wrongly."""
    work, repository = folder / f"run_{count}", folder / f"repository_{count}"
    for each in (work, repository):
        shutil.rmtree(each, ignore_errors=True)
    work.mkdir()
    for name in ("Snakefile", "workflow", "scripts", "profiles", "data/replicas"):
        source = REPOSITORY / name
        (repository / name).parent.mkdir(parents=True, exist_ok=True)
        copy = shutil.copytree if source.is_dir() else shutil.copy
        copy(source, repository / name)
    faults = []

    def snakemake(*arguments):
        command = [sys.executable, "-m", "snakemake", "-s", repository / "Snakefile", "-d", work]
        command += ["--configfile", work / "config.yaml", f"-c{cores}", *arguments]
        return subprocess.run(
            [*map(str, command), "--", "results/report.html"],
            capture_output=True,
            text=True,
            # byte code is kept from job to job, as Python does where nobody forbids it
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""},
        )

    def run(name, expected, devices, *arguments):
        begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        done = snakemake(*arguments)
        wall, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        output = done.stdout + done.stderr
        if done.returncode:
            sys.exit(f"{name}, {count} devices: {output[-2000:]}")
        table = output.partition("Job stats:")[2].partition("total")[0]
        jobs = {rule: int(n) for rule, n in re.findall(r"(?m)^(\w+) +(\d+)$", table)}
        print(
            f"| {count} | {name} | {sum(jobs.values())} | {wall:.1f} | {processor:.1f} | "
            f"{processor / devices:.2f} |",
            flush=True,
        )
        wanted = {rule: n * devices for rule, n in expected.items()} | {"report": 1}
        if jobs != (wanted if expected else {}):
            faults.append(f"{name}, {count} devices: jobs {jobs}, not {wanted}")

    # not timed: the first start after an installation, which writes the byte code
    write_config(work, 1)
    snakemake("-n")
    write_config(work, count)
    run("dry run", WHOLE, count, "-n")
    run("whole run", WHOLE, count)
    run("nothing to do", {}, 1)
    shutil.copytree(work / "results", work / "first")
    write_config(work, count + 1)
    run("one device added", WHOLE, 1)
    write_config(work, count + 1, face_tolerance=21)
    run("one default changed", DEFAULT, len(range(0, count + 1, FOLLOWS)))
    with open(repository / "scripts/export.py", "a") as file:
        file.write("\nEDITED = True\n")
    run("one script edited", EDITED, count + 1)
    return faults


def write_config(work, count, face_tolerance=20):
    """Write the config of so many devices; one of ten has no setting of its own."""
    devices = {}
    for i in range(count):
        files = {
            kind: {"kind": kind, "file": f"../data/{log('', i, kind)}"} for kind in sessions(i)
        }
        own = {"calibrate": {"face_tolerance": 20}} if i % FOLLOWS else {}
        devices[device(i)] = {"sessions": files, **own}
    config = {"defaults": {"calibrate": {"face_tolerance": face_tolerance}}, "devices": devices}
    (work / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))


def differences(folder, few, many):
    """Return which files of the first devices differ between the runs of few and of many."""
    found = []
    for i in range(few):
        one, other = (folder / f"run_{count}/first/{device(i)}" for count in (few, many))
        files = [{p.relative_to(at) for p in at.rglob("*") if p.is_file()} for at in (one, other)]
        found += [f"{device(i)}: other files among {few} than among {many}"] * (
            files[0] != files[1]
        )
        found += [
            f"{one / file} differs from {other / file}"
            for file in sorted(files[0] & files[1])
            if (one / file).read_bytes() != (other / file).read_bytes()
        ]
    return found


if __name__ == "__main__":
    main()
