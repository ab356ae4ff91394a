"""The search for effects on simulated devices: finds what is there, says no where nothing is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import imuloop.effects  # noqa: F401  the library of effects
from calibrate.devices import recording
from diagnose.models import pose_sensors
from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.pose_fits import AccelerometerPoses, fitted_calibration
from imuloop.core.effect import Channels, FittedEffect, find_effect
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choice, Choices, ratio_interval
from imuloop.diagnose.records.pose_diagnosis import diagnose_poses, directions_without
from imuloop.diagnose.records.poses import PoseProblem, interleaved
from imuloop.diagnose.residuals import held_out_covariance
from imuloop.diagnose.search import Search, Trial
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.warm_up import WarmUp
from imuloop.simulate.truth import example_truth

GSensitivity = find_effect("g_sensitivity")
G_SENSITIVITY = GSensitivity()
SHAPES = {GSensitivity: (G_SENSITIVITY,)}
# rad/s per m/s^2: 0.1 deg/s per g, as common parts have
MATRIX = np.radians(0.1) / 9.80665 * Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()


def with_g_sensitivity(truth, matrix):
    values = dict(zip(G_SENSITIVITY.parameters, np.ravel(matrix).tolist(), strict=True))
    effect = FittedEffect(find_effect("g_sensitivity")(), values, {})
    return replace(truth, gyroscope=replace(truth.gyroscope, effects=(effect,)))


def problem_of(sensor, made, shapes=SHAPES, parts=10, **more):
    """Return the problem of a sensor's poses, each part of them every so-manieth."""
    fold = interleaved(len(made.poses), parts)
    return PoseProblem(sensor, made, shapes, DiagnoseSettings(), 1, fold, **more)


def diagnosed(truth, made, sensor="gyroscope", **settings):
    return diagnose_poses(pose_sensors(truth, made)[sensor], made, DiagnoseSettings(**settings))


@pytest.fixture(scope="module")
def sensitive():
    truth = with_g_sensitivity(example_truth(), MATRIX)
    return truth, recording(truth, 1)


def test_a_search_that_rounding_ends_is_a_reason_and_no_failure(sensitive, monkeypatch):
    def singular(self, *arguments):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(Search, "best", singular)
    found = diagnosed(*sensitive)
    content = found.content
    assert (content["verdict"], content["why"], found.solution) == ("not_testable", SINGULAR, None)


def test_an_undeclared_effect_is_found_with_its_size(sensitive):
    truth, _ = sensitive
    found = diagnosed(*sensitive)
    content, calibration = found.content, found.solution.calibration
    assert content["verdict"] == "explained"
    assert found.effects == (G_SENSITIVITY,)
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
    std = [calibration.std[f"K{i}"] for i in range(3)]
    assert np.all(np.abs(calibration.K - truth.gyroscope.K) < 4 * np.array(std))


def test_the_residual_after_is_that_of_a_device_without_the_effect(sensitive):
    content, plain = diagnosed(*sensitive).content, example_truth()
    control = diagnosed(plain, recording(plain, 1)).content
    for kind in ("pose_rate", "rotation"):
        after = content["residuals"][kind]["after"]
        assert after <= 1.25 * control["residuals"][kind]["before"]


def test_controls_are_consistent():
    truth = example_truth()
    declared, verdicts = 0, []
    for seed in range(20, 26):
        made = recording(truth, seed)
        for sensor in ("accelerometer", "gyroscope"):
            content = diagnosed(truth, made, sensor, folds=5).content
            declared += len(content["effects"])
            verdicts.append(content["verdict"])
    assert declared == 0
    # one in twenty is above its floor by chance
    assert verdicts.count("consistent") >= len(verdicts) - 2


def test_p_values_of_an_absent_effect_are_uniform():
    truth = example_truth()
    values = []
    for seed in range(40, 56):
        made = recording(truth, seed)
        search = Choices(problem_of(pose_sensors(truth, made)["gyroscope"], made)).search()
        values.append(search.trial((), GSensitivity).p_value)
    # 16 uniform numbers: mean one half within three standard errors, few below one in twenty
    assert np.mean(values) == pytest.approx(0.5, abs=3 / np.sqrt(12 * 16))
    assert np.sum(np.array(values) < 0.05) <= 3


