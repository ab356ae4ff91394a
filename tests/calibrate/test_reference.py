"""Models of a sensor beside a reference: derivatives, and what comes back of a known truth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from imuloop.calibrate.determined import AXES
from scipy.spatial.transform import Rotation

import imuloop.effects  # noqa: F401
from calibrate.devices import slopes
from imuloop.calibrate.reference.recording import ReferenceLog, ReferenceRecording
from imuloop.calibrate.reference.sensors import TURN, Accelerometer, Gyroscope, started
from imuloop.calibrate.reference.tails import spread
from imuloop.core.effect import find_effect
from imuloop.core.model import SensorCalibration
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit
from imuloop.diagnose.records.reference import ReferenceProblem
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.simulate.reference import Beside, simulate_beside

NOISE = SimpleNamespace(
    axes={c: SimpleNamespace(N=SimpleNamespace(square=1e-12)) for c in CHANNELS}
)
# without noise, at the rate of the reference where both have samples
CLEAN = Beside(duration_s=60.0, attitude_noise=0.0, place_noise=0.0, lost=0.0, swapped=0.0)
# nothing is known of a sensor but its data sheet
NOMINAL = SensorCalibration.nominal(RawUnit("m/s^2", 1.0, 0.0), None)


def beside(cls, known, of=NOMINAL):
    return started(cls(NOISE, 9.80665, of), known)


def fitted(sensor, known, effects=()):
    """Return the fit of a sensor's state and effects to a recording."""
    rows, z = sensor.prior_rows()
    more = sum(len(e.parameters) for e in effects)
    prior = np.pad(rows, ((0, 0), (0, more))), z
    return sensor.fit(known, effects, np.append(sensor.state, np.zeros(more)), prior).fit


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
    sensor = beside(cls, known)
    marker = find_effect("lever_arm")(marker=1)
    effects = (find_effect("g_sensitivity")(),) if cls is Gyroscope else (marker,)
    rng, count = np.random.default_rng(1), sum(len(e.parameters) for e in effects)
    x = np.append(sensor.state, np.zeros(count))
    x = x + rng.normal(0, 1e-3, len(x))
    _, slopes_found = sensor.model_at(x, known, effects).residuals()
    numeric = slopes(lambda x: sensor.model_at(x, known, effects).residuals()[0], x, 1e-5)
    for found, slope in zip(slopes_found.T, numeric.T, strict=True):
        np.testing.assert_allclose(found, slope, atol=1e-2 * np.abs(slope).max())
    # each session has a bias of its own
    base = len(sensor.base)
    assert not slopes_found[:, base - 3 : base].any()


def test_gyroscope_gives_back_offset_scale_and_axes():
    K, T = np.array([1.004, 0.997, 1.001]), np.eye(3)
    # the symmetric part is seen, the rotation is that of the reference's body
    T[0, 1], T[1, 0], T[2, 0] = 0.004, 0.004, -0.003
    own = replace(CLEAN, dt={"gyroscope": -0.004}, K={"gyroscope": K}, T={"gyroscope": T})
    known, effects = recording(own), (find_effect("time_offset")(),)
    found = fitted(beside(Gyroscope, known), known, effects)
    assert found.x[12] == pytest.approx(-0.004, abs=1e-4)
    np.testing.assert_allclose(found.x[6:9], K, atol=5e-4)
    symmetric = [0.004, -0.0015, 0.004, 0.0, -0.0015, 0.0]
    np.testing.assert_allclose(found.x[:6], symmetric, atol=5e-4)
    # of which the data sheet alone says anything
    turn = found.covariance[:6, :6]
    std = np.sqrt(np.einsum("ki,kl,li->i", TURN / 2, turn, TURN / 2))
    np.testing.assert_allclose(std, AXES, rtol=1e-6)


def test_accelerometer_gives_back_where_it_sits():
    own = replace(CLEAN, dt={"accelerometer": 0.002}, arm=(0.02, -0.01, 0.03))
    known = recording(own)
    effects = (find_effect("time_offset")(), find_effect("lever_arm")(marker=1))
    x = fitted(beside(Accelerometer, known), known, effects).x
    assert x[9] == pytest.approx(0.002, abs=1e-4)
    # from the marker to the sensor
    np.testing.assert_allclose(x[10:], [0.02, -0.01, 0.03], atol=5e-4)


def by_poses(cls, rng, T=None):
    """Return a calibration by other records, its state off by some of its errors."""
    count = len(cls.base)
    root = 2e-3 * rng.normal(size=(count, count))
    return replace(
        NOMINAL,
        T=np.eye(3) if T is None else T,
        K=rng.normal(1, 2e-3, 3),
        b=rng.normal(0, 2e-3, 3),
        names=cls.base,
        covariance=root @ root.T,
        method="multi_position",
    )


