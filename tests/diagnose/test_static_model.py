"""Least squares of static records against plain generalised least squares."""

from dataclasses import replace

import numpy as np
import pytest

from diagnose.records import LENGTH, record, root, search
from imuloop.diagnose.static_estimate import covariance, estimate, fitted
from imuloop.diagnose.static_model import (
    FITTED,
    StaticModel,
    everything,
    fold_of,
    folds,
    one_session,
    without,
)
from imuloop.diagnose.static_noise import mean_covariance, unit_noise
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.effects.ramp import Ramp
from imuloop.effects.sinusoid import Sinusoid
from imuloop.effects.steps import Steps


def plain(parts, grid_point, columns, axis):
    """Return θ, its covariance for N = 1, χ² and restricted log-likelihood, all by the book."""
    b, k = grid_point
    covariances, designs, values = [], [], []
    for number, (rec, rows, own) in enumerate(parts):
        full = sum(
            f * mean_covariance(unit_noise(name), rec.windows)
            for f, name in ((1, "N"), (b, "B"), (k, "K"))
        )
        covariances.append(full[np.ix_(rows, rows)])
        level = np.zeros((len(rows), len(parts)))
        level[:, number] = 1
        designs.append(np.column_stack([level, own[rows]]))
        values.append(rec.values[rows, axis])
    x, y = np.concatenate(designs), np.concatenate(values)
    n, p = x.shape
    sigma = np.zeros((n, n))
    at = 0
    for c in covariances:
        sigma[at : at + len(c), at : at + len(c)] = c
        at += len(c)
    inverse = np.linalg.inv(sigma)
    information = x.T @ inverse @ x
    theta = np.linalg.solve(information, x.T @ inverse @ y)
    left = y - x @ theta
    square = left @ inverse @ left
    log = -((n - p) * np.log(square) + np.linalg.slogdet(sigma)[1]) / 2
    log -= np.linalg.slogdet(information)[1] / 2
    k = x.shape[1] - len(parts)
    return theta[-k:], np.linalg.inv(information)[-k:, -k:], square, log


@pytest.mark.parametrize("held", [None, (3,), (2, 5), "one"])
def test_a_fit_is_that_of_generalised_least_squares(held):
    rng = np.random.default_rng(1)
    records = [
        record(root(n, 5, 5) @ rng.standard_normal((n, 3)), session=name)
        for n, name in ((40, "a"), (64, "b"))
    ]
    model = StaticModel(records)
    effects = [Ramp(), BiasTemperature(2, 20.0)]
    patterns = model.patterns(effects)
    sights = {None: everything(model), "one": one_session(model, "b")}
    sight = sights.get(held) or without(model, held, 8)
    columns = sum((p.columns[1] for p in patterns), ())
    found = sight.fit(columns, 1)
    scale = np.concatenate([model.scale(p, 1) for p in patterns])
    parts, log = [], []
    for rec, fold in zip(records, folds(model, 8), strict=True):
        if held == "one" and rec.session == "a":
            continue
        rows = np.flatnonzero(~np.isin(fold, held if isinstance(held, tuple) else ()))
        own = np.concatenate(
            [e.design(rec.channels)[:, 1, [1, 4][: 1 + (i > 0)]] for i, e in enumerate(effects)],
            axis=1,
        )
        parts.append((rec, rows, own))
    for point in (0, 7, len(model.grid) - 1):
        theta, spread, square, value = plain(parts, model.grid[point], columns, 1)
        np.testing.assert_allclose(found.theta[point] / scale, theta, rtol=1e-5)
        assert found.square[point] == pytest.approx(square, rel=1e-6)
        expected = spread * square / found.dof
        np.testing.assert_allclose(
            found.covariance[point] / np.outer(scale, scale), expected, rtol=1e-5
        )
        log.append(found.log_weight[point] - model.prior[point] - value)
    # the likelihood up to one constant
    np.testing.assert_allclose(log, log[0], atol=1e-5)


def test_columns_that_are_not_independent_give_no_fit():
    model = StaticModel([record(np.random.default_rng(2).normal(size=(50, 3)))])
    one, two = model.patterns([Steps((600.0,), ("s",)), Steps((-5.0,), ("s",))])
    sight = everything(model)
    assert sight.fit(one.columns[0], 0)
    # a step before the record is a level, and a column twice is one
    assert sight.fit(two.columns[0], 0) is None
    assert sight.fit(one.columns[0] + one.columns[0], 0) is None


