"""The calibration of the Xsens session beside imu_tk: `make bench`; its program by IMU_TK_BIN.

The workflow makes what the stage needs, `bench/calibration.py` times it.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.stages import ONE_THREAD, REPOSITORY

CONFIG, DEVICE = REPOSITORY / "config/measured.yaml", "xsens_mti"
LOGS = ("xsens_acc.mat", "xsens_gyro.mat")
ROUNDS = 5


def ours():
    """Return the table of `bench/calibration.py`, or why there is none."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["-s", REPOSITORY / "Snakefile", "-d", folder, "-c2", "--configfile", CONFIG]
        command += ["--quiet", "all", "--", f"results/{DEVICE}/noise.json"]
        python = [sys.executable, "-m"]
        for each in (["snakemake", *command], ["bench.calibration", f"{folder}/results"]):
            environment = {**os.environ, **ONE_THREAD}
            done = subprocess.run(
                [*python, *map(str, each)], env=environment, capture_output=True, text=True
            )
            if done.returncode:
                return f"Not run: {done.stderr.strip().splitlines()[-1]}"
    return done.stdout.strip()


def theirs(program):
    """Return the time of its program on the two logs as text, or why it failed."""
    mirror = os.environ.get("IMULOOP_MIRROR") or REPOSITORY / "data/cache"
    logs = [next(Path(mirror).rglob(name), None) for name in LOGS]
    if None in logs:
        return f"not run, {LOGS[logs.index(None)]} is not at hand"
    taken = []
    for _ in range(ROUNDS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        try:
            subprocess.run([program, *logs], capture_output=True, text=True, check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            return f"failed, {error}"
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return f"{min(taken):.3f} s of processor time, best of {ROUNDS}, with its search for rests"


def main():
    program = os.environ.get("IMU_TK_BIN")
    found = theirs(program) if program else "not given"
    print(
        f"{ours()}\n\nFrom Parquet to JSON, imports not counted; rests are found before, by the "
        "stage `segment`. The figure quoted for imu_tk is not of this machine, and includes the "
        "reading of its logs and its search for rests, but no covariance: the ratio says on which "
        f"side of it this is, no more. Its program here (`IMU_TK_BIN`): {found}."
    )


if __name__ == "__main__":
    main()
