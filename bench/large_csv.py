"""Time and memory of ingest on a large CSV: `make large`, 10 GB.

The log is generated in a folder, brought through the ingest stage's own script in a process of
its own, and deleted with its results. Bounds: 1 GB of memory, 100 MB/s on two cores, told on the
way.
"""

import argparse
import os
import resource
import runpy
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from imuloop.core.files import read_json

SCRIPT = Path(__file__).parents[1] / "scripts" / "ingest.py"
# rows whose values repeat; one of them has no number, another one is cut
ROWS = 100_003


def generate(path, size):
    """Write a static log of at least `size` bytes, 1 kHz, about 94 bytes a row.

    Parameters
    ----------
    path : path-like
        File to write.
    size : float
        Bytes.

    Returns
    -------
    int
        Lines after the header.
    """
    rng = np.random.default_rng(1)
    mean = [0.1, -0.2, 9.8, 0.001, -0.002, 0.003, 25]
    spread = [0.02] * 3 + [0.001] * 3 + [0.5]
    text = b",%.8f,%.8f,%.8f,%.10f,%.10f,%.10f,%.4f\n"
    rest = [text % tuple(row) for row in rng.normal(mean, spread, (ROWS, 7)).tolist()]
    rest[ROWS // 2] = b",nan,0,9.8,0,0,0,25\n"
    rest[ROWS // 3] = b",0.1,0.2\n"
    lines = 0
    with open(path, "wb") as file:
        file.write(b"t,ax,ay,az,gx,gy,gz,temperature\n")
        while file.tell() < size:
            rows = enumerate(rest, start=lines)
            file.write(b"".join([b"%.3f%s" % (i / 1e3, row) for i, row in rows]))
            lines += ROWS
    return lines


def run_script(folder, threads):
    """Run the ingest script on log.csv in a folder, as Snakemake would."""
    params = {"device": "imu", "session": "still", "declared": {"kind": "static"}}
    job = SimpleNamespace(
        params=SimpleNamespace(**params, nominal=None, full_scale=None),
        log=[folder / "ingest.log"],
        input=SimpleNamespace(log=[folder / "log.csv"]),
        output=SimpleNamespace(
            samples=folder / "out" / "samples.parquet", quality=folder / "out" / "quality.json"
        ),
        threads=threads,
    )
    runpy.run_path(str(SCRIPT), init_globals={"snakemake": job})


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=10.0)
    parser.add_argument("--folder", type=Path, default="build", help="with room for twice as much")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        run_script(options.child, options.threads)
        return 0
    options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="large-", dir=options.folder) as folder:
        folder = Path(folder)
        start = time.monotonic()
        lines = generate(folder / "log.csv", options.gigabytes * 1e9)
        size = (folder / "log.csv").stat().st_size
        print(f"{size / 1e9:.2f} GB, {lines} lines written in {time.monotonic() - start:.0f} s")
        command = [sys.executable, __file__, "--child", folder, "--threads", options.threads]
        start = time.monotonic()
        subprocess.run([str(each) for each in command], check=True)
        took = time.monotonic() - start
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        figures = read_json(folder / "out" / "quality.json")
        told = (folder / "ingest.log").read_text().count(" s left")
        packed = (folder / "out" / "samples.parquet").stat().st_size
    repeats = lines // ROWS
    assert figures["status"] == "ok", figures["reasons"]
    assert figures["bad_lines"] == figures["non_finite"] == repeats
    assert figures["rows"] == lines - 2 * repeats
    print(
        f"ingest on {options.threads} of {os.cpu_count()} cores: {took:.1f} s, "
        f"{size / took / 1e6:.0f} MB/s, processor {used.ru_utime:.1f} + {used.ru_stime:.1f} s, "
        f"{used.ru_maxrss / 1024:.0f} MB of memory, {told} lines of progress, "
        f"samples {packed / 1e9:.2f} GB"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
