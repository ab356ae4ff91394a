"""The workflow timed: a day at rest, and a factory's devices.

``day``: a log of 24 h, six axes, is made piece by piece with white noise, flicker and a random walk
of known size; the workflow runs up to noise.json; coefficients are compared with the truth.

``factory``: devices with their own errors, each with a multi-position session of 6 minutes and a
static one of 20 minutes, both at 100 Hz, as CSV. Timed are a dry run, the whole run, the run with
nothing to do, and the runs after one device is added, one default is changed and one script is
edited, in a copy of the repository. Refused is a run whose jobs are not those it should have, and
results of the first devices that are not the same bytes among few devices as among many.
"""

import argparse
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import yaml

from bench.tables import REPOSITORY, publish, table
from imuloop.core.files import read_json
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TIME
from imuloop.simulate.noise import flicker, walk
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import SessionTruth, example_truth

# --- a day. SI; flicker above `SLOW_RATE`/2 is left out: there it is less than 2e-4 of the white
TRUTH = {
    **{name: {"N": 1e-3, "B": 1.5e-4, "K": 7e-6} for name in ACCELERATION},
    **{name: {"N": 1e-4, "B": 1.5e-5, "K": 7e-7} for name in ANGULAR_RATE},
}
MEAN = dict(zip(CHANNELS, (0.1, -0.2, 9.8, 0.01, -0.02, 0.03), strict=True))
SLOW_RATE = 50.0
# rows of a piece
ROWS = 1 << 18
DAY = "devices:\n  a_day:\n    sessions:\n      still: {kind: static, file: log.csv}\n"
# of 18 intervals of 95 %, four are missed in 1 % of days
MISSED = 3

# --- a factory
STATIC_S = 1200.0
# one of this many devices follows the changed default, the others have their own setting
FOLLOWS = 10
# jobs of one device by rule: all of them, jobs of which the code is edited, and jobs that a
# changed default reaches
WHOLE = Counter("noise calibrate diagnose report_device".split())
WHOLE.update(["ingest", "segment", "allan"] * 2)
EDITED = Counter(["report_device"])
DEFAULT = Counter("calibrate diagnose allan allan report_device".split())
KINDS = ("multi_position", "static")


