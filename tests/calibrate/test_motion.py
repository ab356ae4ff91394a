"""The motion between the rests: its model against derivatives, drawn noise and known effects."""

import numpy as np
import pytest
from imuloop.calibrate.motion import MotionPoses

from bench.study import physics
from bench.study.devices import Injected, with_effects
from calibrate.devices import noiseless, planned, recording
from diagnose.models import pose_sensors
from imuloop.core.effect import find_effect
from imuloop.core.samples import SENSORS
from imuloop.simulate.truth import example_truth

NAMES = ("lever_arm", "time_offset", "rate_sensitivity", "gyro_axis_delay", "anisoinertia")
# of the size of their detection limits, SI
SIZE = dict(zip(NAMES, (1e-3, 3e-4, 5e-3, 5e-4, 2e-3), strict=True))


def short(rate=200.0, poses=20):
    """Return a device whose moves last 1 to 2 s."""
    plan = {"poses": poses, "move_s": (1.0, 2.0), "turns_about_vertical": 0, "temperature": None}
    return planned(example_truth(rate=rate), **plan)


def motion(truth, one):
    """Return the MotionPoses of a recording, about the true base model, and its parameters."""
    sensors = pose_sensors(truth, one)
    base = [
        getattr(getattr(truth, sensor), name[0])[tuple(map(int, name[1:]))]
        for sensor in SENSORS
        for name in sensors[sensor].names
    ]
    turn, quiet = sensors["gyroscope"], np.ones(len(one.rotations), dtype=bool)
    made = MotionPoses(turn.noise, turn.accelerometer, np.array(base), truth.gravity, quiet)
    return made.given_rotation(one, ()), made.x


def values(name, seed=0):
    effect = find_effect(name)()
    drawn = SIZE[name] * np.random.default_rng(seed).uniform(0.5, 1.5, len(effect.parameters))
    return effect, dict(zip(effect.parameters, drawn.tolist(), strict=True))


def test_the_derivative_is_that_of_the_residuals():
    truth = short()
    one = recording(truth, 1)
    model, x = motion(truth, one)
    effects = [values(name) for name in NAMES]
    model = model.model_at(x, one, [effect for effect, _ in effects])
    x = np.concatenate([x, *([*own.values()] for _, own in effects)])
    _, jacobian = model.residuals(x)
    for k, size in enumerate(np.abs(x)):
        step = np.zeros(len(x))
        step[k] = 1e-5 * max(size, 1e-3)
        change = (model.residuals(x + step)[0] - model.residuals(x - step)[0]) / (2 * step[k])
        # the axes that a velocity is taken on turn a little with the parameters
        worst = np.abs(change - jacobian[:, k]).max()
        assert worst < 0.01 * np.abs(jacobian[:, k]).max() + 1e-6, k


@pytest.mark.parametrize("name", NAMES)
def test_what_was_put_in_comes_back(name):
    effect, true = values(name)
    truth = injected(name, true, noiseless(short(poses=30)))
    one = recording(truth, 2)
    found = motion(truth, one)[0].fit(one, (effect,)).fit.x[-len(true) :]
    np.testing.assert_allclose(found, [*true.values()], rtol=0.02, atol=0.01 * SIZE[name])


def injected(name, true, truth):
    extra = lambda now: physics.EFFECTS[name](now, true, {})  # noqa: E731
    return with_effects(truth, [Injected(find_effect(name).sensors[0], name, true, extra=extra)])


@pytest.mark.parametrize("name", ["time_offset", "gyro_axis_delay"])
def test_a_delay_is_taken_out_to_all_orders(name, monkeypatch):
    effect = find_effect(name)()
    # nearly a step of 10 ms
    true = dict(zip(effect.parameters, (-9e-3, 9e-3), strict=False))
    one = recording(injected(name, true, noiseless(short(100.0))), 21)
    made, x = motion(short(100.0), one)
    x = np.append(x, [*true.values()])
    # what the delay adds to an angle is a velocity of 15 mm/s per rad and ms
    velocity = np.flatnonzero(made.rows(one)[1] >= 3)
    left = made.model_at(x, one, (effect,)).residuals(x)[0][velocity]
    assert np.abs(left).max() < 5e-5
    if name == "time_offset":
        monkeypatch.setattr(type(effect), "design_at", lambda self, c, _: self.design(c))
        monkeypatch.setattr(type(effect), "design", of_first_order)
        left = made.model_at(x, one, (effect,)).residuals(x)[0][velocity]
        assert np.abs(left).max() > 2e-3


def of_first_order(effect, channels):
    return channels.remembered(lambda c: np.gradient(c.output, c.t, axis=0))[:, :, None]


def test_a_move_ends_without_velocity_but_for_the_noise_that_is_expected():
    squares, vertical, count = [], [], 4
    for seed in range(count):
        truth = short(100.0)
        one = recording(truth, 100 + seed)
        made, x = motion(truth, one)
        model = made.model_at(x, one, ())
        r, covariance = model.residuals(x)[0], made.covariance_at(x, model, one, made.noise)
        squares.append(r @ np.linalg.solve(covariance, r) / len(r))
        rows = made.rows(one)[1] == list(made.kinds).index("velocity_vertical")
        vertical.append((r[rows] ** 2 / np.diag(covariance)[rows]).mean())
    n, m = len(r), rows.sum()
    assert abs(np.mean(squares) - 1) < 4 * np.sqrt(2 / (n * count))
    assert abs(np.mean(vertical) - 1) < 4 * np.sqrt(2 / (m * count))
