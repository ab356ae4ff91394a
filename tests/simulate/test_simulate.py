"""Raw logs: the contract's model by hand, seeds, rounding, temperature, files."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from imuloop.model.effect import FittedEffect, find_effect
from imuloop.simulate.simulate import log_metadata, simulate_session, true_motion, write_log
from imuloop.simulate.truth import Noise, SessionTruth, Thermometer, example_truth

SHORT = SessionTruth("multi_position", poses=4, initial_rest_s=5.0)
F, W = ["ax", "ay", "az"], ["gx", "gy", "gz"]


def device(accelerometer=None, gyroscope=None, session=SHORT, **changes):
    """A device with one session and no noise, with some attributes changed."""
    truth = example_truth(sessions={"one": session}, **changes)
    return replace(
        truth,
        accelerometer=replace(truth.accelerometer, noise=Noise(), **(accelerometer or {})),
        gyroscope=replace(truth.gyroscope, noise=Noise(), **(gyroscope or {})),
    )


def calibrate_output(sensor, raw, e):
    return (((raw - sensor.b) * sensor.K) - e) @ sensor.T.T


def test_model_without_effects_gives_back_the_truth():
    truth = device()
    log, motion = simulate_session(truth, "one"), true_motion(truth, "one")
    assert list(log.columns) == ["t", *F, *W]
    f = calibrate_output(truth.accelerometer, log[F].to_numpy(), 0)
    w = calibrate_output(truth.gyroscope, log[W].to_numpy(), 0)
    np.testing.assert_allclose(f, motion.specific_force, atol=1e-12)
    np.testing.assert_allclose(w, motion.angular_rate, atol=1e-12)


def test_same_seed_same_log_and_other_seed_another():
    truth = example_truth(sessions={"one": SHORT, "two": SHORT})
    first = simulate_session(truth, "one", 7)
    pd.testing.assert_frame_equal(first, simulate_session(truth, "one", 7), check_exact=True)
    pd.testing.assert_frame_equal(
        simulate_session(truth, "one"), simulate_session(truth, "one", SHORT.seed)
    )
    for other in (simulate_session(truth, "one", 8), simulate_session(truth, "two", 7)):
        assert not np.allclose(first[F + W].iloc[:400], other[F + W].iloc[:400])


def test_axes_sessions_and_devices_are_independent():
    still = SessionTruth("static", duration_s=300.0)
    truth = example_truth(sessions={"one": still, "two": still})
    logs = [
        simulate_session(t, s) for t in (truth, replace(truth, name="b")) for s in truth.sessions
    ]
    noise = np.hstack([log[F + W].to_numpy() for log in logs])
    correlation = np.corrcoef(np.diff(noise, axis=0).T)
    # 24 series of 30,000: the largest of 276 pairs stays below some 4 standard errors
    assert np.max(np.abs(correlation - np.eye(24))) < 4.5 * np.sqrt(1.5 / 30_000)


def test_the_device_lags_its_surroundings_and_the_thermometer_the_device():
    heated = SessionTruth(
        "static", duration_s=900.0, temperature=((0, 20), (900, 80)), thermal_s=30.0
    )
    seen = []
    shown = {"extra": lambda channels: seen.append(channels.temperature) or 0.0}
    dull = Thermometer(lag_s=60.0, noise=0.02, step=0.1)
    log = simulate_session(device(shown, session=heated, thermometer=dull), "one")
    t = log["t"].to_numpy()
    slope = 60 / 900
    late = t > 600
    np.testing.assert_allclose(seen[0][late], 20 + slope * (t[late] - 30), atol=1e-6)
    error = log["temperature"].to_numpy()[late] - (20 + slope * (t[late] - 90))
    assert abs(error.mean()) < 2e-3
    assert error.std() == pytest.approx(np.hypot(0.02, 0.1 / np.sqrt(12)), rel=0.05)
    logged = log["temperature"] / 0.1
    np.testing.assert_allclose(logged, np.rint(logged), atol=1e-9)


def test_files_hold_the_log_and_not_the_truth(tmp_path):
    values = {f"G{i}{j}": 1e-4 for i in range(3) for j in range(3)}
    effects = (FittedEffect(find_effect("g_sensitivity")(), values, {}),)
    truth = device(gyroscope={"effects": effects}, name="secret_device")
    path = tmp_path / "one.parquet"
    write_log(path, simulate_session(truth, "one"), log_metadata(truth, "one"))
    table = pq.read_table(path)
    pd.testing.assert_frame_equal(table.to_pandas(), simulate_session(truth, "one"))
    metadata = json.loads(table.schema.metadata[b"imuloop"])
    assert metadata["simulated"] is True and metadata["truth"] == "secret_device"
    assert b"sensitivity" not in path.read_bytes()
