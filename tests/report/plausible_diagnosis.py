"""Diagnoses as the stage writes them: one of each verdict, with every field that it may hold."""

import numpy as np

from imuloop.calibrate.poses import gather_poses
from imuloop.core.samples import read_columns
from imuloop.core.tables import joined
from imuloop.diagnose.records.pose_tables import MOVES, poses_table

PER_AXIS = "xyz"
OUTPUT = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
GAIN = "rad/s per m/s^2"
# held-out errors before and after, and floor, SI
SIZES = {
    "gravity_norm": (1.6e-3, 1.6e-3, 1.5e-3),
    "pose_rate": (2e-3, 2e-4, 1.8e-4),
    "rotation": (9.1e-3, 2.4e-3, 2.1e-3),
}
# share of a twin, and what a residual goes with
SHARE, PROBE = 0.97, 0.62


def residual(unit, before, after, floor, n=24):
    """Return the held-out figures of one kind of residual."""
    return {
        "unit": unit,
        "n": n,
        "floor": floor,
        "before": before,
        "after": after,
        "chi2_before": (before / floor) ** 2,
        "chi2_after": (after / floor) ** 2,
    }


def _candidate(name, status, why, p=None, after=None, limits=None, unit=None, **more):
    """Return a candidate; `limits` are detection limits by parameter."""
    limits = limits or {}
    return {
        "name": name,
        "status": status,
        "why": why,
        "p_value": p,
        "heldout_after": after,
        "detection_limit": limits or None,
        "units": dict.fromkeys(limits, unit),
        **more,
    }


def _axes(stem, size):
    return {f"{stem}{axis}": size * (1 + 0.2 * i) for i, axis in enumerate(PER_AXIS)}


def _effect(name, values, unit, p, residual, before, after, constants=None):
    return {
        "name": name,
        "constants": constants or {},
        "parameters": values,
        "std": {key: abs(value) / 50 for key, value in values.items()},
        "units": dict.fromkeys(values, unit),
        "p_value": p,
        "residual": residual,
        "heldout_before": before,
        "heldout_after": after,
        "ratio_ci95": [0.8 * after / before, 1.2 * after / before],
    }


def pose_diagnosis(gain):
    """Return a diagnosis of poses: accelerometer consistent, gyroscope explained by two effects.

    Parameters
    ----------
    gain : dict
        Parameters of g_sensitivity.
    """
    cubic = _candidate(
        "cubic",
        "rejected",
        "held-out error does not fall for certain: ratio 1.102 to 1.934",
        1e-3,
        3.1e-3,
        _axes("K3", 2.6e-7),
        "m/s^2 per (m/s^2)^3",
        residual="gravity_norm",
    )
    quadratic = _candidate(
        "quadratic",
        "rejected",
        "the residual does not fall by more than chance",
        0.21,
        1.9e-3,
        _axes("K2", 1.3e-5),
        "m/s^2 per (m/s^2)^2",
        residual="gravity_norm",
    )
    lever = _candidate("lever_arm", "not_observable", "turns from rest to rest do not show it")
    warm = _candidate("bias_temperature", "not_available", "no <b>temperature</b>")
    g = _candidate(
        "g_sensitivity",
        "added",
        "lowers the residual in the fit and on held-out poses",
        1e-12,
        5e-4,
        dict.fromkeys(gain, 2e-5),
        GAIN,
        residual="pose_rate",
        constants={},
        confounded_with=None,
    )
    drift = _candidate(
        "bias_drift",
        "added",
        "lowers the residual in the fit and on held-out poses",
        1e-6,
        1.8e-3,
        _axes("d", 2e-8),
        "rad/s per s",
        residual="pose_rate",
    )
    earth = _candidate(
        "earth_rate",
        "confounded",
        "in these data it could stand in for g_sensitivity: neither adds to the other",
        1e-4,
        1.9e-3,
        {"w_up": 2e-4},
        "rad/s",
        residual="pose_rate",
        confounded_with="g_sensitivity",
    )
    return {
        "accelerometer": {
            "verdict": "consistent",
            "residuals": {"gravity_norm": residual("m/s^2", *SIZES["gravity_norm"])},
            "effects": [],
            "candidates": [warm, lever, cubic, quadratic],
            "confounded": [{"effect": "quadratic", "with": "asymmetry", "share": 0.9964}],
            "correlates": [],
        },
        "gyroscope": {
            "verdict": "explained",
            "residuals": {
                "pose_rate": residual("rad/s", *SIZES["pose_rate"]),
                "rotation": residual("rad", *SIZES["rotation"]),
            },
            "effects": [
                _effect("g_sensitivity", gain, GAIN, 1e-12, "pose_rate", 2e-3, 5e-4),
                _effect(
                    "bias_drift", _axes("d", 8e-7), "rad/s per s", 1e-6, "pose_rate", 5e-4, 2e-4
                ),
            ],
            "candidates": [earth, warm, drift, g],
            "confounded": [{"effect": "earth_rate", "with": "g_sensitivity", "share": SHARE}],
        },
    }