@pytest.mark.parametrize("cls", [Gyroscope, Accelerometer])
def test_what_is_known_and_what_the_reference_shows_are_one_solution(cls):
    """What other records say joins as the rows of one fit: by the rule of Rauch and Tung.

    Of T and K, s, the reference shows more, and b follows by what both have in common, G:
    b → b + G (ŝ - s), C → C - G (C_s - Ĉ_s) Gᵀ.
    """
    rng, known = np.random.default_rng(12180), recording(replace(CLEAN, duration_s=30.0))
    sensor = beside(cls, known, by_poses(cls, rng))
    found = fitted(replace(sensor, weight=np.full(len(sensor.weight), 1e4)), known)
    s, b = slice(0, len(cls.base) - 3), slice(len(cls.base) - 3, None)
    C, state, spread = sensor.covariance, sensor.state, found.covariance
    _, slope = sensor.model_at(found.x, known).residuals()
    own = np.linalg.inv(np.linalg.inv(C) + 1e4 * slope.T @ slope)
    np.testing.assert_allclose(spread, own, atol=1e-6 * np.abs(own).max())
    assert (np.diag(spread) < 0.7 * np.diag(C))[s].any()
    G = np.linalg.solve(C[s, s], C[s, b]).T
    np.testing.assert_allclose(found.x[b], state[b] + G @ (found.x - state)[s], atol=1e-9)
    # whatever the noise of the reference is, which what is left tells
    problem = ReferenceProblem(
        sensor, known, {}, DiagnoseSettings(), 1, np.arange(len(sensor.weight)) % 5,
        base_rows=sensor.prior_rows(),
    )  # fmt: skip
    for spread in (found.covariance, problem.covariance(())):
        joined = C[b, b] - G @ (C[s, s] - spread[s, s]) @ G.T
        np.testing.assert_allclose(spread[b, b], joined, atol=1e-6 * np.abs(joined).max())


def test_axes_that_are_turned_as_a_whole_leave_the_same():
    rng, known = np.random.default_rng(12181), recording(replace(CLEAN, duration_s=30.0))
    T = np.eye(3) + rng.normal(0, 0.01, (3, 3)) * (1 - np.eye(3))
    turn = Rotation.from_rotvec([0.06, -0.04, 0.05]).as_matrix() @ T
    left = []
    for axes, scale in ((T, np.ones(3)), (turn / np.diag(turn), np.diag(turn))):
        of = by_poses(Gyroscope, np.random.default_rng(1), axes)
        sensor = beside(Gyroscope, known, replace(of, K=of.K * scale))
        left.append(sensor.model_at(sensor.state, known).residuals()[0].reshape(-1, 3))
    sizes = [np.linalg.norm(each, axis=1) for each in left]
    np.testing.assert_allclose(*sizes, atol=1e-3 * sizes[0].max())


@pytest.mark.parametrize("rate", [28.5, 33.3, 100.0, 285.7])
def test_windows_end_within_the_log_whatever_its_rate_and_length(rate):
    for count in range(round(3 * rate), round(3 * rate) + 40):
        attitude, still = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        log = ReferenceLog(np.arange(count) / rate, still, still, None, attitude, still, (1, 1))
        known = ReferenceRecording(("s",), (log,))
        for windows in (known.turns, known.places):
            assert len(windows) > 0 and windows.last.max() < count


def test_bias_and_tilt_of_a_session_are_taken_up():
    known = recording(CLEAN)
    sensor = beside(Accelerometer, known)
    values, _ = sensor.model_at(sensor.state, known).residuals()
    log = known.logs[0]
    tilt = Rotation.from_rotvec([0.003, -0.002, 0.0]).as_matrix()
    # the world as a whole
    other = replace(log, attitude=tilt @ log.attitude, place=log.place @ tilt.T)
    other = replace(other, f=log.f + np.array([0.05, -0.02, 0.01]))
    moved = ReferenceRecording(("s",), (other,))
    again, _ = started(sensor, moved).model_at(sensor.state, moved).residuals()
    np.testing.assert_allclose(again @ np.kron(np.eye(len(again) // 3), tilt), values, atol=1e-3)


@pytest.mark.parametrize("dof", [3, 1e3])
def test_spread_is_that_of_the_drawn_distribution(dof):
    rng = np.random.default_rng(3)
    floor, excess = 1.0, 3.0
    scale = np.sqrt((floor + excess) * dof / rng.chisquare(dof, 4000))
    variance = spread(rng.standard_normal((4000, 3)) * scale[:, None], np.full(4000, floor))
    # of a window in the middle of the distribution, by its weight
    assert np.median(variance) == pytest.approx(floor + excess, rel=0.15)
