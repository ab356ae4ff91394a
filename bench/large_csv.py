"""Time and memory of ingest on a large CSV: `make large`, 10 GB.

The log is generated in a folder, brought through the ingest stage in a process of its own, and
deleted with its results. Bounds: 1 GB of memory, 100 MB/s on two cores, with lines of progress.
"""

import argparse
import os
import resource
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from imuloop import chain
from imuloop.core.files import read_json

# rows whose values repeat; one of them has no number, another one is cut
ROWS = 100_003


def generate(path, size):
    """Write a static log of at least `size` bytes, 1 kHz; return the lines after the header."""
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


def ingest(folder, threads):
    """Ingest log.csv of a folder; print and keep the lines of progress."""

    def progress(*words):
        with open(folder / "progress", "a") as file:
            print(*words, file=file)

    device = chain.Device("imu", folder, {"still": "static"}, threads=threads)
    chain.ingest(device, "still", {}, [folder / "log.csv"], progress)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=10.0)
    parser.add_argument("--folder", type=Path, default="build", help="with room for twice as much")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="large-", dir=options.folder) as folder:
        folder = Path(folder)
        start = time.monotonic()
        lines = generate(folder / "log.csv", options.gigabytes * 1e9)
        size = (folder / "log.csv").stat().st_size
        print(f"{size / 1e9:.2f} GB, {lines} lines written in {time.monotonic() - start:.0f} s")
        start = time.monotonic()
        process = get_context("spawn").Process(target=ingest, args=(folder, options.threads))
        process.start()
        process.join()
        took = time.monotonic() - start
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        figures = read_json(folder / "still/quality.json")
        reported = len((folder / "progress").read_text().splitlines())
        packed = (folder / "still/samples.parquet").stat().st_size
    repeats = lines // ROWS
    assert figures["status"] == "ok", figures["reasons"]
    assert figures["bad_lines"] == figures["non_finite"] == repeats
    assert figures["rows"] == lines - 2 * repeats
    print(
        f"ingest on {options.threads} of {os.cpu_count()} cores: {took:.1f} s, "
        f"{size / took / 1e6:.0f} MB/s, processor {used.ru_utime:.1f} + {used.ru_stime:.1f} s, "
        f"{used.ru_maxrss / 1024:.0f} MB of memory, {reported} lines of progress, "
        f"samples {packed / 1e9:.2f} GB"
    )


if __name__ == "__main__":
    main()
