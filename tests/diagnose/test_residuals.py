"""Residuals and their floor."""

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.estimate.held_out import exceedance_probability, fold_fits, held_out_covariance
from imuloop.estimate.verdict import (
    NoiseComparison,
    above_floor,
    calibration_verdict,
    why_not_shown,
)
from imuloop.model.effect import find_effect


def test_the_variance_of_held_out_errors_is_that_of_simulated_ones():
    rng = np.random.default_rng(4)
    t = np.arange(40.0)
    # white noise, and slow noise with a common part much larger than its remainder
    covariance = np.eye(40) + 200 * np.exp(-np.abs(t[:, None] - t) / 80)
    design = np.column_stack([np.ones(40), rng.normal(size=40)])
    out = (t >= 12) & (t < 20)
    seen = ~out & (t != 20)
    row_folds = np.column_stack([np.where(out, 0, -1), np.where(t == 20, 0, -1)])
    spread = held_out_covariance(covariance, design, row_folds)[np.ix_(out, out)]
    drawn = np.linalg.cholesky(covariance) @ rng.normal(size=(40, 20000))
    normal = design[seen].T @ np.linalg.inv(covariance[np.ix_(seen, seen)])
    fitted = np.linalg.solve(normal @ design[seen], normal @ drawn[seen])
    errors = drawn[out] - design[out] @ fitted
    np.testing.assert_allclose(np.diag(spread), errors.var(axis=1), rtol=0.05)
    ((operator, inverses),) = fold_fits(np.eye(40), np.linalg.inv(covariance), design, row_folds)
    np.testing.assert_allclose((operator @ drawn)[out], errors)
    np.testing.assert_allclose(np.diag(inverses[0]), fitted.var(axis=1), rtol=0.05)
    squares = (errors**2).sum(axis=0)
    for tail in (0.5, 0.1, 0.01, 0.002):
        largest = np.quantile(squares, 1 - tail)
        assert exceedance_probability(largest, [spread]) == pytest.approx(tail, rel=0.3), tail


@pytest.mark.parametrize(
    ("in_sample", "heldout", "by_chance", "chosen", "above"),
    [
        (False, 0.9, 0.0, True, False),
        (True, 0.9, 0.5, True, False),  # patterns in a residual smaller than the noise
        (True, 1.1, 0.5, True, True),
        (False, 1.1, 0.0, True, False),  # within the error of the floor
        (False, 1.7, 0.0, True, True),  # a wrong effect, which fits the data that it saw
        (False, 1.7, 0.1, True, False),
        (False, 1.7, 0.005, True, True),
        (False, 1.7, 0.005, False, False),  # no effect that could be wrong
        (False, 1.7, 0.0, False, True),
    ],
)
def test_a_residual_is_above_its_floor_in_the_fit_or_held_out(
    in_sample, heldout, by_chance, chosen, above
):
    comparison = NoiseComparison(0.0 if in_sample else 0.5, by_chance, 0.5, 1.0)
    assert above_floor(comparison, 0.01, heldout, 1.0, chosen) == above


def test_data_that_show_an_effect_beyond_all_physics_alone_cannot_show_it():
    effect = find_effect("vibration_rectification")
    units = dict.fromkeys(("vx", "vy", "vz", "dx"), "1")
    why = why_not_shown(effect, {"vx": 6.0, "vy": 7.0, "vz": 8.0}, units)
    assert "from 6 1 on, and 0.002 is the most possible" in why
    assert why_not_shown(effect, {"vx": 6.0, "vy": 1e-3, "vz": 6.0}, units) is None
    assert why_not_shown(find_effect("bias_drift"), {"dx": 1e9}, units) is None


@pytest.mark.parametrize(
    ("verdicts", "static", "expected"),
    [
        ({"poses": "consistent"}, False, "consistent"),
        ({"poses": "consistent", "reference": "unexplained"}, False, "unexplained"),
        ({"poses": "unexplained", "static_record": "consistent"}, True, "unexplained"),
        ({"poses": "explained", "static_record": "unexplained"}, True, "unexplained"),
        ({"poses": "not_testable", "static_record": "consistent"}, True, "consistent"),
        # a rest of the poses' own log, and moves that added nothing, gave no parameter
        ({"poses": "consistent", "static_record": "unexplained"}, False, "consistent"),
        ({"poses": "consistent", "motion": "unexplained"}, False, "consistent"),
        ({"poses": "consistent", "motion": "partly_explained"}, False, "partly_explained"),
        ({"poses": "not_testable"}, False, "not_testable"),
    ],
)
def test_the_verdict_of_a_calibration_is_the_worst_of_what_it_is_from(verdicts, static, expected):
    """Protects what `apply` and exports say: a better record hides no unexplained one."""
    added = ("explained", "partly_explained")
    records = {k: {"verdict": v, "effects": [1] * (v in added)} for k, v in verdicts.items()}
    assert calibration_verdict(records, static) == expected
