"""Time of the calibration of a recording, from Parquet to JSON: ``make bench``, or alone.

What ``scripts/calibrate.py`` does for a device of finished results, imports not counted: it reads
samples, segments and noise.json, calibrates accelerometer and gyroscope with their covariance, and
writes six_position.json and multi_position.json. The second is the calibration.json of a device in
which the diagnosis finds no effect.
"""

import argparse
import tempfile
import time
from pathlib import Path

import yaml

from bench.study.tables import table
from imuloop.chain import Device, calibrate
from imuloop.config import resolve
from imuloop.core.files import read_json
from imuloop.job_log import open_log

REPOSITORY = Path(__file__).parents[1]
# s, quoted: imu_tk, compiled -O3, on this session, its text files read, without covariance
IMU_TK_S = 0.39


def calibration(folder, config, output):
    """Return the call that calibrates the device of a folder of results, as the workflow does."""
    settings = resolve(config)[folder.name]
    kinds = {p.parent.name: read_json(p)["kind"] for p in sorted(folder.glob("*/quality.json"))}
    for path in (folder / "noise.json", *(folder / name for name in kinds)):
        (output / path.name).symlink_to(path.resolve())
    device = Device(
        folder.name,
        output,
        kinds,
        gravity=settings["gravity"],
        calibrate=settings["calibrate"],
    )
    return lambda: calibrate(device)


def timed(call, repeats):
    """Return processor time and wall time, s, of a first call and the least of some more."""
    taken = []
    for _ in range(repeats + 1):
        processor, wall = time.process_time(), time.perf_counter()
        call()
        taken.append((time.process_time() - processor, time.perf_counter() - wall))
    return taken[0], tuple(map(min, zip(*taken[1:], strict=True)))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="results of config/measured.yaml")
    parser.add_argument("--device", default="xsens_mti")
    parser.add_argument("--repeats", type=int, default=10, help="calls after the first, the best")
    options = parser.parse_args()
    config = yaml.safe_load((REPOSITORY / "config/measured.yaml").read_text())
    with tempfile.TemporaryDirectory() as folder:
        # as a job begins
        open_log(Path(folder) / "log", "bench")
        call = calibration(options.results / options.device, config, Path(folder))
        first, best = timed(call, options.repeats)
    lines = [
        (name, *(f"{seconds:.3f}" for seconds in taken), f"{taken[0] / IMU_TK_S:.2f} ×")
        for name, taken in (("first call", first), (f"best of {options.repeats} more", best))
    ]
    lines.append(("imu_tk, compiled -O3; quoted, not run here", f"{IMU_TK_S:.3f}", "", "1 ×"))
    print(table((options.device, "processor time, s", "wall, s", "to imu_tk"), lines))


if __name__ == "__main__":
    main()
