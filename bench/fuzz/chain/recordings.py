"""Recordings that cases are made of, measured and simulated, in SI."""

import tempfile
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from bench.measured import REPOSITORY, devices, ingested, missing
from imuloop.core.samples import SENSORS
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
QUANTITIES = dict(zip(("acceleration", "angular_rate"), SENSORS.values(), strict=True))
# of one count, where a device declares none
SCALES = {"acceleration": 1e-3, "angular_rate": 1e-4}


class NotAtHand(Exception):
    """A recording that this machine does not have."""


@dataclass
class Log:
    """A session, as it was recorded and as it is to be written and declared; SI."""

    kind: str
    t: np.ndarray
    x: dict  # acceleration and angular_rate, (n, 3)
    temperature: np.ndarray | None
    count: dict  # scale and offset of one count by quantity
    gravity: float = STANDARD_GRAVITY
    written: dict = field(default_factory=dict)  # unit by quantity
    declared: dict = field(default_factory=dict)
    rate: float | None = None  # declared, Hz: the log has no time column then
    # that do not belong into a text log: where, as a share of its rows, and what
    lines: list = field(default_factory=list)

    def __len__(self):
        return len(self.t)

    def take(self, rows):
        """Keep some rows, by a copy."""
        self.t = np.array(self.t[rows])
        self.x = {quantity: np.array(values[rows]) for quantity, values in self.x.items()}
        if self.temperature is not None:
            self.temperature = np.array(self.temperature[rows])

    @property
    def step(self):
        """Median step of time, s; 1 where there is none."""
        steps = np.diff(self.t)
        return float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0


@cache
def recording(name):
    """Return the Log of a recording by its name in `FAMILIES`; NotAtHand with the reason."""
    device, session = name.split("/")
    if device in SIMULATED:
        truth = read_truth(REPOSITORY / f"data/replicas/{device}.yaml")
        plan = truth.sessions[session]
        if plan.kind == "static":
            plan = replace(plan, duration_s=MOST_ROWS / truth.rate, disturbances=())
        table = simulate_session(replace(truth, sessions={session: plan}), session)
        kind, gravity, nominal = plan.kind, truth.gravity, {}
    elif reason := missing(device):
        raise NotAtHand(reason)
    else:
        with tempfile.TemporaryDirectory() as folder:
            made = ingested(device, Path(folder))
            table = pq.read_table(made.sessions[session]["samples"]).to_pandas()
        kind, gravity, nominal = made.kinds[session], made.gravity, made.nominal
    table = table[:MOST_ROWS]
    x = {quantity: table[list(axes)].to_numpy() for quantity, axes in QUANTITIES.items()}
    count = {q: {"scale": s, "offset": 0.0} | nominal.get(q, {}) for q, s in SCALES.items()}
    temperature = table["temperature"].to_numpy() if "temperature" in table else None
    return Log(kind, table["t"].to_numpy(), x, temperature, count, gravity)
