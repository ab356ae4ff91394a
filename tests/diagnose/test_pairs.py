"""Two effects of like size, each of which hides the other."""

import numpy as np
import pytest
from scipy.stats import f

from diagnose.rows import Column, Other, Third, search
from imuloop.diagnose.choice import Choices

N = 40
T = np.linspace(0, 1, N)
NUISANCE = np.column_stack([np.ones(N), T])
COLUMNS = (np.sin(7 * T), np.cos(23 * T), T**2)
A, B, C = Column(), Other(), Third()


def best_pair(values, columns=COLUMNS, banned=(), threshold=1e-3):
    made = search(values, NUISANCE, dict(zip((A, B, C), columns, strict=True)), (), threshold)
    return made, made.best_pair((), banned)


def chi2(values, *columns):
    design = np.column_stack([NUISANCE, *columns])
    left = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    return left @ left


def test_both_are_found_and_tested_beside_each_other():
    rng = np.random.default_rng(0)
    values = 4 * COLUMNS[0] - 4 * COLUMNS[1] + rng.normal(size=N)
    made, pair = best_pair(values)
    assert pair.effects == (A, B)
    drop = chi2(values) - chi2(values, *COLUMNS[:2])
    scale = max(1, chi2(values, *COLUMNS[:2]) / (N - 4))
    expected = f.logsf(drop / 2 / scale, 2, N - 4) + np.log(3)
    assert pair.log_p == pytest.approx(expected)
    design = np.column_stack([NUISANCE, *COLUMNS[:2]])
    fitted = np.linalg.lstsq(design, values, rcond=None)[0][2:]
    found = [made.beside((other,), own)[0][0] for own, other in ((A, B), (B, A))]
    np.testing.assert_allclose(found, fitted, rtol=1e-9)
    assert best_pair(values, banned={(Column, Other)})[1] is None


def test_no_pair_where_one_of_the_two_adds_nothing():
    rng = np.random.default_rng(1)
    values = 6 * COLUMNS[0] + rng.normal(size=N)
    assert best_pair(values)[1] is None


@pytest.mark.parametrize(("step", "made"), [(0.1, False), (0.7, True)])
def test_twins_are_no_pair_for_what_tells_them_apart(step, made):
    twins = COLUMNS[0], COLUMNS[0] + step * COLUMNS[1], COLUMNS[2]
    rng = np.random.default_rng(3)
    values = 12 * COLUMNS[1] + rng.normal(size=N)
    assert (best_pair(values, twins)[1] is not None) == made


def test_noise_alone_makes_no_pair():
    rng = np.random.default_rng(2)
    found = [best_pair(rng.normal(size=N), threshold=0.05)[1] for _ in range(300)]
    assert sum(pair is not None for pair in found) <= 0.05 * 300


def test_the_best_is_a_pair_where_no_single_one_passes():
    # opposite ones of which neither alone has half of what is there
    rng, (u, v) = np.random.default_rng(4), np.linalg.qr(NUISANCE, mode="complete")[0].T[2:4]
    columns = u + 0.5 * v, -u + 0.5 * v, COLUMNS[2]
    values = 6 * v + rng.normal(size=N)
    made, pair = best_pair(values, columns)
    assert all(made.trial((), type(e)).log_p > made.threshold(0) for e in (A, B))
    assert made.best(()) == pair and pair.effects == (A, B)


def test_what_hides_from_the_gate_alone_is_tried_with_what_is_found_beside_it(monkeypatch):
    rng = np.random.default_rng(5)
    values = 9 * COLUMNS[0] - 6 * COLUMNS[1] + rng.normal(size=N)
    made = search(values, NUISANCE, dict(zip((A, B, C), COLUMNS, strict=True)), (), 1e-3)
    asked = []

    def gate(self, base, trial, wide, out):
        asked.append(wide)
        ratio = [0.5, 0.6] if {A, B} <= {*wide} else [0.9, 1.1]
        return "", np.zeros((0, 1)), np.zeros((0, 1)), ratio

    monkeypatch.setattr(Choices, "_gate", gate)
    found = Choices(made.problem).choice()
    assert asked[:3] == [(A,), (B,), (A, B)]
    assert {*found.base} == {A, B} and not found.failed
