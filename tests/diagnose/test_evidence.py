"""Fits of evidence against plain generalised least squares; p-values averaged over the noise."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import f as f_distribution

from calibrate.devices import UNITS, known_noise, planned, recording
from diagnose.records import LENGTH, record, root, search
from imuloop.calibrate.calibrate import start_pair
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.diagnose.p_values import log_f_tail
from imuloop.diagnose.records.pose_diagnosis import pose_problem
from imuloop.diagnose.records.slow_noise import ratios, unit_noise
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.drifts import Ramp
from imuloop.effects.steps import Steps
from imuloop.effects.temperature import BiasTemperature
from imuloop.simulate.truth import example_truth


@pytest.mark.parametrize("held", [(), (3,), (2, 5)])
def test_a_fit_is_that_of_generalised_least_squares(held):
    rng = np.random.default_rng(1)
    records = [
        record(root(n, 5, 5) @ rng.standard_normal((n, 3)), session=name)
        for n, name in ((40, "a"), (64, "b"))
    ]
    effects = [Ramp(), BiasTemperature(2, 20.0)]
    problem = search(records, effects).problem
    held_out = frozenset(held)
    training_fit, patterns = problem.training_fit((), held_out), problem.evidence.patterns(effects)
    found = training_fit.fit(effects, 1)
    scale = np.concatenate([p.scale[1] for p in patterns])
    used = [
        (rec, np.flatnonzero(~np.isin(part, list(held_out))))
        for rec, part in zip(records, problem.part_of_windows, strict=True)
    ]
    y = np.concatenate([rec.values[rows, 1] for rec, rows in used])
    levels = block_diag(*(np.ones((len(rows), 1)) for _, rows in used))
    # the parameters of the second axis
    designs = [
        [
            e.design(rec.channels)[rows, 1][:, at]
            for e, at in zip(effects, ([1], [1, 4]), strict=True)
        ]
        for rec, rows in used
    ]
    x = np.column_stack([levels, np.concatenate([np.hstack(own) for own in designs])])
    grid, prior = ratios(64 * LENGTH, LENGTH)
    log = []
    for point in (0, 7, len(grid) - 1):
        terms = [(f, unit_noise(n)) for f, n in zip((1, *grid[point]), "NBK", strict=True)]
        covariance = block_diag(
            *(sum(f * n.mean_covariance(rec.windows[rows]) for f, n in terms) for rec, rows in used)
        )
        inverse = np.linalg.inv(covariance)
        information = x.T @ inverse @ x
        theta = np.linalg.solve(information, x.T @ inverse @ y)
        square = (y - x @ theta) @ inverse @ (y - x @ theta)
        assert found.dof == len(y) - x.shape[1]
        assert found.square[point] == pytest.approx(square, rel=1e-6)
        np.testing.assert_allclose(found.theta[point] / scale, theta[-3:], rtol=1e-5)
        spread = np.linalg.inv(information)[-3:, -3:] * square / found.dof
        covariance_found = found.covariance[point] / np.outer(scale, scale)
        np.testing.assert_allclose(covariance_found, spread, rtol=1e-5)
        logs = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(information)[1]
        value = -logs / 2 - found.dof / 2 * np.log(square)
        log.append(found.log_weight[point] - prior[point] - value)
    # the likelihood up to one constant
    np.testing.assert_allclose(log, log[0], atol=1e-5)


def test_columns_that_are_not_independent_give_no_fit():
    shapes = [Steps((600.0,), ("s",)), Steps((-5.0,), ("s",))]
    problem = search([record(np.random.default_rng(2).normal(size=(50, 3)))], shapes).problem
    one, two = shapes
    training_fit = problem.training_fit((), frozenset())
    assert training_fit.fit((one,), 0)
    # a step before the record is a level, and a column twice is one
    assert training_fit.fit((two,), 0) is None
    assert training_fit.fit((one, one), 0) is None


def test_what_shows_in_held_out_rows_alone_gives_no_fit():
    truth = planned(example_truth(rate=50.0), poses=20)
    made, how = recording(truth, 9400), (known_noise(truth), truth.gravity, UNITS)
    pair, _ = start_pair(made, *how, CalibrateSettings())
    problem = pose_problem(pair, made, DiagnoseSettings(folds=5), 1)
    evidence, rng = problem.linearized(()).evidence, np.random.default_rng(3)
    for part in range(problem.parts):
        touched = (problem.row_parts == part).any(axis=1)
        training_fit = evidence.training_fit(frozenset({part}))
        for key in ((part, k) for k in range(10)):
            evidence.add_pattern(key, (touched * rng.normal(size=len(touched)))[:, None, None])
            assert training_fit.fit((key,), 0) is None


def test_tail_of_f_against_scipy_and_below_the_smallest_double():
    for q, dof, statistic in ((1, 40, 3.0), (3, 700, 5.0), (9, 60, 20.0)):
        expected = f_distribution.logsf(statistic, q, dof)
        assert log_f_tail(statistic, q, dof) == pytest.approx(expected, rel=1e-9)
    # with two degrees of freedom the tail is (1 + 2F/ν)^(-ν/2)
    for dof, statistic in ((100, 1e9), (4000, 50.0), (4000, 3e3)):
        exact = -dof / 2 * np.log1p(2 * statistic / dof)
        assert log_f_tail(statistic, 2, dof) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("flicker, walk", [(0, 300), (20, 30)])
def test_slow_noise_is_not_taken_for_a_smooth_effect(flicker, walk):
    rng, n = np.random.default_rng(3), 120
    made, effects = root(n, flicker, walk), [Ramp(), BiasTemperature(2, 20.0)]
    found = []
    for _ in range(25):
        one = search([record(made @ rng.standard_normal((n, 3)))], effects)
        found += [one.test((), effect).p_value for effect in effects]
    # 50 tests of three axes each; at 1 % half a one is expected, five would be one in 1e3 runs
    assert np.sum(np.array(found) < 0.01) <= 4
    assert np.sum(np.array(found) < 1e-3) <= 1