def test_estimates_and_their_errors_hold_in_slow_noise():
    rng, n, true = np.random.default_rng(4), 120, 0.4
    made, effect = root(n, 10, 20), BiasTemperature(1, 20.0)
    off = []
    for _ in range(40):
        rec = record(made @ rng.standard_normal((n, 3)))
        rec.values[:] += true * (rec.channels.temperature - 20)[:, None]
        one = search([rec], [effect])
        base = one.shapes[BiasTemperature]
        for axis in range(3):
            error = np.sqrt(covariance(one, base, axis)[0, 0])
            off.append((estimate(one, base, axis)[0] - true) / error)
    assert abs(np.mean(off)) < 0.3
    # 120 estimates in units of their standard error
    assert 0.75 < np.std(off) < 1.2
    assert np.mean(np.abs(off) < 3) > 0.97


def test_fitted_effects_have_their_names():
    rec = record(np.random.default_rng(6).normal(size=(100, 3)))
    rec.values[:] += rec.channels.t[:, None] * [1e-3, 2e-3, 3e-3]
    one = search([rec], [Ramp()])
    (found,) = fitted(one, one.shapes[Ramp])
    assert list(found.values) == ["dx", "dy", "dz"]
    for name, true in (("dx", 1e-3), ("dy", 2e-3), ("dz", 3e-3)):
        assert abs(found.values[name] - true) < 4 * found.std[name]
    assert fitted(one, ()) == ()


def test_long_records_are_fitted_on_fewer_windows():
    model = StaticModel([record(np.random.default_rng(7).normal(size=(900, 3)))])
    assert len(model.records[0].windows) == 900
    assert len(model.fitted[0].windows) <= FITTED


@pytest.mark.parametrize("n", [64, 900])
def test_a_fold_of_other_windows_is_what_its_windows_of_the_fit_cover(n):
    records = [record(np.random.default_rng(8).normal(size=(n, 3)), name) for name in "ab"]
    model = StaticModel(records)
    for number, (own, fold) in enumerate(zip(model.fitted, folds(model, 8), strict=True)):
        means = fold_of(records[number], model, 8)
        assert set(means) == set(range(8))
        for window, at in zip(own.windows, fold, strict=True):
            inside = records[number].windows[:, 0] >= window[0]
            inside &= records[number].windows[:, 1] <= window[1]
            assert inside.any() and np.all(means[inside] == at)
        # windows across the edges of blocks belong to none
        across = replace(records[number], windows=records[number].windows + 0.5 * LENGTH)
        assert np.sum(fold_of(across, model, 8) == -1) == 8
    # the start of each record is held out with another block of the other
    assert fold_of(records[0], model, 8)[0] == 0 and fold_of(records[1], model, 8)[0] == 4


def test_a_step_that_nobody_saw_goes_up_evenly():
    unknown = Steps((300.0,), ("s",), (240.0,))
    seen = np.array([[0.0, 60], [120, 180], [180, 240], [240, 300], [360, 420], [420, 480]])
    outer = unknown.in_session("s", seen)[:, 0, 0]
    assert list(outer[[0, 1, -1]]) == [0, 0, 1]
    inner = seen[(seen[:, 0] >= 180) & (seen[:, 1] <= 420)]
    # the mean over all times that the step may have
    times = np.linspace(180, 420, 4801)[:-1] + 0.025
    known = [Steps((t,), ("s",)).in_session("s", inner)[:, 0, 0] for t in times]
    found = unknown.in_session("s", inner)[:, 0, 0]
    np.testing.assert_allclose(found, np.mean(known, axis=0), atol=1e-3)


def test_patterns_of_windows_are_means_of_their_instants():
    at = np.array([[0.0, 10.0], [10.0, 20.0], [20.0, 30.0]])
    fine = np.column_stack([np.arange(30) + 0.5] * 2)
    for effect in (Steps((14.0,), ("s",)), Sinusoid(0.03, ("s",))):
        instants = np.linspace(0, 30, 30001)[:-1]
        dense = effect.in_session("s", np.column_stack([instants, instants]))
        means = dense.reshape(3, 10000, 3, -1).mean(axis=1)
        np.testing.assert_allclose(effect.in_session("s", at), means, atol=1e-3)
        assert not effect.in_session("other", fine).any()
        assert len(effect.parameters) == dense.shape[2]