def test_an_effect_outside_the_library_is_unexplained():
    def steps(channels):
        # jumps of the rate with time, which no pose effect follows
        return 2e-3 * np.sign(np.sin(channels.t / 7.0))[:, None] * [1.0, -1.0, 0.5]

    truth = example_truth()
    truth = replace(truth, gyroscope=replace(truth.gyroscope, extra=steps))
    content = diagnosed(truth, recording(truth, 5), folds=5).content
    assert content["verdict"] == "unexplained"
    assert content["effects"] == []
    assert {c["status"] for c in content["candidates"]} <= {
        "rejected",
        "not_available",
        "not_observable",
    }
    # jumps with time: what the residual goes with says so
    assert content["correlates"][0]["p_value"] < 0.05


@pytest.mark.parametrize("folds", [2, 3, 4])
def test_few_parts_find_it_or_say_why_not(sensitive, folds):
    content = diagnosed(*sensitive, folds=folds).content
    if content["verdict"] == "not_testable":
        assert "do not determine the model" in content["why"]
    else:
        assert [e["name"] for e in content["effects"]] == ["g_sensitivity"]


def test_too_few_poses_are_not_testable():
    truth = example_truth()
    few = recording(truth, 3).select(np.arange(41) < 4)
    sensor = pose_sensors(truth, recording(truth, 3))["accelerometer"]
    found = diagnose_poses(sensor, few, DiagnoseSettings())
    assert found.content["verdict"] == "not_testable"
    assert "4 poses found, at least 10 needed" in found.content["why"]
    assert found.solution is None


def test_each_part_is_predicted_by_a_search_that_does_not_see_it(sensitive):
    truth, made = sensitive
    choices = Choices(problem_of(pose_sensors(truth, made)["gyroscope"], made))
    problem, asked = choices.problem, []

    def chosen(out):
        asked.append(out)
        base = choices.choice(out).base
        assert base == (G_SENSITIVITY,)
        # neither its poses nor a rotation with an end in it
        touched = np.isin(problem.ends, list(out)).any(axis=1)
        (held,) = choices.search(out).sight(base).held
        np.testing.assert_array_equal(held, np.flatnonzero(touched))
        return base

    errors = choices.errors(chosen)
    assert asked == [frozenset({k}) for k in range(10)]
    # every pose is held out once, every rotation too
    assert errors.shape == (3 * len(made.poses) + 2 * len(made.rotations), 1)
    assert np.isfinite(errors).all()
    # what nobody sees is predicted by nobody
    seen = np.isfinite(choices.errors(lambda out: (), frozenset({1})))[:, 0]
    np.testing.assert_array_equal(seen, ~(problem.ends == 1).any(axis=1))


def test_a_part_of_a_gyroscope_takes_the_accelerometer_of_its_own_part(sensitive):
    truth, made = sensitive
    sensors, quadratic = pose_sensors(truth, made), find_effect("quadratic")()
    force = problem_of(sensors["accelerometer"], made, {type(quadratic): (quadratic,)}, 4)

    def of_effects(out):
        """Return directions that have an effect where one part is held out."""
        base = (quadratic,) * (out == {2})
        return force.sensor.directions(force.fitted(base, out), made)

    def without_effects(out):
        return directions_without(Choices(force), out, ())

    errors = []
    for directions in (without_effects, of_effects):
        problem = problem_of(sensors["gyroscope"], made, {}, 4, directions=directions)
        errors.append(Choices(problem).following(()))
    changed = (errors[0] != errors[1])[:, 0]
    turns = problem.of_kind("rotation")
    np.testing.assert_array_equal(changed[turns], (problem.fold == 2)[turns])
    assert not changed[problem.fold != 2].any()
    # searched, a part has the effects that it chose
    chosen = Choices(force)
    chosen._choices[frozenset({1})] = Choice((quadratic,))
    np.testing.assert_array_equal(
        directions_without(chosen, frozenset({1}), (quadratic,)),
        force.sensor.directions(force.fitted((quadratic,), frozenset({1})), made),
    )


