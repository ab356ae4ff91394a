"""Beside a reference: its set-up comes back within its errors, and nothing else is found."""

from unittest.mock import patch

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.study.chain import ATTITUDE, run_stages
from beside import DECLARED, QUATERNION, diagnose_session, pulls, write_pair
from imuloop import chain
from imuloop.chain import Device
from imuloop.core.files import read_json
from imuloop.model.calibration import Calibration
from imuloop.validate.attitude import no_attitude
from result_files import fault
from seeds import least_count, seeds
from simulated_reference import Beside

SENSORS = ("accelerometer", "gyroscope")


def device(seed, **more):
    """Return a device with T and K of a cheap part, and biases."""
    rng = np.random.default_rng([seed, 1])
    T = {"gyroscope": np.eye(3) + (1 - np.eye(3)) * rng.normal(0, 0.004, (3, 3))}
    T["accelerometer"] = np.eye(3) + np.triu(rng.normal(0, 0.004, (3, 3)), 1)
    b = {"gyroscope": rng.normal(0, 0.01, 3), "accelerometer": rng.normal(0, 0.1, 3)}
    K = {sensor: 1 + rng.normal(0, 0.004, 3) for sensor in SENSORS}
    return Beside(T=T, K=K, b=b, **{"duration_s": 30.0} | more)


def effects(sensors):
    """Return the effects of each sensor by name."""
    return {s: {e["name"]: e for e in sensors[s]["effects"]} for s in SENSORS}


def turn_body(rotation):
    """Return a change of the reference's columns: its body is another, rotated on the device."""

    def change(columns):
        q = np.column_stack([columns[name] for name in QUATERNION])
        seen = np.isfinite(q[:, 0])
        on_device = Rotation.from_quat(q[seen], scalar_first=True) * rotation(q[seen])
        q[seen] = on_device.as_quat(scalar_first=True)
        return columns | dict(zip(QUATERNION, q.T, strict=True))

    return change


@seeds(4, 60)
def test_a_set_up_comes_back_within_its_errors(tmp_path, seeds):
    """Protects stated errors: over devices they are those that a known truth leaves."""
    every = []
    for seed in range(13000, 13000 + seeds):
        rng = np.random.default_rng([seed, 2])
        late = dict(zip(SENSORS, rng.normal(0, 0.006, 2), strict=True))
        arm, drift, mounting = rng.normal(0, 0.05, 3), rng.normal(0, 1e-4), Rotation.random(rng=rng)
        truth = device(seed, dt=late, drift=drift, arm=tuple(arm))
        change = turn_body(lambda _, mounting=mounting: mounting.inv())
        sensors, _ = diagnose_session(tmp_path, truth, seed, change=change)
        for sensor, block in sensors.items():
            true = {"time_offset": late[sensor], "clock_drift": drift, "lever_arm": arm}
            every += [x for c in block["candidates"] for x in pulls(c, true[c["name"]])]
            (session,) = block["set_up"].values()
            true = np.append(truth.b[sensor], mounting.as_rotvec())
            every += pulls(session, true).tolist()
    assert len(every) == seeds * 18
    assert np.mean(np.square(every)) == pytest.approx(1.0, abs=0.4)
    assert np.mean(np.abs(every) < 1.96) > 0.9 and np.abs(every).max() < 4.5


@seeds(3, 60)
def test_without_an_offset_none_is_written(tmp_path, seeds):
    consistent = 0
    for seed in range(13100, 13100 + seeds):
        sensors, _ = diagnose_session(tmp_path, device(seed), seed)
        assert effects(sensors) == {"accelerometer": {}, "gyroscope": {}}
        consistent += {sensors[s]["verdict"] for s in SENSORS} == {"consistent"}
        for candidate in (c for s in SENSORS for c in sensors[s]["candidates"]):
            assert candidate["status"] == "rejected"
            assert all(limit > 0 for limit in candidate["detection_limit"].values())
    assert consistent >= least_count(seeds, 0.95, 1e-3)


