"""Allan deviations that others printed."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from bench.study.tables import table
from imuloop.noise.allan import allan_variance

# averaging factors and overlapping deviations of the 1000-point set, NIST SP 1065, table 31
NBS14 = {1: 2.922319e-1, 10: 9.159953e-2, 100: 3.241343e-2}
# half of the last printed digit
PRINTED = {1: 5e-8, 10: 5e-9, 100: 5e-9}
ADIS, ADIS_CURVE, ADIS_RATE = "adis_16405_imu1.parquet", "published_adev.csv", 100.0
ADIS_LIMIT = 1e-5


def nbs14():
    """Return for each printed deviation the factor, the value found and whether it rounds to it."""
    n = [1234567890]
    for _ in range(999):
        n.append(16807 * n[-1] % 2147483647)
    found = np.sqrt(allan_variance([np.array(n) / 2147483647], np.array(list(NBS14))))
    return [
        (m, printed, value, abs(value - printed) <= PRINTED[m])
        for (m, printed), value in zip(NBS14.items(), found, strict=True)
    ]


def adis16405():
    """Return the largest relative difference of each axis to its published curve, or why not."""
    mirror = os.environ.get("IMULOOP_MIRROR")
    if not mirror:
        return "IMULOOP_MIRROR names no folder"
    paths = [next(Path(mirror).rglob(name), None) for name in (ADIS, ADIS_CURVE)]
    if None in paths:
        return f"the folder of IMULOOP_MIRROR holds no {(ADIS, ADIS_CURVE)[paths.index(None)]}"
    samples, curves = pq.read_table(paths[0]), pd.read_csv(paths[1])
    largest = {}
    for axis, name in zip(
        ("ax", "ay", "az", "gx", "gy", "gz"),
        ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z"),
        strict=True,
    ):
        published = curves[curves["axis"] == name]
        factors = np.rint(published["tau_or_level"].to_numpy() * ADIS_RATE).astype(int)
        x = samples[axis].to_numpy().astype(float)
        found = np.sqrt(allan_variance([x], factors))
        largest[axis] = float(np.max(np.abs(found / published["adev"].to_numpy() - 1)))
    return largest


def run():
    """Return both comparisons."""
    return nbs14(), adis16405()


def text(outcomes):
    """Return the tables."""
    small, large = outcomes
    rows = [(m, f"{p:.6e}", f"{v:.8e}", "yes" if same else "**no**") for m, p, v, same in small]
    parts = [table(("NBS14, factor", "printed", "found", "all printed digits"), rows)]
    if isinstance(large, str):
        parts.append(f"ADIS16405: not compared, {large}.")
    else:
        rows = [(axis, f"{difference:.1e}") for axis, difference in large.items()]
        parts.append(table(("ADIS16405, axis", "largest relative difference, 18 times τ"), rows))
    return "\n\n".join(parts)


def checks(outcomes):
    """Yield what is required, its bound, what was found and whether it is met."""
    small, large = outcomes
    same = sum(s for *_, s in small)
    yield "NBS14", "all printed digits", f"{same} of {len(small)}", same == len(small)
    if not isinstance(large, str):
        worst = max(large.values())
        yield "ADIS16405 curves", f"{ADIS_LIMIT:g}", f"{worst:.1e}", worst <= ADIS_LIMIT