def test_a_held_out_pose_hardly_touches_its_prediction(sensitive):
    truth, made = sensitive
    sensor = pose_sensors(truth, made)["gyroscope"]
    spoiled = made.poses.w.copy()
    spoiled[0] += 1e-3
    changed = replace(made, poses=replace(made.poses, w=spoiled))
    first, again = (Choices(problem_of(sensor, m)) for m in (made, changed))
    problem, out = first.problem, frozenset({0})
    assert first.choice(out).base == again.choice(out).base == (G_SENSITIVITY,)
    about = problem.about((G_SENSITIVITY,))
    std = np.sqrt(
        np.diag(held_out_covariance(about.alternatives[0][1], about.jacobian, problem.ends))
    )
    own = np.arange(len(std)) < 3
    others = (problem.fold == 0) & ~own
    for effects in ((), (G_SENSITIVITY,)):
        errors = [c.errors(lambda out, e=effects: e)[:, 0] for c in (first, again)]
        moved = np.abs(errors[1] - errors[0]) / std
        # the others of its part are predicted as before, but for what it says of the noise
        assert moved[others].max() < 0.05
        assert moved[own].min() > 1


def test_a_trial_takes_off_what_a_full_refit_does(sensitive):
    truth, made = sensitive
    sensor = pose_sensors(truth, made)["gyroscope"]
    search = Choices(problem_of(sensor, made)).search()
    base, refit = sensor.fit(made), sensor.fit(made, (G_SENSITIVITY,))
    # by the noise as estimated
    columns = search.sight(()).evidence.patterns((G_SENSITIVITY,))[0].columns[0]
    without, wide = (search.sight(()).fit(c, 0) for c in ((), columns))
    drop = without.square[0] - wide.square[0]
    assert base.fit.chi2 - refit.fit.chi2 == pytest.approx(drop, rel=0.02)
    values, std, covariance = search.beside((), G_SENSITIVITY)
    np.testing.assert_allclose(values, refit.fit.x[12:], atol=0.3 * std.max())
    known = fitted_calibration(sensor, refit).effects[0].std
    np.testing.assert_allclose(std, [known[p] for p in G_SENSITIVITY.parameters], rtol=0.05)
    np.testing.assert_allclose(std, np.sqrt(np.diag(covariance)))


def test_the_interval_of_a_ratio_holds_the_ratio():
    rng = np.random.default_rng(2)
    before, fold = rng.normal(size=(400, 3)), np.repeat(np.arange(20), 20)
    low, high = ratio_interval(fold, before, before * 0.5, DiagnoseSettings())
    assert low == pytest.approx(0.5) and high == pytest.approx(0.5)
    low, high = ratio_interval(fold, before, rng.normal(size=(400, 3)), DiagnoseSettings())
    assert low < 1 < high


def test_what_no_axis_confirms_alone_all_may_confirm_together(monkeypatch):
    # each axis gets worse in some parts, all together better in every part
    fold, better = np.repeat(np.arange(9), 4), np.array([0.6, 0.6, 1.3])
    share = np.array([np.roll(better, k) for k in range(9)])[fold]
    size = np.array([1.0, 1e-3, 10.0])
    errors = {(): np.ones((36, 3)) * size, (str,): share * size}
    shown = SimpleNamespace(
        fold=fold, settings=DiagnoseSettings(), shows=lambda *_: ("kind", slice(None))
    )
    choices = Choices(shown)
    monkeypatch.setattr(choices, "following", lambda classes, out: errors[classes])
    kind, before, after, (low, high) = choices._gate((), Trial(("",), 0.0, 1, 3), ("",), None)
    assert kind == "kind" and before.shape == after.shape == (36, 3)
    assert low < np.sqrt((share**2).mean()) * 1.001 and high < 1
    # what is no better in any axis is not confirmed, and the axis stands for itself
    errors[(str,)] = (2 - share[::-1]) * size
    _, before, _, (_, high) = choices._gate((), Trial(("",), 0.0, 1, 3), ("",), None)
    assert before.shape == (36, 1) and high > 1


def test_an_effect_that_other_records_show_is_held_to_what_they_tell(sensitive):
    truth, made = sensitive
    sensor = pose_sensors(truth, made)["gyroscope"]
    true = np.array(list(truth.gyroscope.effects[0].values.values()))

    def fit(std):
        """Return the fit where other records tell the truth with a standard error."""

        def told(effects):
            assert effects == (G_SENSITIVITY,)
            return np.eye(9) / std**2, true / std**2

        problem = problem_of(sensor, made, {}, found=(G_SENSITIVITY,), told=told)
        return problem.about().solution.fit

    plain, free, known, weak = (
        *(sensor.fit(made, effects).fit for effects in ((), (G_SENSITIVITY,))),
        *(fit(std) for std in (1e-9, 1.0)),
    )
    assert known.reduced_chi2 == pytest.approx(1, abs=0.3)
    assert plain.reduced_chi2 > 2 * known.reduced_chi2
    np.testing.assert_allclose(known.x[12:], true, atol=4e-9)
    std = np.sqrt(np.diag(free.covariance))
    assert np.abs((weak.x - free.x) / std).max() < 1e-3
    # half of what is known of it is from either
    both = fit(std[12:])
    alone = np.linalg.inv(free.covariance)
    alone[12:, 12:] += np.diag(std[12:] ** -2)
    np.testing.assert_allclose(both.covariance, np.linalg.inv(alone), rtol=0.02, atol=1e-12)