def test_what_one_session_shows_predicts_the_other(tmp_path):
    """Each sensor has its own offset; whole sessions are held out, and windows say which."""
    late = {"gyroscope": -0.009, "accelerometer": 0.003}
    truth = device(13200, dt=late, arm=(0.03, -0.02, 0.03))
    sensors, table = diagnose_session(tmp_path, truth, 13200, sessions=2)
    assert set(effects(sensors)["gyroscope"]) == {"time_offset"}
    assert set(effects(sensors)["accelerometer"]) == {"time_offset", "lever_arm"}
    for sensor, kind in (("gyroscope", "reference_rotation"), ("accelerometer", "reference_force")):
        block, windows = sensors[sensor], table[table["residual"] == kind]
        residual, offset = block["residuals"][kind], effects(sensors)[sensor]["time_offset"]
        assert abs(pulls(offset, late[sensor])[0]) < 3.5
        assert offset["heldout_after"] < offset["heldout_before"] and offset["ratio_ci95"][1] < 1
        assert block["verdict"] == "explained" and set(block["set_up"]) == {"hand_0", "hand_1"}
        assert set(windows["session"]) == {"hand_0", "hand_1"} and len(windows) == residual["n"]
        for key in ("before", "after", "floor"):
            size = np.sqrt((windows[f"{kind}_{key}"] ** 2).mean())
            assert size == pytest.approx(residual[key], rel=1e-9)


@pytest.mark.parametrize("late", [0.0, 0.004])
def test_an_offset_that_drifts_through_zero_is_named(tmp_path, late):
    truth = device(13300, dt={"gyroscope": late}, drift=6e-4)
    fitted = effects(diagnose_session(tmp_path, truth, 13300)[0])["gyroscope"]
    assert set(fitted) == {"clock_drift", *["time_offset"] * bool(late)}
    assert abs(pulls(fitted["clock_drift"], 6e-4)[0]) < 3.5


def test_what_a_reference_gets_wrong_with_attitude_is_no_effect(tmp_path):
    pattern = np.random.default_rng(5).normal(size=(9, 3))

    def wrong(q):
        # half a degree that goes with the attitude, as where other markers are seen
        u = Rotation.from_quat(q, scalar_first=True).as_matrix().reshape(-1, 9)
        return Rotation.from_rotvec(np.radians(0.5) * np.sin(2.5 * u @ pattern))

    sensors, _ = diagnose_session(tmp_path, device(13400), 13400, change=turn_body(wrong))
    assert effects(sensors) == {"accelerometer": {}, "gyroscope": {}}
    assert sensors["gyroscope"]["verdict"] == "unexplained"


def test_attitudes_alone_show_the_gyroscope_alone(tmp_path):
    def lost(columns):
        return columns | {name: np.full(len(columns["t"]), np.nan) for name in ("px", "py", "pz")}

    truth = device(13500, dt={"gyroscope": -0.009})
    sensors, _ = diagnose_session(tmp_path, truth, 13500, change=lost)
    assert sensors["gyroscope"]["verdict"] == "explained"
    assert sensors["accelerometer"]["verdict"] == "not_testable"
    assert "windows" in sensors["accelerometer"]["why"]


def test_rests_calibrate_and_the_reference_writes_neither_t_nor_k(tmp_path):
    truth = device(13600, dt={"gyroscope": -0.009}, rests=2, duration_s=50.0)
    imu = Device("d", tmp_path, {"hand": "reference_motion"}, gravity=truth.gravity)
    from simulated_reference import simulate_beside

    paths = write_pair(tmp_path, "hand", simulate_beside(truth, 13600))
    sources = {"log": {"path": paths[0].name}, "reference": {"path": paths[1].name}}
    told = {"reference": DECLARED, "sources": sources, "columns": {"time": "t"}}
    chain.ingest(imu, "hand", told, paths, reject=True)
    with patch(ATTITUDE, return_value=no_attitude("d", "not asked for")):
        run_stages(imu)
    poses, final = (
        Calibration.from_json(tmp_path / f"{name}.json")
        for name in ("multi_position", "calibration")
    )
    for sensor in SENSORS:
        before, after = getattr(poses, sensor), getattr(final, sensor)
        assert after.method == "multi_position" and not after.effects
        np.testing.assert_allclose(after.T, before.T, atol=1e-9)
        np.testing.assert_allclose(after.K, before.K, atol=1e-9)
    assert fault(tmp_path / "diagnosis.json") is None
    block = read_json(tmp_path / "diagnosis.json")["sensors"]["gyroscope"]["reference"]
    assert [e["name"] for e in block["effects"]] == ["time_offset"]
