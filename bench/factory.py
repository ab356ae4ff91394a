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
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml

from bench.study.tables import table
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import SessionTruth, example_truth

REPOSITORY = Path(__file__).parents[1]
STATIC_S = 1200.0
# of so many devices one follows the changed default, the others have a setting of their own
FOLLOWS = 10
# jobs of one device by rule: all of them, those of which the code is edited, and those that a
# changed default reaches
WHOLE = Counter("noise calibrate diagnose export report_device".split())
WHOLE.update(["ingest", "segment", "allan"] * 2)
EDITED = Counter("export report_device".split())
DEFAULT = Counter("calibrate diagnose allan allan export report_device".split())
KINDS = ("multi_position", "static")


def main():
    """Make the devices, run, print the table; exit with 1 where a run did other jobs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    folder = REPOSITORY / "build/factory"
    parser.add_argument("folder", type=Path, nargs="?", default=folder, help="of logs and runs")
    parser.add_argument("--devices", default="20,200", help="how many, from few to many")
    parser.add_argument("--cores", type=int, default=2)
    options = parser.parse_args()
    counts = [int(count) for count in options.devices.split(",")]
    data = options.folder / "data"
    data.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(options.cores) as pool:
        list(pool.map(make_logs, [data] * (max(counts) + 1), range(max(counts) + 1)))
    rows = {}
    faults = [f for n in counts for f in measure(options.folder, n, options.cores, rows)]
    each = ("wall, s", "processor s per device")
    heads = [f"{n} devices: {figure}" for n in counts for figure in each]
    print(table(("run", *heads), [(name, *cells) for name, cells in rows.items()]))
    for few, many in pairwise(counts):
        one, other = (options.folder / f"run_{count}/first" for count in (few, many))
        compare = ["diff", "-rq", *(f"-x{device(i)}" for i in range(few, many)), one, other]
        faults += subprocess.run(compare, capture_output=True, text=True).stdout.splitlines()
    print(*faults or ["\nEach run did the jobs it should; results are the same bytes."], sep="\n")
    return bool(faults)


def device(number):
    """Return the name of a device."""
    return f"d{number:04}"


def make_logs(folder, number):
    """Write the logs of a device that are not there: an example, with errors by its number."""
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
        sessions={
            kind: SessionTruth(kind, 10 * number + i, duration_s=STATIC_S)
            for i, kind in enumerate(KINDS)
        },
    )
    for kind in KINDS:
        path = folder / f"{device(number)}_{kind}.csv"
        if not path.exists():
            write_log(path, simulate_session(truth, kind), {})


def measure(folder, count, cores, rows):
    """Time the runs of so many devices into rows by name; return what they did wrongly."""
    work, repository, faults = folder / f"run_{count}", folder / f"repository_{count}", []
    for each in (work, repository):
        shutil.rmtree(each, ignore_errors=True)
        each.mkdir()
    for name in ("workflow", "scripts", "profiles", "data/replicas"):
        shutil.copytree(REPOSITORY / name, repository / name)
    shutil.copy(REPOSITORY / "Snakefile", repository)
    command = [sys.executable, "-m", "snakemake", "-s", repository / "Snakefile", "-d", work]
    command = [*map(str, command), "--configfile", str(work / "config.yaml"), f"-c{cores}"]
    # byte code is kept from job to job, as Python does where nobody forbids it
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}

    def run(name, expected, devices, *arguments):
        begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [*command, *arguments, "--", "results/report.html"],
            **{"capture_output": True, "text": True, "env": environment},
        )
        wall, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        output = done.stdout + done.stderr
        if done.returncode:
            sys.exit(f"{name}, {count} devices: {output[-2000:]}")
        rows.setdefault(name, []).extend((f"{wall:.1f}", f"{processor / devices:.2f}"))
        listed = output.partition("Job stats:")[2].partition("total")[0]
        jobs = {rule: int(n) for rule, n in re.findall(r"(?m)^([a-z_]+) +(\d+)$", listed)}
        wanted = {rule: n * devices for rule, n in expected.items()}
        if jobs != (wanted and wanted | {"report": 1}):
            faults.append(f"{name}, {count} devices: jobs {jobs}, not {wanted}")

    write_config(work, count)
    # not timed: the first start after an installation writes the byte code
    subprocess.run([*command, "-n"], env=environment, capture_output=True)
    run("dry run", WHOLE, count, "-n")
    run("whole run", WHOLE, count)
    run("nothing to do", {}, 1)
    shutil.copytree(work / "results", work / "first")
    for path in ("report.html", "comparison.csv"):
        (work / "first" / path).unlink()
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
        files = {k: {"kind": k, "file": f"../data/{device(i)}_{k}.csv"} for k in KINDS}
        own = {"calibrate": {"face_tolerance": 20}} if i % FOLLOWS else {}
        devices[device(i)] = {"sessions": files, **own}
    config = {"defaults": {"calibrate": {"face_tolerance": face_tolerance}}, "devices": devices}
    (work / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))


if __name__ == "__main__":
    sys.exit(main())
