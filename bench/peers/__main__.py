"""Noise and calibration compared with packages of the registry: `make bench`."""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench.peers.calibration import calibration
from bench.peers.calls import NOISE
from bench.peers.log import RATE as LOG_RATE
from bench.peers.log import still_log
from bench.tables import REPOSITORY, publish, table

# freed memory stays with the process: else page faults of temporaries count, or not, by chance
ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": os.pathsep.join([str(REPOSITORY / "workflow/lib"), str(REPOSITORY)]),
    "MALLOC_MMAP_THRESHOLD_": str(1 << 25),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 32),
}


def contend(axes, environment):
    """Yield contender, its seconds and its result, or None and the reason of its failure.

    Each in its own process, imuloop in this environment, peers in their own.
    """
    with tempfile.TemporaryDirectory() as folder:
        np.save(f"{folder}/axes.npy", axes)
        for peer, call in NOISE.items():
            python = sys.executable if peer == "imuloop" else environment / "bin/python"
            command = [str(python), "-m", "bench.peers.calls", call.__name__, folder]
            how = {"env": os.environ | ENVIRONMENT, "capture_output": True, "text": True}
            done = subprocess.run(command, **how)
            if done.returncode:
                yield peer, None, done.stderr.strip().splitlines()[-1]
            else:
                yield peer, float(done.stdout), np.load(f"{folder}/{call.__name__}.npy")


def noise(hours, seeds, environment):
    """Return the tables of the noise that each finds in logs at rest, plain and behind a filter."""
    rows, n = [], round(hours * 3600 * LOG_RATE)
    for behind_filter in (False, True):
        took, errors, failed = {}, {}, {}
        for seed in seeds:
            truth, axes = still_log([seed, behind_filter], n, behind_filter)
            for peer, seconds, values in contend(axes, environment):
                if seconds is None:
                    failed[peer] = values
                else:
                    took.setdefault(peer, []).append(seconds)
                    errors.setdefault(peer, []).append(np.abs(values / truth - 1))
        which = "behind a low-pass" if behind_filter else "no filter"
        for peer in NOISE:
            if peer in failed:
                rows.append((peer, which, f"failed: {failed[peer]}", *"–––"))
            else:
                ratio = np.concatenate(errors[peer])
                rows.append((peer, which, f"{np.median(took[peer]):.3g}", *map(median_of, ratio.T)))
    size = f"{len(seeds)} × {hours:g} h, {LOG_RATE:g} Hz, six axes"
    return table((size, "log", "processor time, s", "N", "B", "K"), rows)


def median_of(errors):
    """Return the median of relative errors, and of how many it is where some are missing."""
    finite = errors[np.isfinite(errors)]
    if not len(finite):
        return "–"
    part = f" ({len(finite)} of {len(errors)})" if len(finite) < len(errors) else ""
    return f"{100 * np.median(finite):.2g} %{part}"


def main():
    parser = argparse.ArgumentParser(prog="python -m bench.peers", description=__doc__)
    parser.add_argument("--hours", type=float, default=3.0, help="of a log at rest")
    parser.add_argument("--seeds", default="1", help="of logs at rest, with commas")
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="the peers'")
    parser.add_argument("--devices", default="1,2,3,4,5", help="seeds of poses, with commas")
    options = parser.parse_args()
    devices, logs = ([int(s) for s in x.split(",")] for x in (options.devices, options.seeds))
    text = (
        "Versions come from `bench/requirements.txt`. Freed memory stays with each process, "
        "which favours the peers.",
        noise(options.hours, logs, options.environment),
        "Median error of the axes; of time, of the logs. imuloop by the noise and the Allan stage. "
        "allan-variance-analyzer takes the minimum of the curve for B. dedrunk gives no B, and "
        "nothing where it sees no walk; its time includes the reading of a file.",
        calibration(devices, options.environment, ENVIRONMENT),
        "Whole process, from the file of the log to the file of the calibration; median of the "
        "devices. imuloop also estimates the noise and tests for missing effects. The body axes "
        "of each are turned to the true ones.",
    )
    publish("peers", "Beside other packages", "\n\n".join(text))


if __name__ == "__main__":
    main()
