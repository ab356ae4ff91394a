"""Time and memory of the noise stage on a day at 200 Hz, each step in a process of its own.

``python -m bench.noise.speed make FOLDER ROWS [RATE]`` simulates, ``… run FOLDER [THREADS]``
estimates.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bench.noise.product import SETTINGS
from bench.noise.records import Scenario, record
from bench.study.tables import table
from imuloop.chain import Device, noise
from imuloop.core.samples import CHANNELS, Samples, schema
from imuloop.core.segments import segment_table, write_segments

# 24 h at 200 Hz, Hz
ROWS, RATE = 17_280_000, 200.0
NOISE = Scenario("a day", {"N": 0.01, "B": 2e-3, "K": 3e-5})
# the middle of the log is disturbed for so long, s
DISTURBED = 10.0
# samples of a row group, as ingest writes them
ROW_GROUP = 1 << 17
# of the requirement: s, bytes
SECONDS, MEMORY = 60.0, 1.5e9


def make(folder, rows, rate=RATE):
    """Write samples and segments of a simulated session, no more than an axis in memory."""
    axes = []
    for seed, axis in enumerate(CHANNELS):
        axes.append(np.lib.format.open_memmap(folder / f"{axis}.npy", "w+", float, (rows,)))
        axes[-1][:] = record(NOISE, rows, rate, seed)
    path = folder / "day/samples.parquet"
    path.parent.mkdir()
    with pq.ParquetWriter(path, schema(False, {}), compression="zstd") as file:
        for first in range(0, rows, ROW_GROUP):
            last = min(first + ROW_GROUP, rows)
            columns = [np.arange(first, last) / rate, *(x[first:last] for x in axes)]
            file.write_table(pa.table(columns, schema=file.schema))
    for axis in CHANNELS:
        (folder / f"{axis}.npy").unlink()
    end = rows / rate
    first, last = (end - DISTURBED) / 2, (end + DISTURBED) / 2
    segments = segment_table(
        Samples(path),
        [0, first, last],
        [first, last, end],
        ["static", "disturbed", "static"],
        [0, -1, 0],
    )
    write_segments(path.with_name("segments.parquet"), segments, {})


def estimate(folder, threads=2):
    """Run the stage on the session and print seconds, seconds of CPU and bytes."""
    begin = time.perf_counter()
    device = Device("a_day", folder, {"day": "static"}, noise=asdict(SETTINGS), threads=threads)
    if failures := noise(device):
        raise RuntimeError(str(failures[0]))
    took = time.perf_counter() - begin
    used = resource.getrusage(resource.RUSAGE_SELF)
    # bytes on macOS, else kilobytes
    peak = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    print(json.dumps([took, used.ru_utime + used.ru_stime, peak]))


def run(rows=ROWS):
    """Return rows, seconds, seconds of CPU, bytes, and the content of noise.json."""
    with tempfile.TemporaryDirectory() as folder:
        _child("make", folder, str(rows))
        took, cpu, peak = json.loads(_child("run", folder))
        return rows, took, cpu, peak, json.loads((Path(folder) / "noise.json").read_text())


def _child(*arguments):
    command = [sys.executable, "-m", "bench.noise.speed", *arguments]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)}: {done.stderr}")
    return done.stdout


def text(outcome):
    """Return the table."""
    rows, took, cpu, peak, content = outcome
    rate = [[f"{rows:,}", f"{took:.1f}", f"{cpu:.1f}", f"{peak / 1e9:.2f}"]]
    first = table(("rows, six axes", "s", "s of CPU", "peak memory, GB"), rate)
    found = [
        [axis, *(_figure(content["axes"][axis][name]) for name in NOISE.terms)] for axis in CHANNELS
    ]
    head = [f"{name}, true {value:g}" for name, value in NOISE.terms.items()]
    return f"{first}\n\nWhat it found there:\n\n{table(('axis', *head), found)}"


def _figure(c):
    if c["identifiable"]:
        low, high = c["ci95"]
        return f"{c['value']:.4g} ({low:.4g} to {high:.4g})"
    return "–" if c["upper95"] is None else f"< {c['upper95']:.4g}"


def checks(outcome):
    """Yield what is required, its bound, what was found and whether it is met."""
    rows, took, _, peak, _ = outcome
    yield f"{rows:,} rows, six axes: time", f"≤ {SECONDS:g} s", f"{took:.1f} s", took <= SECONDS
    yield (
        f"{rows:,} rows, six axes: memory", f"≤ {MEMORY / 1e9:g} GB", f"{peak / 1e9:.2f} GB",
        peak <= MEMORY,
    )  # fmt: skip


if __name__ == "__main__":
    step, folder, *rest = sys.argv[1:]
    if step == "make":
        make(Path(folder), int(rest[0]), *map(float, rest[1:]))
    else:
        estimate(Path(folder), *map(int, rest))
