"""The search for effects on simulated devices: finds what is there, says no where nothing is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import imuloop.effects  # noqa: F401  the library of effects
from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise, recording
from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Channels, FittedEffect, find_effect
from imuloop.diagnose.pose_diagnosis import _chosen, diagnose_poses
from imuloop.diagnose.pose_models import AccelerometerPoses, GyroscopePoses
from imuloop.diagnose.search import HeldOut, Search, candidates, folds, ratio_interval
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.simulate.truth import example_truth

GSensitivity = find_effect("g_sensitivity")
G_SENSITIVITY = GSensitivity()
# rad/s per m/s^2: 0.1 deg/s per g, as common parts have
MATRIX = np.radians(0.1) / 9.80665 * Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()


def models(truth):
    force = AccelerometerPoses(
        known_noise(truth), truth.gravity, ACCELERATION_UNIT, CalibrateSettings()
    )
    fallback = None
    return force, GyroscopePoses(force, fallback, (), RATE_UNIT)


def with_g_sensitivity(truth, matrix):
    values = dict(zip(G_SENSITIVITY.parameters, np.ravel(matrix).tolist(), strict=True))
    effect = FittedEffect(find_effect("g_sensitivity")(), values, {})
    return replace(truth, gyroscope=replace(truth.gyroscope, effects=(effect,)))


def whole(model, made, available=None):
    available = {GSensitivity: (G_SENSITIVITY,)} if available is None else available
    keep = np.ones(len(made.poses), dtype=bool)
    return Search(model, made, keep, available, DiagnoseSettings(), 1)


@pytest.fixture(scope="module")
def sensitive():
    truth = with_g_sensitivity(example_truth(), MATRIX)
    return truth, recording(truth, 1)


def test_a_search_that_rounding_ends_is_a_reason_and_no_failure(sensitive, monkeypatch):
    def singular(self):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(Search, "greedy", singular)
    truth, made = sensitive
    content, solution, _ = diagnose_poses(models(truth)[1], made, DiagnoseSettings())
    assert (content["verdict"], content["why"], solution) == ("not_testable", SINGULAR, None)


def test_an_undeclared_effect_is_found_with_its_size(sensitive):
    truth, made = sensitive
    content, solution, _ = diagnose_poses(models(truth)[1], made, DiagnoseSettings())
    assert content["verdict"] == "explained"
    (effect,) = content["effects"]
    assert effect["name"] == "g_sensitivity"
    assert effect["heldout_after"] < effect["heldout_before"] / 3
    assert effect["ratio_ci95"][1] < 1
    score = [
        (effect["parameters"][p] - value) / effect["std"][p]
        for p, value in zip(G_SENSITIVITY.parameters, MATRIX.ravel(), strict=True)
    ]
    assert np.abs(score).max() < 3.5
    # the other parameters are those of the device, not bent by the effect
    truth_k = truth.gyroscope.K
    std = [solution.calibration.std[f"K{i}"] for i in range(3)]
    assert np.all(np.abs(solution.calibration.K - truth_k) < 4 * np.array(std))


def test_the_residual_after_is_that_of_a_device_without_the_effect(sensitive):
    truth, made = sensitive
    content, _, _ = diagnose_poses(models(truth)[1], made, DiagnoseSettings())
    plain = example_truth()
    control, _, _ = diagnose_poses(models(plain)[1], recording(plain, 1), DiagnoseSettings())
    for kind in ("pose_rate", "rotation"):
        after = content["residuals"][kind]["after"]
        assert after <= 1.25 * control["residuals"][kind]["before"]


def test_controls_are_consistent():
    truth = example_truth()
    declared, verdicts = 0, []
    for seed in range(20, 26):
        made = recording(truth, seed)
        for model in models(truth):
            content, _, _ = diagnose_poses(model, made, DiagnoseSettings(folds=5))
            declared += len(content["effects"])
            verdicts.append(content["verdict"])
    assert declared == 0
    # one in twenty is above its floor by chance
    assert verdicts.count("consistent") >= len(verdicts) - 2


def test_p_values_of_an_absent_effect_are_uniform():
    truth = example_truth()
    model = models(truth)[1]
    values = []
    for seed in range(40, 56):
        made = recording(truth, seed)
        values.append(whole(model, made).step().trials[GSensitivity].p_value)
    # 16 uniform numbers: mean one half within three standard errors, few below one in twenty
    assert np.mean(values) == pytest.approx(0.5, abs=3 / np.sqrt(12 * 16))
    assert np.sum(np.array(values) < 0.05) <= 3


def test_an_effect_outside_the_library_is_unexplained():
    def steps(channels):
        # jumps of the rate with time, which no pose effect follows
        return 2e-3 * np.sign(np.sin(channels.t / 7.0))[:, None] * [1.0, -1.0, 0.5]

    truth = example_truth()
    truth = replace(truth, gyroscope=replace(truth.gyroscope, extra=steps))
    content, _, _ = diagnose_poses(models(truth)[1], recording(truth, 5), DiagnoseSettings(folds=5))
    assert content["verdict"] == "unexplained"
    assert content["effects"] == []
    assert {c["status"] for c in content["candidates"]} <= {
        "rejected",
        "not_available",
        "not_observable",
    }
    # jumps with time: what the residual goes with says so
    assert content["correlates"][0]["p_value"] < 0.05


def test_too_few_poses_are_not_testable():
    truth = example_truth()
    few = recording(truth, 3).select(np.arange(41) < 4)
    content, solution, _ = diagnose_poses(models(truth)[0], few, DiagnoseSettings())
    assert content["verdict"] == "not_testable"
    assert "4 poses found, at least 10 needed" in content["why"]
    assert solution is None


def test_the_choice_of_effects_sees_only_the_training_poses(sensitive, monkeypatch):
    truth, made = sensitive
    model = models(truth)[1]
    seen, fit = [], type(model).fit

    def spy(self, recording, effects=(), start=None):
        seen.append(set(recording.poses.start_s))
        return fit(self, recording, effects, start)

    monkeypatch.setattr(GyroscopePoses, "fit", spy)
    available = {GSensitivity: (G_SENSITIVITY,)}
    searches = folds([model] * 4, made, available, DiagnoseSettings(folds=4), 1)
    part = np.arange(len(made.poses)) % 4
    counts = {"pose_rate": 0, "rotation": 0}
    for k, search in enumerate(searches):
        seen.clear()
        effects, _ = search.greedy()
        assert effects == (G_SENSITIVITY,)
        assert all(poses == set(made.poses.start_s[part != k]) for poses in seen)
        for kind, errors in search.errors(effects).items():
            counts[kind] += len(errors)
    # every pose is held out once, every rotation too
    assert counts == {"pose_rate": len(made.poses), "rotation": len(made.rotations)}


def test_a_gyroscope_fold_takes_the_accelerometer_effects_of_its_own_fold(sensitive):
    truth, made = sensitive
    model, quadratic = models(truth)[1], find_effect("quadratic")()
    own = [replace(model, force_effects=(quadratic,) * (k == 2)) for k in range(4)]
    settings = DiagnoseSettings(folds=4)
    alike, mixed = (folds(m, made, {}, settings, 1) for m in ([model] * 4, own))
    for k, (a, b) in enumerate(zip(alike, mixed, strict=True)):
        same = np.array_equal(a.errors()["rotation"], b.errors()["rotation"])
        assert same == (k != 2)


def test_a_held_out_pose_does_not_touch_its_prediction(sensitive):
    truth, made = sensitive
    model = models(truth)[1]
    available = {GSensitivity: (G_SENSITIVITY,)}
    spoiled = made.poses.w.copy()
    spoiled[0] += 1e-3
    changed = replace(made, poses=replace(made.poses, w=spoiled))
    first, again = (
        folds([model] * 4, r, available, DiagnoseSettings(folds=4), 1)[0] for r in (made, changed)
    )
    # the other poses of its part were predicted by the same training set
    for effects in ((), first.greedy()[0]):
        np.testing.assert_allclose(
            again.errors(effects)["pose_rate"][1:],
            first.errors(effects)["pose_rate"][1:],
            rtol=1e-9,
        )
        assert np.any(
            again.errors(effects)["pose_rate"][0] != first.errors(effects)["pose_rate"][0]
        )


def test_a_trial_takes_off_what_a_full_refit_does(sensitive):
    truth, made = sensitive
    model = models(truth)[1]
    base = whole(model, made).step()
    trial = base.trials[GSensitivity]
    refit = model.fit(made, (G_SENSITIVITY,))
    assert base.solution.fit.chi2 - refit.fit.chi2 == pytest.approx(trial.drop, rel=0.02)
    np.testing.assert_allclose(trial.values, refit.fit.x[12:], atol=0.3 * trial.std.max())
    std = [refit.calibration.effects[0].std[p] for p in G_SENSITIVITY.parameters]
    np.testing.assert_allclose(trial.std, std, rtol=0.05)


def test_the_interval_of_a_ratio_holds_the_ratio():
    rng = np.random.default_rng(2)
    before = rng.normal(size=(400, 3))
    held = HeldOut(np.repeat(np.arange(20), 20), before, before * 0.5)
    low, high = ratio_interval(held, DiagnoseSettings())
    assert low == pytest.approx(0.5) and high == pytest.approx(0.5)
    noisy = HeldOut(held.fold, before, rng.normal(size=(400, 3)))
    low, high = ratio_interval(noisy, DiagnoseSettings())
    assert low < 1 < high


def test_an_effect_that_is_known_from_elsewhere_is_taken_off(sensitive):
    truth, made = sensitive
    turn = models(truth)[1]
    plain, known = (m.fit(made).fit for m in (turn, replace(turn, known=truth.gyroscope.effects)))
    assert known.reduced_chi2 == pytest.approx(1, abs=0.3)
    assert plain.reduced_chi2 > 2 * known.reduced_chi2


def test_a_fit_that_its_weights_do_not_allow_is_not_testable(sensitive, monkeypatch):
    truth, made = sensitive
    force = models(truth)[0]
    covariance = AccelerometerPoses.covariance

    def indefinite(self, solution, recording):
        return -covariance(self, solution, recording)

    monkeypatch.setattr(AccelerometerPoses, "covariance", indefinite)
    monkeypatch.setattr(AccelerometerPoses, "at_limits", lambda self: self)
    content, solution, _ = diagnose_poses(force, made, DiagnoseSettings())
    assert content["verdict"] == "not_testable" and solution is None
    assert "not positive definite" in content["why"]


def test_an_effect_that_the_others_take_up_whole_is_left_out():
    """Found first, and no trial beside what was found after it."""
    effects = tuple(find_effect(name)() for name in ("warm_up", "bias_drift"))
    nothing = SimpleNamespace(trials={})
    whole = SimpleNamespace(greedy=lambda: (effects, {}), step=lambda found=(): nothing)
    assert _chosen(whole, []) == ((), [], {})


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
