"""The calibration of the Xsens session beside imu_tk: `make bench`; its program by IMU_TK_BIN."""

import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

from bench.measured import CACHE, ingested, missing
from bench.study.tables import table
from imuloop import chain

DEVICE = "xsens_mti"
LOGS = ("xsens_acc.mat", "xsens_gyro.mat")
ROUNDS = 5
# s, quoted: imu_tk, compiled -O3, on this session, its text files read, without covariance
IMU_TK_S = 0.39


def ours():
    """Return the table of the time from samples to calibration, or why there is none."""
    if reason := missing(DEVICE):
        return f"Not run: {reason}"
    with tempfile.TemporaryDirectory() as folder:
        device, taken = ingested(DEVICE, Path(folder)), []
        chain.segment(device)
        chain.noise(device)
        for _ in range(2 * ROUNDS + 1):
            before = time.process_time()
            chain.calibrate(device)
            taken.append(time.process_time() - before)
    rows = [
        (name, f"{seconds:.3f}", f"{seconds / IMU_TK_S:.2f} ×")
        for name, seconds in (
            ("first call", taken[0]),
            (f"best of {2 * ROUNDS} more", min(taken[1:])),
            ("imu_tk, compiled -O3; quoted, not run here", IMU_TK_S),
        )
    ]
    return table((DEVICE, "s", "to imu_tk"), rows)


def theirs(program):
    """Return the time of its program on the two logs as text, or why it failed."""
    mirror = os.environ.get("IMULOOP_MIRROR") or CACHE
    logs = [next(Path(mirror).rglob(name), None) for name in LOGS]
    if None in logs:
        return f"not run, {LOGS[logs.index(None)]} is not at hand"
    taken = []
    for _ in range(ROUNDS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        try:
            subprocess.run([program, *logs], capture_output=True, check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            return f"failed, {error}"
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return f"{min(taken):.3f} s of processor time, best of {ROUNDS}, with its search for rests"


def main():
    program = os.environ.get("IMU_TK_BIN")
    found = theirs(program) if program else "not given"
    print(
        f"{ours()}\n\nFrom Parquet to JSON, without imports and `segment`. The figure of imu_tk is "
        "of another machine, with its reading and search for rests, without covariance. Its "
        f"program here (`IMU_TK_BIN`): {found}."
    )


if __name__ == "__main__":
    main()
