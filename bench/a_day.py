"""A day at rest, six axes, from CSV to noise.json by the workflow: `make a-day`, RATE=200 or 1000.

The log is made piece by piece in a temporary folder, with white noise, flicker and a random walk
of known size; Snakemake runs the stages up to noise.json on two cores; coefficients are compared
with the truth, and everything is deleted. Printed are seconds of the whole and of each stage, the
memory of the largest process, and the intervals that miss the truth.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv

from imuloop.core.files import read_json
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TIME
from imuloop.simulate.noise import flicker, walk

REPOSITORY = Path(__file__).parents[1]
# SI; flicker above `SLOW_RATE`/2 is left out: there it is less than 2e-4 of the white noise
TRUTH = {
    **{name: {"N": 1e-3, "B": 1.5e-4, "K": 7e-6} for name in ACCELERATION},
    **{name: {"N": 1e-4, "B": 1.5e-5, "K": 7e-7} for name in ANGULAR_RATE},
}
MEAN = dict(zip(CHANNELS, (0.1, -0.2, 9.8, 0.01, -0.02, 0.03), strict=True))
SLOW_RATE = 50.0
# rows of a piece
ROWS = 1 << 18
CONFIG = "devices:\n  a_day:\n    sessions:\n      still: {kind: static, file: log.csv}\n"


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


def run(folder, cores):
    """Run the workflow to noise.json; return its seconds and the memory of its largest process."""
    command = [sys.executable, "-m", "snakemake", "-s", str(REPOSITORY / "Snakefile")]
    command += ["-d", str(folder), f"-c{cores}", "--configfile", str(folder / "config.yaml")]
    start = time.monotonic()
    done = subprocess.run(
        [*command, "--", "results/a_day/noise.json"], stderr=subprocess.PIPE, text=True
    )
    took = time.monotonic() - start
    if done.returncode:
        sys.exit(f"the workflow failed:\n{done.stderr[-4000:]}")
    return took, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def stages(folder):
    """Yield seconds and memory of each stage, from Snakemake's benchmark files."""
    for path in sorted((folder / "benchmarks").rglob("*.tsv"), key=lambda p: p.stat().st_mtime_ns):
        row = pd.read_csv(path, sep="\t").iloc[0]
        stage = path.relative_to(folder / "benchmarks").parts[0]
        used = f"processor {row['cpu_time']} s, {row['max_rss']} MB"
        yield f"{stage:8} {row['s']:7.1f} s, {used}"


def misses(axes):
    """Yield the coefficients whose interval does not hold the truth, as text."""
    for name, truth in TRUTH.items():
        for term, value in truth.items():
            low, high = axes[name][term]["ci95"] or (np.nan, np.nan)
            if not (axes[name][term]["identifiable"] and low <= value <= high):
                yield f"{term} of {name} is {value:.1e}, not in [{low:.3e}, {high:.3e}]"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=int, default=200, help="Hz")
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=Path("build"), help="where there is room")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="a-day-", dir=options.folder) as folder:
        folder = Path(folder).resolve()
        (folder / "config.yaml").write_text(CONFIG)
        rows = generate(folder / "log.csv", options.rate, options.hours)
        size = (folder / "log.csv").stat().st_size / 1e9
        took, memory = run(folder, options.cores)
        missed = list(misses(read_json(folder / "results/a_day/noise.json")["axes"]))
        print(
            f"```\n{rows} rows, {options.hours:g} h at {options.rate} Hz, CSV of {size:.2f} GB\n"
            f"CSV to noise.json: {took:.1f} s, {memory:.0f} MB of memory of the largest process, "
            f"on {options.cores} cores",
            *stages(folder),
            sep="\n  ",
        )
    # of 18 intervals of 95 %, four are missed in 1 % of days
    counted = f"{len(missed)} of {3 * len(CHANNELS)} intervals miss the truth"
    print("\n  ".join([counted, *missed]), "```", sep="\n")
    return int(len(missed) > 3)


if __name__ == "__main__":
    sys.exit(main())