def test_a_fit_that_its_weights_do_not_allow_is_not_testable(sensitive, monkeypatch):
    covariance = AccelerometerPoses.covariance

    def indefinite(self, solution, recording, noise=None):
        return -covariance(self, solution, recording, noise)

    monkeypatch.setattr(AccelerometerPoses, "covariance", indefinite)
    found = diagnosed(*sensitive, "accelerometer")
    assert found.content["verdict"] == "not_testable" and found.solution is None
    assert found.content["why"] == SINGULAR


def test_an_effect_that_the_others_take_up_whole_is_left_out(monkeypatch):
    """Found first, and no trial beside what was found after it."""
    effects = tuple(find_effect(name)() for name in ("warm_up", "bias_drift"))
    pair = Trial(effects, -50.0, 0, 1)
    choices = Choices(SimpleNamespace(lost=lambda base: None))
    choices._searches[frozenset()] = SimpleNamespace(
        best=lambda base, failed: None if base else pair,
        reshaped=lambda base: base,
        finer=lambda base: base,
        test=lambda others, effect: None,
    )
    gate = "pose_rate", np.ones((3, 1)), np.zeros((3, 1)), [0.1, 0.2]
    monkeypatch.setattr(Choices, "_gate", lambda self, *arguments: gate)
    assert choices.choice() == Choice((), (), {})


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
    truth, names = example_truth(), WarmUp(600.0).parameters
    effect = FittedEffect(WarmUp(600.0), dict.fromkeys(names, 0.5), {})
    truth = replace(truth, accelerometer=replace(truth.accelerometer, effects=(effect,)))
    made = recording(truth, 2)
    sensor = pose_sensors(truth, made)["accelerometer"]
    # each 1.8 off
    library = {WarmUp: (WarmUp(330.0), WarmUp(1090.0))}
    choices = Choices(problem_of(sensor, made, library))
    (found,) = choices.choice().base
    assert found.tau == pytest.approx(600.0, rel=0.1)
    fitted = choices.problem.about((found,)).solution.fit.x[-3:]
    np.testing.assert_allclose(fitted, 0.5, rtol=0.1)


def test_constants_of_two_effects_do_not_depend_on_the_fits_made_before():
    truth = example_truth()
    made = recording(truth, 1)
    sensor, base = pose_sensors(truth, made)["accelerometer"], (WarmUp(200.0), WarmUp(900.0))
    found = []
    for fitted in ((), base[:1], base[1:], base):
        search = Choices(problem_of(sensor, made, {})).search()
        search.problem.about(fitted)
        found.append(search.finer(base))
    assert len(set(found)) == 1
    assert not set(found[0]) & set(base)


def test_the_error_of_a_parameter_holds_that_of_its_time_constant():
    size, pulls = np.array([0.02, -0.02, 0.02]), []
    shown = FittedEffect(WarmUp(260.0), dict(zip(WarmUp.parameters, size, strict=True)), {})
    truth = example_truth()
    truth = replace(truth, accelerometer=replace(truth.accelerometer, effects=(shown,)))
    for seed in range(12):
        made = recording(truth, seed)
        sensor = pose_sensors(truth, made)["accelerometer"]
        problem = problem_of(sensor, made, {WarmUp: (WarmUp(200.0), WarmUp(400.0))})
        search = Choices(problem).search()
        base = search.finer(search.following((WarmUp,)))
        x, covariance = problem.about(base).solution.fit.x, problem.covariance(base)
        pulls.append((x[-3:] - size) / np.sqrt(np.diag(covariance)[-3:]))
    # 36 pulls, those of a device alike; 1.5 where the time constant is taken for known
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.35
