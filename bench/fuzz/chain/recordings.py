"""Recordings that cases are made of, measured and simulated, in SI."""

import os
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import read_truth

REPOSITORY = Path(__file__).resolve().parents[3]
# rows of a recording that are held
MOST_ROWS = 120_000
AXES = ("x", "y", "z")
SIMULATED = ("iphone_6", "ipad_pro")
SESSIONS = ("static", "six_position", "multi_position")
# those of one line come from one device or from devices of one kind
FAMILIES = (
    ("xsens",),
    ("mpu9150/imu0", "mpu9150/imu1", "mpu9150/imu2"),
    tuple(f"exp_1/{chip}" for chip in range(1, 9)),
    tuple(f"exp_5/{chip}" for chip in range(1, 9)),
    ("adis16405/1", "adis16405/2"),
    ("cats",),
    ("galaxy_s5",),
    ("thermal_chamber",),
    ("ferraris",),
    *(tuple(f"{name}/{session}" for session in SESSIONS) for name in SIMULATED),
)


@dataclass(frozen=True)
class Recording:
    """A log in SI.

    Attributes
    ----------
    kind : str
        What was done with the device.
    t : ndarray, shape (n,)
        s.
    f, w : ndarray, shape (n, 3)
        Specific force, m/s^2, and angular rate, rad/s.
    temperature : ndarray, shape (n,), or None
        degC.
    count : dict
        ``scale`` and ``offset`` of one count by quantity.
    gravity : float
        m/s^2.
    """

    kind: str
    t: np.ndarray
    f: np.ndarray
    w: np.ndarray
    temperature: np.ndarray | None
    count: dict
    gravity: float = STANDARD_GRAVITY


class NotAtHand(Exception):
    """A recording that this machine does not have."""


def at_hand(name):
    """Return the path of a file of others by its name."""
    folders = (os.environ.get("IMULOOP_MIRROR"), REPOSITORY.parent / "shared/data")
    for folder in filter(None, (*folders, REPOSITORY / "data/cache")):
        for path in sorted(Path(folder).rglob(name)):
            return path
    raise NotAtHand(name)


@cache
def recording(name):
    """Return a recording by its name in `FAMILIES`.

    Raises
    ------
    NotAtHand
        With the name of the file.
    """
    family, _, one = name.partition("/")
    if family in SIMULATED:
        return _simulated(family, one)
    return _READERS[family](one)


def _count(acceleration, angular_rate, offset=0):
    """Return what one count is."""
    return {
        "acceleration": {"scale": acceleration, "offset": offset},
        "angular_rate": {"scale": angular_rate, "offset": offset},
    }


def _simulated(name, session):
    truth = read_truth(REPOSITORY / f"data/replicas/{name}.yaml")
    plan = truth.sessions[session]
    if plan.kind == "static":
        plan = replace(plan, duration_s=MOST_ROWS / truth.rate, disturbances=())
    truth = replace(truth, sessions={session: plan})
    log = simulate_session(truth, session).iloc[:MOST_ROWS]
    temperature = log["temperature"].to_numpy() if "temperature" in log else None
    f, w = (log[[f"{k}{axis}" for axis in AXES]].to_numpy() for k in "ag")
    return Recording(plan.kind, log["t"].to_numpy(), f, w, temperature, _count(1e-3, 1e-4))


def _xsens(_):
    count = _count(0.00240964, 0.000209732, 32768)
    found = []
    for sensor, quantity in (("acc", "acceleration"), ("gyro", "angular_rate")):
        table = pd.read_csv(at_hand(f"xsens_{sensor}.mat"), sep=r"\s+", header=None).to_numpy()
        found.append((table[:, 1:] - 32768) * count[quantity]["scale"])
    return Recording("multi_position", table[:, 0], *found, None, count, 9.81744)


def _mpu9150(board):
    values = pd.read_csv(at_hand(f"{board}.log"), sep=" ", header=None).to_numpy(float)
    t = np.arange(len(values)) / 100
    return Recording("multi_position", t, values[:, :3], values[:, 3:6], None, _count(2e-3, 1e-3))


def _array(experiment):
    def chip(number):
        names = ["t_us", *(f"{k}{axis}{number}" for k in "ag" for axis in AXES)]
        table = pq.read_table(at_hand(f"{experiment}.parquet"), columns=names)
        t, *values = (table[name].to_numpy().astype(float) for name in names)
        count = _count(0.0047884, 0.001064225)
        f, w = np.array(values[:3]).T, np.array(values[3:]).T
        f, w = f * count["acceleration"]["scale"], w * count["angular_rate"]["scale"]
        return Recording("multi_position", t / 1e6, f, w, None, count, 9.818)

    return chip


def _adis16405(number):
    table = pq.read_table(at_hand(f"adis_16405_imu{number}.parquet")).slice(0, MOST_ROWS)
    f, w = (np.column_stack([table[f"{k}{axis}"].to_numpy() for axis in AXES]) for k in "ag")
    count = _count(0.00333 * STANDARD_GRAVITY, 0.05 * DEGREE)
    t = np.arange(len(f)) / 100
    return Recording("static", t, f * STANDARD_GRAVITY, w * DEGREE, None, count)


def _cats(_):
    # a day and more in each of three attitudes, handled between
    rows = slice(32_000, 32_000 + MOST_ROWS)
    with h5py.File(at_hand("cats_temperature_calib.nc")) as file:
        f, w = file["acceleration"][rows], file["angular_velocity"][rows] / 1000
        temperature = file["temperature"][rows]
    t = np.arange(len(f), dtype=float)
    return Recording("static", t, f, w, temperature, _count(1e-3, 1e-4))


def _galaxy_s5(_):
    with h5py.File(at_hand("samsung_galaxy_s5.nc")) as file:
        f, w = (file[name][:MOST_ROWS, :3] for name in ("acceleration", "angular_velocity"))
    return Recording("static", np.arange(len(f)) / 10, f, w, None, _count(1e-3, 1e-4))


def _thermal_chamber(_):
    table = pd.read_csv(at_hand("imu_raw_data.csv"), sep="\t")
    f, w = (table[[f"imu.{k}.{axis}" for axis in AXES]].to_numpy() for k in ("acc", "gyro"))
    t = table["timestamp"].to_numpy()
    temperature = table["imu.temperature"].to_numpy()
    return Recording("static", (t - t[0]) / 1e6, f, w, temperature, _count(1e-3, 1e-4))


def _ferraris(_):
    table = pd.read_csv(at_hand("example_ferraris_session.csv"))
    f, w = (table[[f"{k}_{axis}" for axis in AXES]].to_numpy() for k in ("acc", "gyr"))
    t = np.arange(len(f)) / 102.4
    return Recording("six_position", t, f, w * DEGREE, None, _count(4.8e-3, 1e-3))


_READERS = {
    "xsens": _xsens,
    "mpu9150": _mpu9150,
    "exp_1": _array("exp_1"),
    "exp_5": _array("exp_5"),
    "adis16405": _adis16405,
    "cats": _cats,
    "galaxy_s5": _galaxy_s5,
    "thermal_chamber": _thermal_chamber,
    "ferraris": _ferraris,
}
