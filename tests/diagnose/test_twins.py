"""Effects that data cannot tell apart, before the data are seen and after."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import kstest

from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.trial import Linear, White, detection_limit, log_p_value, try_shapes
from imuloop.diagnose.twins import imitated, interchangeable

N = 60
T = np.linspace(0, 1, N)


@dataclass(frozen=True)
class Column:
    """A candidate for which only its parameters' names count."""

    number: int = 0
    parameters = {"p": "1"}  # noqa: RUF012
    limit = np.inf


@dataclass(frozen=True)
class Other(Column):
    """Another class of candidates."""


def white(values, jacobian, columns=(), shapes=(), covariance=None):
    linear = Linear(
        values, jacobian, shapes, columns, {"kind": np.arange(N)[:, None].repeat(2, 1)}, {"kind": 1}
    )
    covariance = np.eye(N) if covariance is None else covariance
    return White.of(linear, np.ones(N, dtype=bool), covariance)


def test_the_share_that_another_imitates_is_the_squared_cosine():
    a, b = np.zeros((2, N, 1))
    a[0], b[:2, 0] = 1.0, [np.cos(0.3), np.sin(0.3)]
    found = imitated({"a": [a], "b": [b]})
    assert found == [
        {"effect": "a", "with": "b", "share": pytest.approx(np.cos(0.3) ** 2)},
        {"effect": "b", "with": "a", "share": pytest.approx(np.cos(0.3) ** 2)},
    ]
    b[:2, 0] = [np.cos(0.6), np.sin(0.6)]
    assert imitated({"a": [a], "b": [b]}) == []


def test_a_parameter_that_the_data_do_not_show_is_left_out():
    a, dead = np.eye(N)[:, :1], np.zeros((N, 1))
    found = imitated({"a": [np.hstack([a, dead])], "b": [a], "c": [dead]})
    assert {(f["effect"], f["with"]) for f in found} == {("a", "b"), ("b", "a")}


def test_a_plane_imitates_a_line_in_it_and_the_line_not_the_plane():
    line, plane = np.zeros((N, 1)), np.zeros((N, 2))
    line[:2, 0], plane[0, 0], plane[1, 1] = 1.0, 5.0, 1e-6
    (found,) = imitated({"line": [line], "plane": [plane]})
    assert (found["effect"], found["with"]) == ("line", "plane")
    assert found["share"] == pytest.approx(1)


@pytest.mark.parametrize(("curve", "could"), [(T**1.1, True), (np.sin(9 * T), False)])
def test_a_candidate_stands_in_for_an_effect_of_nearly_its_shape(curve, could):
    rng = np.random.default_rng(0)
    # a constant, and a slope of some twenty standard errors that was added
    jacobian = -np.column_stack([np.ones(N), T])
    truth = np.array([0.0, 10.0])
    data = jacobian @ -truth + rng.normal(size=N)
    fitted = np.linalg.lstsq(-jacobian, data, rcond=None)[0]
    final = white(data + jacobian @ fitted, jacobian)
    answer = interchangeable(final, slice(1, 2), fitted[1:], [-curve[:, None]], 0.005)
    assert answer is could


def test_trials_refit_everything_and_count_their_shapes():
    rng = np.random.default_rng(1)
    root = np.tril(rng.normal(size=(N, N))) / 8 + np.eye(N)
    covariance = root @ root.T
    jacobian = np.column_stack([np.ones(N), T])
    columns = tuple(c[:, None] for c in (np.sin(5 * T), T**2, T**3))
    shapes = (Other(), Column(1), Column(2))
    values = root @ rng.normal(size=N) + 4 * columns[1][:, 0]
    trials, reasons = try_shapes(white(values, jacobian, columns, shapes, covariance), shapes)
    assert not reasons
    weight = np.linalg.inv(covariance)
    for trial in trials.values():
        wide = np.column_stack([jacobian, columns[trial.column]])
        normal = wide.T @ weight @ wide
        x = -np.linalg.solve(normal, wide.T @ weight @ values)
        np.testing.assert_allclose([*trial.step, *trial.values], x, rtol=1e-8)
        left = values + wide @ x
        chi2 = left @ weight @ left
        scale = max(1, chi2 / (N - 3))
        std = np.sqrt(np.linalg.inv(normal)[-1, -1] * scale)
        np.testing.assert_allclose(trial.std, std, rtol=1e-8)
        tried = 2 if type(trial.effect) is Column else 1
        expected = log_p_value(trial.drop, chi2, 1, N - 3) + np.log(tried)
        assert trial.log_p == pytest.approx(expected)


def test_what_the_base_model_takes_up_is_not_tried():
    jacobian = np.column_stack([np.ones(N), T])
    columns = ((3 + 2 * T)[:, None], np.zeros((N, 1)))
    shapes = (Column(), Other())
    trials, reasons = try_shapes(white(T * 0, jacobian, columns, shapes), shapes)
    assert not trials
    assert set(reasons) == {Column, Other}
    assert "taken up by the base model" in reasons[Column]


def test_p_values_are_uniform_without_an_effect():
    rng = np.random.default_rng(2)
    jacobian, column = np.column_stack([np.ones(N), T]), np.sin(9 * T)[:, None]
    drawn = [
        try_shapes(white(rng.normal(size=N), jacobian, (column,), (Column(),)), (Column(),))[0]
        for _ in range(400)
    ]
    # conservative by a little: the scale is never below the noise model's
    assert kstest([t[Column].p_value for t in drawn], "uniform").pvalue > 1e-3


def test_an_effect_of_its_detection_limit_is_found_with_the_stated_power():
    rng = np.random.default_rng(3)
    settings = DiagnoseSettings(power=0.8)
    jacobian, column = np.column_stack([np.ones(N), T]), np.sin(9 * T)[:, None]

    def trial(size):
        noise = rng.normal(size=N)
        made = white(noise - size * column[:, 0], jacobian, (column,), (Column(),))
        return try_shapes(made, (Column(),))[0][Column]

    tests = 10
    quiet = [detection_limit(trial(0.0), 1, settings, tests)["p"] for _ in range(50)]
    limit = np.median(quiet)
    found = [trial(limit).p_value < settings.significance / tests for _ in range(400)]
    # a little less: the scale of the test is never below the noise model's
    assert np.mean(found) == pytest.approx(settings.power, abs=0.06)


def test_a_walk_that_the_noise_model_does_not_exclude_passes_for_no_drift():
    # walk of 0.5 a step beside white noise of 1; its limit is four times as much
    jacobian, drift = np.ones((N, 1)), (1 - np.exp(-5 * T))[:, None]
    limit = np.eye(N) + 4.0 * np.minimum.outer(np.arange(N), np.arange(N))
    rng, alone, guarded, found = np.random.default_rng(6), 0, 0, 0
    for _ in range(200):
        walk = np.cumsum(0.5 * rng.normal(size=N)) + rng.normal(size=N)
        for size in (0.0, 60.0):
            values = walk + size * np.sin(40 * T) if size else walk
            columns = (np.sin(40 * T)[:, None],) if size else (drift,)
            made = [white(values, jacobian, columns, (Column(),), c) for c in (None, limit)]
            log_p = [try_shapes(made[0], (Column(),), d)[0][Column].log_p for d in ((), made[1:])]
            if size:
                found += log_p[1] < np.log(0.01)
            else:
                alone += log_p[0] < np.log(0.01)
                guarded += log_p[1] < np.log(0.01)
    # one in a hundred by chance, and what no walk makes is found as before
    assert alone > 60
    assert guarded <= 6
    assert found == 200
