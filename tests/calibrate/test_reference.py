"""Models of a sensor beside a reference: derivatives, and what comes back of a known truth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import imuloop.effects  # noqa: F401
from calibrate.devices import slopes
from imuloop.calibrate.reference.recording import ReferenceLog, ReferenceRecording
from imuloop.calibrate.reference.sensors import Accelerometer, Gyroscope, started
from imuloop.calibrate.reference.tails import spread
from imuloop.core.effect import find_effect
from imuloop.core.samples import CHANNELS
from imuloop.simulate.reference import Beside, simulate_beside

NOISE = SimpleNamespace(
    axes={c: SimpleNamespace(N=SimpleNamespace(square=1e-12)) for c in CHANNELS}
)
# without noise, at the rate of the reference where both have samples
CLEAN = Beside(duration_s=60.0, attitude_noise=0.0, place_noise=0.0, lost=0.0, swapped=0.0)


def recording(truth, seed=12160):
    log, reference = simulate_beside(truth, seed)
    own = slice(None, None, 2)
    f, w = (np.column_stack([log[f"{s}{k}"][own] for k in "xyz"]) for s in "ag")
    q = np.column_stack([reference[k] for k in ("qx", "qy", "qz", "qw")])
    place = np.column_stack([reference[k] for k in ("px", "py", "pz")])
    attitude = Rotation.from_quat(q).as_matrix()
    log = ReferenceLog(log["t"][own], f, w, None, attitude, place, (1e-5, 1e-6))
    return ReferenceRecording(("s",), (log,))


@pytest.mark.parametrize("cls", [Gyroscope, Accelerometer])
def test_derivative_is_that_of_the_residuals(cls):
    known = recording(CLEAN)
    sensor = started(cls(NOISE, 9.80665), known)
    marker = find_effect("lever_arm")(marker=1)
    effects = (find_effect("g_sensitivity")(),) if cls is Gyroscope else (marker,)
    rng = np.random.default_rng(1)
    x = sensor.start(effects) + rng.normal(0, 1e-3, len(sensor.start(effects)))
    model = sensor.model_at(x, known, effects)
    numeric = slopes(lambda x: sensor.model_at(x, known, effects).values.ravel(), x, 1e-5)
    for found, slope in zip(model.derivative.reshape(numeric.shape).T, numeric.T, strict=True):
        np.testing.assert_allclose(found, slope, atol=1e-2 * np.abs(slope).max())


def test_gyroscope_gives_back_offset_scale_and_axes():
    K, T = np.array([1.004, 0.997, 1.001]), np.eye(3)
    # the symmetric part is seen, the rotation is that of the reference's body
    T[0, 1], T[1, 0], T[2, 0] = 0.004, 0.004, -0.003
    own = replace(CLEAN, dt={"gyroscope": -0.004}, K={"gyroscope": K}, T={"gyroscope": T})
    known, effects = recording(own), (find_effect("time_offset")(),)
    sensor = started(Gyroscope(NOISE, 9.80665), known)
    x = sensor.fit(known, effects)[0].fit.x
    assert x[6] == pytest.approx(-0.004, abs=1e-4)
    np.testing.assert_allclose(x[3:6], K, atol=5e-4)
    np.testing.assert_allclose(x[:3], [0.004, -0.0015, 0.0], atol=5e-4)


def test_accelerometer_gives_back_where_it_sits():
    own = replace(CLEAN, dt={"accelerometer": 0.002}, arm=(0.02, -0.01, 0.03))
    known = recording(own)
    effects = (find_effect("time_offset")(), find_effect("lever_arm")(marker=1))
    sensor = started(Accelerometer(NOISE, 9.80665), known)
    x = sensor.fit(known, effects)[0].fit.x
    assert x[6] == pytest.approx(0.002, abs=1e-4)
    # from the marker to the sensor
    np.testing.assert_allclose(x[7:], [0.02, -0.01, 0.03], atol=5e-4)


def test_bias_and_tilt_of_a_session_are_taken_up():
    known = recording(CLEAN)
    sensor = started(Accelerometer(NOISE, 9.80665), known)
    values, _ = sensor.model_at(None, known, ()).residuals()
    log = known.logs[0]
    tilt = Rotation.from_rotvec([0.003, -0.002, 0.0]).as_matrix()
    # the world as a whole
    other = replace(log, attitude=tilt @ log.attitude, place=log.place @ tilt.T)
    other = replace(other, f=log.f + np.array([0.05, -0.02, 0.01]))
    moved = ReferenceRecording(("s",), (other,))
    again, _ = started(sensor, moved).model_at(None, moved, ()).residuals()
    np.testing.assert_allclose(again @ np.kron(np.eye(len(again) // 3), tilt), values, atol=1e-3)


@pytest.mark.parametrize("dof", [3, 1e3])
def test_spread_is_that_of_the_drawn_distribution(dof):
    rng = np.random.default_rng(3)
    floor, excess = 1.0, 3.0
    scale = np.sqrt((floor + excess) * dof / rng.chisquare(dof, 4000))
    variance = spread(rng.standard_normal((4000, 3)) * scale[:, None], np.full(4000, floor))
    # of a window in the middle of the distribution, by its weight
    assert np.median(variance) == pytest.approx(floor + excess, rel=0.15)