def pose_tables(folder, rng):
    """Return the columns of poses.parquet and moves.parquet of the same diagnosis, by name.

    Parameters
    ----------
    folder : Path
        The device's results: poses on `faces`, and `turns` that were diagnosed.
    rng : Generator
        Of the errors and of the moves.
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
    moves |= dict(
        zip(("axis_x", "axis_y", "axis_z"), axis / np.linalg.norm(axis, axis=0), strict=True)
    )
    moves |= {name: rng.uniform(0, 3, n - 1) for name in ("angle_rad", "speed_rad_s")}
    moves |= {name: values[1:] for name, values in errors.items() if name in MOVES}
    return {"poses": joined(poses), "moves": moves}


def static_diagnosis(sensor, sessions, verdict, rng):
    """Return the diagnosis of static records.

    Parameters
    ----------
    sensor : str
        The sensor.
    sessions : sequence of str
        Names of the static sessions.
    verdict : str
        The contract's word; effects are added where it calls for them.
    rng : Generator
        Of the points.
    """
    if not sessions:
        blank = {"residuals": {}, "effects": [], "candidates": []}
        return {"verdict": "not_testable", "why": "no static session", **blank}
    unit = OUTPUT[sensor]
    size = 1e-3 if sensor == "accelerometer" else 3e-5
    found = verdict in ("explained", "partly_explained")
    fall = 10.0 if found else 1.0
    block = {
        "verdict": verdict,
        "residuals": {"bias": residual(unit, fall * size, size, size, 15 * len(sessions))},
        "points": [p for s in sessions for p in _means(s, size, fall, found, rng)],
        "effects": [],
        "candidates": [],
    }
    block["residuals"]["bias"]["sessions"] = {
        session: {
            axis: {"before": fall * size * (1 + i), "after": size, "floor": size}
            for i, axis in enumerate(PER_AXIS)
        }
        for session in sessions
    }
    if verdict in ("unexplained", "partly_explained"):
        block["correlates"] = [
            {"name": "temperature_rate", "columns": 3, "share": PROBE, "p_value": 0.0},
            {"name": "time", "columns": 6, "share": 0.04, "p_value": 0.3},
        ]
    if found:
        constants = {"order": 1, "reference_temperature": 25.0}
        values = _axes("c1", 3e-4 if sensor == "accelerometer" else 2e-5)
        warm = _effect(
            *("bias_temperature", values, f"{unit} per K", 0.0, "bias"),
            *(fall * size, size, constants),
        )
        block["effects"] = [warm]
        block["by_session"] = {
            "bias_temperature": {
                session: {k: {"value": v * (1 + i), "std": v / 10} for k, v in values.items()}
                for i, session in enumerate(sessions)
            }
        }
        block["noise"] = {
            axis: {"before": _coefficients(size), "after": _coefficients(size / 10)}
            for axis in (("ax", "ay", "az") if sensor == "accelerometer" else ("gx", "gy", "gz"))
        }
    return block


def _means(session, size, fall, found, rng):
    """Return the points of one session, a lone mean at its start without a floor."""
    after = rng.normal(size=(15, 3)) * size
    before = after + (fall - 1) * size * np.linspace(-1, 1, 15)[:, None]
    return [
        {
            "residual": "bias",
            "index": i,
            "session": session,
            "start_s": 60.0 * i,
            "before": float(np.linalg.norm(b)),
            "after": float(np.linalg.norm(a)),
            "values": b,
            **({"corrected": a} if found else {}),
            "floor": size * 3**0.5 if i else None,
        }
        for i, (b, a) in enumerate(zip(before, after, strict=True))
    ]


def _coefficients(size):
    limit = {"value": None, "ci95": None, "upper95": size, "identifiable": False}
    known = {
        "value": size,
        "ci95": [0.9 * size, 1.1 * size],
        "upper95": 1.1 * size,
        "identifiable": True,
    }
    return {"Q": limit, "N": known, "B": known, "K": limit, "R": limit}
