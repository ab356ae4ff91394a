"""Diagnoses as the stage writes them: one of each verdict, with every field that it may hold."""

from dataclasses import asdict

import numpy as np

from imuloop.calibrate.poses import gather_poses
from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.core.samples import read_columns
from imuloop.core.tables import joined
from imuloop.diagnose.tables import MOVES, no_tables, poses_table
from imuloop.report.findings import UNTESTED

# held-out errors before and after, and floor, SI
SIZES = {
    "gravity_norm": (1.6e-3, 1.6e-3, 1.5e-3),
    "pose_rate": (2.4e-3, 2e-4, 1.8e-4),
    "rotation": (9.1e-3, 2.4e-3, 2.1e-3),
}
OUTPUT = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}


def residual(unit, before, after, floor, n=24):
    found = {"unit": unit, "n": n, "floor": floor, "before": before, "after": after}
    return found | {"chi2_before": (before / floor) ** 2, "chi2_after": (after / floor) ** 2}


def _axes(stem, size):
    return {f"{stem}{axis}": size * (1 + 0.2 * i) for i, axis in enumerate("xyz")}


def _effect(name, values, unit, p, kind, before, after, constants=None):
    return {
        "name": name,
        "constants": constants or {},
        "parameters": values,
        "std": {key: abs(value) / 50 for key, value in values.items()},
        "units": dict.fromkeys(values, unit),
        "p_value": p,
        "residual": kind,
        "heldout_before": before,
        "heldout_after": after,
        "ratio_ci95": [0.8 * after / before, 1.2 * after / before],
    }


def pose_tables(folder, rng):
    """Return the columns of poses.parquet and moves.parquet of the same diagnosis, by name.

    The device has poses on `faces`, and `turns` that were diagnosed.
    """
    faces, turns = (
        gather_poses([read_columns(folder / session / "segments.parquet")])
        for session in ("faces", "turns")
    )
    n = len(turns)
    errors = {
        f"{kind}_{when}": size * (rng.normal(size=n) if when != "floor" else np.ones(n))
        for kind, sizes in SIZES.items()
        for when, size in zip(("before", "after", "floor"), sizes, strict=True)
    }
    poses = [poses_table(faces, ["faces"], {}), poses_table(turns, ["turns"], errors)]
    moves = dict.fromkeys(MOVES, np.full(n - 1, np.nan))
    moves |= {"session": np.full(n - 1, "turns", dtype=object), "pose": np.arange(n - 1)}
    moves |= {"start_s": turns.end_s[:-1], "end_s": turns.start_s[1:]}
    axis = rng.normal(size=(3, n - 1))
    axes = zip(("axis_x", "axis_y", "axis_z"), axis / np.linalg.norm(axis, axis=0), strict=True)
    moves |= dict(axes)
    moves |= {name: rng.uniform(0, 3, n - 1) for name in ("angle_rad", "speed_rad_s")}
    moves |= {name: values[1:] for name, values in errors.items() if name in MOVES}
    return no_tables() | {"poses": joined(poses), "moves": moves}


def static_diagnosis(sensor, sessions, verdict, rng):
    """Return the diagnosis of static records, with effects where the verdict calls for them."""
    if not sessions:
        return UNTESTED | {"why": "no static session"}
    unit, channels = OUTPUT[sensor], [f"{sensor[0]}{axis}" for axis in "xyz"]
    size = 1e-3 if sensor == "accelerometer" else 3e-5
    found = verdict in ("explained", "partly_explained")
    fall = 10.0 if found else 1.0
    block = {**UNTESTED, "verdict": verdict}
    bias = residual(unit, fall * size, size, size, 15 * len(sessions))
    bias["sessions"] = {
        session: {
            axis: {"before": fall * size * (1 + i), "after": size, "floor": size}
            for i, axis in enumerate("xyz")
        }
        for session in sessions
    }
    block["residuals"] = {"bias": bias}
    block["points"] = [p for s in sessions for p in _means(s, size, fall, found, rng)]
    if found:
        name, constants = "bias_temperature", {"order": 1, "reference_temperature": 25.0}
        values = _axes("c1", 3e-4 if sensor == "accelerometer" else 2e-5)
        errors = (fall * size, size)
        block["effects"] = [_effect(name, values, f"{unit} per K", 0.0, "bias", *errors, constants)]
        change = {"before": _coefficients(size), "after": _coefficients(size / 10)}
        block["noise"] = dict.fromkeys(channels, change)
    return block


def _means(session, size, fall, found, rng):
    """Return the points of one session, a lone mean at its start without a floor."""
    after = rng.normal(size=(15, 3)) * size
    before = after + (fall - 1) * size * np.linspace(-1, 1, 15)[:, None]
    return [
        {
            "residual": "bias",
            "session": session,
            "start_s": 60.0 * i,
            "values": b,
            **({"corrected": a} if found else {}),
            "floor": size * 3**0.5 if i else None,
        }
        for i, (b, a) in enumerate(zip(before, after, strict=True))
    ]


def _coefficients(size):
    known, limit = Coefficient.of(size, size / 19.6), Coefficient(upper95=size)
    return asdict(AxisNoise(Q=limit, N=known, B=known, K=limit, R=limit))