def timed_process(command, environment, folder=None):
    """Run a command; return wall and processor seconds, its children's with it, and its output.

    Exits with the end of its output where it fails.
    """
    # byte code is kept from job to job, as Python does by default
    environment = {**environment, "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    how = {"env": environment, "cwd": folder, "capture_output": True, "text": True}
    done = subprocess.run(list(map(str, command)), **how)
    wall, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    output = done.stdout + done.stderr
    if done.returncode:
        sys.exit(f"{command[0]} failed:\n{output[-4000:]}")
    return wall, processor, output


def workflow(repository, work, target, cores, *arguments):
    """Run the workflow on ``work/config.yaml``; return wall and processor seconds, and output."""
    command = [sys.executable, "-m", "snakemake", "-s", repository / "Snakefile", "-d", work]
    command += ["--configfile", work / "config.yaml", f"-c{cores}", *arguments, "--", target]
    return timed_process(command, os.environ)


def day(options):
    """Time the log of a day; return whether too many intervals miss the truth."""
    with tempfile.TemporaryDirectory(prefix="day-", dir=options.folder) as folder:
        folder = Path(folder).resolve()
        (folder / "config.yaml").write_text(DAY)
        rows = generate(folder / "log.csv", options.rate, options.hours)
        size = (folder / "log.csv").stat().st_size / 1e9
        target = "results/a_day/noise.json"
        wall, processor, _ = workflow(REPOSITORY, folder, target, options.cores)
        memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        missed = misses(read_json(folder / target)["axes"])
        stages = [("to noise.json", f"{wall:.1f}", f"{processor:.1f}", f"{memory:.0f}")]
        for path in sorted((folder / "benchmarks").rglob("*.tsv"), key=os.path.getmtime):
            took = pd.read_csv(path, sep="\t").iloc[0]
            stage = path.relative_to(folder / "benchmarks").parts[0]
            stages.append((stage, *(f"{took[k]:.1f}" for k in ("s", "cpu_time", "max_rss"))))
    head = ("", "wall, s", "processor, s", "memory of the largest process, MB")
    counted = f"{len(missed)} of {3 * len(CHANNELS)} intervals miss the truth."
    text = [f"{rows} rows, {options.hours:g} h, CSV of {size:.2f} GB, {options.cores} cores."]
    text += [table(head, stages), "\n".join([counted, *(f"- {fault}" for fault in missed)])]
    title = f"{options.hours:g} h at rest at {options.rate} Hz"
    publish(f"day_{options.rate}", title, "\n\n".join(text))
    return len(missed) > MISSED


def generate(path, rate, hours):
    """Write a static log of the truth as CSV; return its number of rows."""
    rng = np.random.default_rng(1)
    n, slow_n, slow = round(hours * 3600 * rate), round(hours * 3600 * SLOW_RATE) + 2, {}
    for name, truth in TRUTH.items():
        slow[name] = MEAN[name] + flicker(slow_n, 1 / SLOW_RATE, truth["B"], rng)
        slow[name] += walk(slow_n, 1 / SLOW_RATE, truth["K"], rng)
    with pa.csv.CSVWriter(path, pa.schema([(x, pa.float64()) for x in (TIME, *CHANNELS)])) as file:
        for first in range(0, n, ROWS):
            t = np.arange(first, min(first + ROWS, n)) / rate
            columns = {TIME: np.round(t, 4)}
            begin = int(t[0] * SLOW_RATE)
            near = slice(begin, int(t[-1] * SLOW_RATE) + 2)
            for name in CHANNELS:
                x = np.interp(t * SLOW_RATE - begin, np.arange(near.stop - begin), slow[name][near])
                x += TRUTH[name]["N"] * np.sqrt(rate) * rng.standard_normal(len(t))
                columns[name] = np.round(x, 8 if name in ACCELERATION else 10)
            file.write_batch(pa.RecordBatch.from_pydict(columns))
    return n


def misses(axes):
    """Return the coefficients whose interval does not hold the truth, as text."""
    faults = []
    for name, truth in TRUTH.items():
        for term, value in truth.items():
            low, high = axes[name][term]["ci95"] or (np.nan, np.nan)
            if not (axes[name][term]["identifiable"] and low <= value <= high):
                faults.append(f"{term} of {name} is {value:.1e}, not in [{low:.3e}, {high:.3e}]")
    return faults


def factory(options):
    """Time few devices and many; return whether a run did other jobs or gave other results."""
    counts, folder = (
        [int(count) for count in options.devices.split(",")],
        options.folder / "factory",
    )
    data, rows, faults = folder / "data", {}, []
    data.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(options.cores) as pool:
        list(pool.map(make_logs, [data] * (max(counts) + 1), range(max(counts) + 1)))
    for count in counts:
        faults += time_runs(folder, count, options.cores, rows)
    for few, many in pairwise(counts):
        first = (f"run_{count}/first" for count in (few, many))
        compare = ["diff", "-rq", *(f"-x{device(i)}" for i in range(few, many)), *first]
        how = {"cwd": folder, "capture_output": True, "text": True}
        faults += subprocess.run(compare, **how).stdout.splitlines()
    figures = ("wall, s", "processor s per device")
    heads = [f"{n} devices: {figure}" for n in counts for figure in figures]
    end = faults or ["Each run did the jobs it should; results are the same bytes."]
    runs = table(("run", *heads), [(name, *cells) for name, cells in rows.items()])
    publish("factory", "A factory's devices", "\n\n".join([runs, *end]))
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


def time_runs(folder, count, cores, rows):
    """Time the runs of `count` devices into rows by name; return their faults."""
    work, repository, faults = folder / f"run_{count}", folder / f"repository_{count}", []
    for place in (work, repository):
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
    for name in ("workflow", "scripts", "profiles", "data/replicas"):
        shutil.copytree(REPOSITORY / name, repository / name)
    shutil.copy(REPOSITORY / "Snakefile", repository)

    def run(name, expected, devices, *arguments):
        how = (repository, work, "results/report.html", cores)
        wall, processor, output = workflow(*how, *arguments)
        rows.setdefault(name, []).extend((f"{wall:.1f}", f"{processor / devices:.2f}"))
        wanted = {rule: n * devices for rule, n in expected.items()}
        faults.extend(other_jobs(f"{name}, {count} devices", output, wanted))

    write_config(work, count)
    # not timed: the first start after an installation writes the byte code
    workflow(repository, work, "results/report.html", cores, "-n")
    run("dry run", WHOLE, count, "-n")
    run("whole run", WHOLE, count)
    run("nothing to do", {}, 1)
    shutil.copytree(work / "results", work / "first")
    # of all devices together
    for path in ("report.html", "comparison.csv", "figures"):
        subprocess.run(["rm", "-rf", work / "first" / path], check=True)
    write_config(work, count + 1)
    run("one device added", WHOLE, 1)
    write_config(work, count + 1, longest_rotation=31)
    run("one default changed", DEFAULT, len(range(0, count + 1, FOLLOWS)))
    with open(repository / "scripts/report_device.py", "a") as file:
        file.write("\nEDITED = True\n")
    run("one script edited", EDITED, count + 1)
    return faults


def other_jobs(name, output, wanted):
    """Yield the jobs of a run, by its output, if they differ from the wanted ones."""
    listed = output.partition("Job stats:")[2].partition("total")[0]
    jobs = {rule: int(n) for rule, n in re.findall(r"(?m)^([a-z_]+) +(\d+)$", listed)}
    # a file of the first run
    jobs.pop("attempt", None)
    if jobs != (wanted and {**wanted, "report": 1}):
        yield f"{name}: jobs {jobs}, not {dict(wanted)}"


def write_config(work, count, longest_rotation=30):
    """Write the config of `count` devices; one of ten has the default setting."""
    devices = {}
    for i in range(count):
        files = {k: {"kind": k, "file": f"../data/{device(i)}_{k}.csv"} for k in KINDS}
        settings = {"calibrate": {"longest_rotation": 30}} if i % FOLLOWS else {}
        devices[device(i)] = {"sessions": files, **settings}
    config = {"defaults": {"calibrate": {"longest_rotation": longest_rotation}}, "devices": devices}
    (work / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))


def main():
    parser = argparse.ArgumentParser(prog="python -m bench.workflow", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("what", choices=("day", "factory"))
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=REPOSITORY / "build", help="with room")
    parser.add_argument("--rate", type=int, default=200, help="of the day, Hz")
    parser.add_argument("--hours", type=float, default=24.0, help="of the day")
    parser.add_argument("--devices", default="20,200", help="of the factory, few to many")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    works = {"day": day, "factory": factory}
    return works[options.what](options)


if __name__ == "__main__":
    sys.exit(main())
