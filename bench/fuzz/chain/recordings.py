"""Recordings that cases are made of, measured and simulated, in SI."""

import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from bench.measured import REPOSITORY, devices, ingested, missing
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import read_truth

# rows of a recording that are held
MOST_ROWS = 120_000
SIMULATED = ("iphone_6", "ipad_pro")
# those of one line come from one device
FAMILIES = (
    *(tuple(f"{name}/{each}" for each in device["sessions"]) for name, device in devices().items()),
    *(tuple(f"{name}/{kind}" for kind in ("static", "multi_position")) for name in SIMULATED),
)
# of one count, where a device declares none
COUNT = {
    "acceleration": {"scale": 1e-3, "offset": 0.0},
    "angular_rate": {"scale": 1e-4, "offset": 0.0},
}


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


@cache
def recording(name):
    """Return a recording by its name in `FAMILIES`; NotAtHand with the reason."""
    device, session = name.split("/")
    if device in SIMULATED:
        truth = read_truth(REPOSITORY / f"data/replicas/{device}.yaml")
        plan = truth.sessions[session]
        if plan.kind == "static":
            plan = replace(plan, duration_s=MOST_ROWS / truth.rate, disturbances=())
        log = simulate_session(replace(truth, sessions={session: plan}), session)
        return _of(plan.kind, log.to_dict("series"), COUNT, truth.gravity)
    if reason := missing(device):
        raise NotAtHand(reason)
    with tempfile.TemporaryDirectory() as folder:
        made = ingested(device, Path(folder))
        table = pq.read_table(made.sessions[session]["samples"]).slice(0, MOST_ROWS)
    columns = {each: table[each].to_numpy() for each in table.column_names}
    declared = {key: {"offset": 0.0, **each} for key, each in made.nominal.items()}
    return _of(made.kinds[session], columns, COUNT | declared, made.gravity)


def _of(kind, columns, count, gravity):
    columns = {name: np.asarray(values)[:MOST_ROWS] for name, values in columns.items()}
    f, w = (np.column_stack([columns[a] for a in axes]) for axes in (ACCELERATION, ANGULAR_RATE))
    return Recording(kind, columns["t"], f, w, columns.get("temperature"), count, gravity)
