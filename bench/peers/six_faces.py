"""Six faces, the sections of a log: ``six_faces NAME FOLDER``, in either environment.

The folder holds a log ``<i>.csv`` for each session and its sections ``<i>.json``, as imucal's
example has them: six faces x_p … z_a, three turns x_rot … z_rot. Written is ``NAME.npy``: for each
session the matrix A and the vector c of ``A raw + c``, specific force in m/s², shape (s, 3, 4).
Printed is JSON: seconds of processor time for the first session, from the table in memory on.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

RATE, GRAVITY = 204.8, 9.80665
FACES = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
FORCE = ["acc_x", "acc_y", "acc_z"]
REPEATS = 10


def imucal(log, sections):
    """Accelerometer, gyroscope and g-sensitivity, by its own two calls."""
    from imucal import FerrarisCalibration, ferraris_regions_from_section_list

    regions = ferraris_regions_from_section_list(log, pd.DataFrame(sections).T)
    found = FerrarisCalibration(grav=GRAVITY).compute(
        regions, RATE, from_acc_unit="m/s^2", from_gyr_unit="deg/s"
    )
    matrix = np.linalg.inv(found.K_a @ found.R_a)
    return np.column_stack([matrix, -matrix @ found.b_a])


def imuloop(log, sections):
    """Accelerometer with its covariance."""
    from imuloop.calibrate.six_position import fit_six_position

    force = log[FORCE].to_numpy()
    means = [force[sections[f]["start"] : sections[f]["end"]].mean(axis=0) for f in FACES]
    fit = fit_six_position(means, np.array([1, -1, 2, -2, 3, -3]), GRAVITY)
    matrix = np.eye(3)
    matrix[np.triu_indices(3, 1)] = fit.x[:3]
    matrix = fit.case @ matrix @ np.diag(fit.x[3:6])
    return np.column_stack([matrix, -matrix @ fit.x[6:9]])


CALLS = {"imucal": imucal, "imuloop": imuloop}


def main():
    name, folder = sys.argv[1], Path(sys.argv[2])
    found, seconds = [], []
    for path in sorted(folder.glob("*.csv")):
        log, sections = pd.read_csv(path), json.loads(path.with_suffix(".json").read_text())
        found.append(CALLS[name](log, sections))
        for _ in range(0 if seconds else REPEATS):
            before = time.process_time()
            CALLS[name](log, sections)
            seconds.append(time.process_time() - before)
    np.save(folder / f"{name}.npy", found)
    release = version("imucal") if name == "imucal" else None
    print(json.dumps({"seconds": min(seconds), "version": release}))


if __name__ == "__main__":
    main()
