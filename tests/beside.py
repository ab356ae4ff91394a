"""A simulated device with a reference: its files, and their diagnosis."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd

from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit
from imuloop.diagnose.reference import diagnose_reference
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.ingest.ingest import Declared, ingest
from imuloop.model.calibration import Calibration
from imuloop.model.sensor_calibration import SensorCalibration
from simulated_reference import WHITE, simulate_beside

QUATERNION, PLACE = ["qw", "qx", "qy", "qz"], ["px", "py", "pz"]
DECLARED = {
    "columns": {"time": "t", "orientation": QUATERNION, "position": PLACE},
    "units": {},
    "convention": "body_to_world",
}
# white noise as `simulate_beside` has it
_NOISE = {c: WHITE["accelerometer" if c[0] == "a" else "gyroscope"] for c in CHANNELS}
NOISE = SimpleNamespace(
    axes={c: SimpleNamespace(N=SimpleNamespace(square=n**2)) for c, n in _NOISE.items()}
)
# the device has a data sheet and no calibration
NOMINAL = Calibration(
    "d", 9.80665, *(SensorCalibration.nominal(RawUnit(u, 1.0, 0.0), None) for u in ("SI", "SI"))
)


def write_pair(folder, name, pair):
    """Return the paths of a log and of its reference, columns each, which are written."""
    paths = [folder / f"{name}_{role}.parquet" for role in ("log", "reference")]
    for path, columns in zip(paths, pair, strict=True):
        pd.DataFrame(columns).to_parquet(path, index=False)
    return paths


def ingest_session(folder, name, paths, reference=DECLARED, **more):
    """Return paths of samples and quality of a session, by the keys of `ingest`."""
    results = {f"{k}_path": folder / f"{name}.{k}" for k in ("samples", "quality")}
    session = {"device": "d", "session": name, "kind": "reference_motion", "paths": paths}
    declared = Declared(columns={"time": "t"}, reference=reference, **more)
    ingest(**session, declared=declared, **results)
    return results


def diagnose_session(folder, truth, seed, sessions=1, change=lambda columns: columns):
    """Return the diagnosis of a device with a reference, by sensor, and the table of windows.

    `change` takes the columns of the reference, and harms them.
    """
    sessions_read = {}
    for name, k in ((f"hand_{k}", k) for k in range(sessions)):
        log, reference = simulate_beside(truth, [seed, k])
        paths = write_pair(folder, name, (log, change(reference)))
        sources = dict(zip(("log", "reference"), ({"path": p.name} for p in paths), strict=True))
        results = ingest_session(folder, name, paths, sources=sources)
        assert json.loads(results["quality_path"].read_text())["status"] == "ok"
        sessions_read[name] = {"kind": "reference_motion", "samples": results["samples_path"]}
    how = NOISE, truth.gravity, DiagnoseSettings(), 20, NOMINAL
    content, table = diagnose_reference(sessions_read, *how)
    return content, pd.DataFrame(table)


def pulls(fitted, truth):
    """Return the errors of parameters, in their standard errors."""
    value, std = (np.array([*fitted[key].values()]) for key in ("parameters", "std"))
    return (value - truth) / std
