"""The calibration of the Xsens session beside imu_tk: `make bench`."""

import tempfile
import time
from pathlib import Path

from bench.measured import ingested, missing
from imuloop import chain

DEVICE = "xsens_mti"
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
            processor, wall = time.process_time(), time.perf_counter()
            chain.calibrate(device)
            taken.append((time.process_time() - processor, time.perf_counter() - wall))
    best = tuple(map(min, zip(*taken[1:], strict=True)))
    lines = [
        f"| {DEVICE} | processor time, s | wall, s | to imu_tk |\n| --- | --: | --: | --: |",
        *(
            f"| {name} | {processor:.3f} | {wall:.3f} | {processor / IMU_TK_S:.2f} × |"
            for name, (processor, wall) in (
                ("first call", taken[0]),
                (f"best of {2 * ROUNDS} more", best),
            )
        ),
        f"| imu_tk, compiled -O3; quoted, not run here | {IMU_TK_S:.3f} |  | 1 × |",
    ]
    return "\n".join(lines)


def main():
    print(
        f"{ours()}\n\nFrom Parquet to JSON, imports not counted; rests are found before, by the "
        "stage `segment`. The figure quoted for imu_tk is not of this machine, and includes the "
        "reading of its logs and its search for rests, but no covariance: the ratio says on which "
        "side of it this is, no more."
    )


if __name__ == "__main__":
    main()
