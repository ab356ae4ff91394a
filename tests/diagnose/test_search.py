"""The search for effects on simulated devices: finds injected effects, and no others."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import imuloop.effects  # noqa: F401  the library of effects
from calibrate.devices import at_rest, recording
from diagnose.models import of_sensor, pair_of, pose_result, problem_of, variants_of
from imuloop.core.samples import SENSORS
from imuloop.diagnose.content import candidates
from imuloop.diagnose.poses import too_few
from imuloop.effects.drifts import WarmUp
from imuloop.estimate.choice import Choices
from imuloop.estimate.held_out import held_out_covariance
from imuloop.model.effect import Channels, FittedEffect, find_effect
from imuloop.simulate.truth import example_truth

G_SENSITIVITY = find_effect("g_sensitivity")()
SENSITIVE = of_sensor("gyroscope", G_SENSITIVITY)
VARIANTS = variants_of("gyroscope", G_SENSITIVITY)
# rad/s per m/s^2: 0.1 deg/s per g, as common parts have
MATRIX = np.radians(0.1) / 9.80665 * Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
TRUTH = example_truth()


def with_effect(sensor, effect, values, truth=TRUTH):
    fitted = FittedEffect(effect, dict(zip(effect.parameters, values, strict=True)), {})
    return replace(truth, **{sensor: replace(getattr(truth, sensor), effects=(fitted,))})


def with_g_sensitivity(truth, matrix):
    return with_effect("gyroscope", G_SENSITIVITY, np.ravel(matrix).tolist(), truth)


@pytest.fixture(scope="module")
def sensitive_device():
    truth = with_g_sensitivity(TRUTH, MATRIX)
    return truth, recording(truth, 1)


@pytest.mark.parametrize(("poses", "testable"), [(1, False), (4, False), (11, False), (12, True)])
def test_few_poses_calibrate_and_enough_of_them_are_tested(poses, testable):
    result = pose_result(TRUTH, recording(TRUTH, 3).select(np.arange(41) < poses))
    assert set(result.calibrations) == set(SENSORS)
    for content in result.contents.values():
        assert (content["verdict"] != "not_testable") == testable
        if not testable:
            few = f"{poses} pose{'s' if poses > 1 else ''} found, 12 needed"
            assert content["why"] == (
                f"calibrated; too few poses to test for missing effects: {few}"
            )


def test_six_faces_three_times_are_too_few_attitudes():
    faces = np.tile(np.vstack([np.eye(3), -np.eye(3)]), (3, 1))
    for why in too_few(at_rest(TRUTH.gravity * faces)).values():
        assert why.endswith("18 poses found, 12 needed in 10 attitudes, not 6")


def test_a_held_out_pose_hardly_touches_its_prediction(sensitive_device):
    truth, log = sensitive_device
    pair, spoiled = pair_of(truth, log), {"w": log.poses.w.copy(), "f": log.poses.f.copy()}
    spoiled["w"][0] += 1e-3
    spoiled["f"][0] += 1e-3
    changed = replace(log, poses=replace(log.poses, **spoiled))
    first, again = (Choices(problem_of(pair, m, VARIANTS)) for m in (log, changed))
    problem, held_out = first.problem, frozenset({0})
    training = first.search(held_out)
    assert training.significant_effects(training.kinds) == SENSITIVE
    assert again.search(held_out).significant_effects(training.kinds) == SENSITIVE
    about = problem.linearization(SENSITIVE)
    noise = held_out_covariance(about.alternatives[1][0], about.jacobian, problem.row_folds)
    # the prior's rows come last
    measured = problem.fold_of_row >= 0
    of_pose = (problem.rows[0] == 0).any(axis=1)
    others = (problem.fold_of_row == 0)[measured] & ~of_pose
    still = (problem.of_kind("gravity_norm") | problem.of_kind("pose_rate"))[measured]
    for effects in ((), SENSITIVE):
        errors = [c.errors(lambda held_out, e=effects: e)[measured, 0] for c in (first, again)]
        moved = np.abs(errors[1] - errors[0]) / np.sqrt(np.diag(noise))[measured]
        # the others of its part are predicted as before, but for its influence on the noise
        assert moved[others].max() < 0.05
        assert moved[of_pose & still].min() > 1


def test_what_a_gyroscope_lacks_hides_no_effect_of_the_accelerometer():
    quadratic = find_effect("quadratic")()
    truth = with_effect("accelerometer", quadratic, [1e-4, -1e-4, 1e-4])
    log, log_p = recording(truth, 3), []
    excess = np.random.default_rng(4).normal(0, 1e-3, log.poses.w.shape)
    for w in (log.poses.w, log.poses.w + excess):
        changed = replace(log, poses=replace(log.poses, w=w))
        variants = variants_of("accelerometer", quadratic)
        search = Choices(problem_of(pair_of(truth, changed), changed, variants))
        log_p.append(search.trial((), *variants).log_p)
    assert log_p[1] < 0.8 * log_p[0] < -8


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
@pytest.mark.parametrize("record", ["poses", "static_record"])
def test_a_span_that_a_thermometer_makes_by_itself_is_no_temperature_effect(sensor, record):
    t, three = np.arange(50.0), np.tile([0.0, 0.0, 9.8], (50, 1))
    for kelvin, tried in ((0.3, False), (1.0, False), (3.0, True)):
        channels = Channels(t, three, three, 25 + kelvin * t / t[-1])
        available, others = candidates(sensor, record, channels)
        of_temperature = {c for c in (*available, *others) if "temperature" in c.needs}
        assert len(of_temperature) > 2
        assert {c in available for c in of_temperature} == {tried}
        if not tried:
            assert {others[c][0] for c in of_temperature} == {"not_observable"}


def test_a_time_constant_between_those_of_the_library_is_found_as_it_is():
    truth = with_effect("accelerometer", WarmUp(600.0), [0.5] * 3)
    log = recording(truth, 2)
    # each 1.8 off
    variants = variants_of("accelerometer", WarmUp(330.0), WarmUp(1090.0))
    choices = Choices(problem_of(pair_of(truth, log), log, variants))
    (effect,) = choices.choice().effects
    assert effect.effect.tau == pytest.approx(600.0, rel=0.1)
    fitted = choices.problem.linearization((effect,)).solution.x[-3:]
    np.testing.assert_allclose(fitted, 0.5, rtol=0.1)
