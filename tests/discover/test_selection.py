"""Which candidates are selected in noise that is known: no more than there is, and the simplest."""

from dataclasses import replace

import numpy as np
import pytest

from imuloop.calibrate.noise_components import Component
from imuloop.discover.discovery import AGREED, FLOOR, Discovery, lead_over_changes
from imuloop.discover.selection import (
    ALIKE,
    LEVEL,
    MARGIN,
    ROWS,
    SIMPLER,
    Rows,
    Selection,
    likeliest_reference,
    select,
    whitened,
)
from imuloop.discover.space import Space


def rows(values, columns):
    n = len(values)
    parts = (Component(np.diag(np.full(n, 1e-6))),)
    own = Rows(values, np.ones((n, 1)), np.eye(n), parts, np.arange(n), n)
    terms = tuple(f"x: fx^{k % 9 + 1}" for k in range(columns.shape[1]))
    singles = tuple((k,) for k in range(columns.shape[1]))
    return own, Space("accelerometer", 25.0, terms, columns, singles)


def test_two_columns_are_a_structure_without_a_name():
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(60, 40))
    noise = rng.normal(size=60)
    one = select(*rows(noise + 2 * columns[:, 3], columns), level=0.01, draws=300, seed=0)
    assert one.candidates == (3,) and one.single
    two = noise + 2 * columns[:, 3] + 2 * columns[:, 7]
    both = select(*rows(two, columns), level=0.01, draws=300, seed=0)
    assert set(both.candidates) == {3, 7} and not both.single


def test_twins_are_imitators_and_likenesses_leave_no_name():
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(60, 40))
    columns[:, 5] = columns[:, 4] + 0.1 * rng.normal(size=60)
    values = rng.normal(size=60) + 2 * columns[:, 4]
    twins = select(*rows(values, columns), level=0.01, draws=300, seed=0)
    assert twins.single and {4, 5} == {twins.candidates[0], *twins.imitators}
    # half of it imitated is no twin, and no less than it in these data
    columns[:, 5] = columns[:, 4] + 0.6 * rng.normal(size=60)
    values = rng.normal(size=60) + 0.8 * columns[:, 4] + 0.3 * (columns[:, 5] - columns[:, 4])
    assert not select(*rows(values, columns), level=0.01, draws=300, seed=0).single


def test_of_near_equals_fewest_columns_are_chosen():
    rng = np.random.default_rng(4)
    columns, values = rng.normal(size=(60, 12)), rng.normal(size=60)
    values += 2 * columns[:, 3]
    # what makes the pair as good as the one by Schwarz' criterion
    columns[:, 4] = rng.normal(size=60) + 0.22 * (values - 2 * columns[:, 3])
    own, space = rows(values, columns)
    space = replace(space, candidates=(*space.candidates, (3, 4)))
    scores = whitened(own, columns, space.candidates, ()).scores()
    assert 0 < scores[12] - scores[3] < ALIKE
    assert select(own, space, level=0.01, draws=300, seed=0).candidates[0] == 3


def test_of_near_equals_the_shortest_time_constant_is_chosen():
    rng = np.random.default_rng(7)
    rest = np.tile([0.0, 2.0, 4.0, 6.0, 8.0, 10.0], 10)
    terms = ("z: s8", "z: s5", "z: s3")
    columns = np.exp(-rest[:, None] / [8.0, 5.0, 3.0])
    own = rows(2 * columns[:, 0] + rng.normal(size=60), columns)[0]
    space = Space("accelerometer", 25.0, terms, columns, ((0,), (1,), (2,)))
    scores = whitened(own, columns, space.candidates, ()).scores()
    best = select(own, space, level=0.01, draws=300, seed=0).candidates[0]
    assert best and scores.max() - scores[best] < SIMPLER
    assert all(scores.max() - score > SIMPLER for score in scores[best + 1 :])


def test_a_form_that_all_rows_are_enough_for_is_one_of_a_part_too():
    rng, width = np.random.default_rng(8), 7
    count = ROWS * width + 1
    values, columns = rng.normal(size=count), rng.normal(size=(count, width))
    own = rows(values, columns)[0]
    form, part = (tuple(range(width)),), np.arange(count - 3)
    assert whitened(own.subset(part), columns[part], form, ()).columns == form
    less = replace(own.subset(part), count=len(part))
    assert whitened(less, columns[part], form, ()).columns == ((),)


def test_a_column_leads_where_its_size_keeps_its_sign():
    rng = np.random.default_rng(9)
    columns = rng.normal(size=(60, 40))
    noise, sign = rng.normal(size=60), np.sign(np.arange(60) - 29.5)
    lead = [
        lead_over_changes(*rows(noise + 2 * columns[:, 3] * size, columns), (3,))
        for size in (1, sign)
    ]
    assert lead[0] > 2 * MARGIN and lead[1] < 0


@pytest.mark.parametrize(
    "lacking",
    [
        {"lead": MARGIN / 2},
        {"constant": LEVEL / 2},
        {"noise_chance": FLOOR / 2},
        {"agreed": AGREED - 0.1},
        {"kinds": {"gravity_norm": {"ratio_ci95": (0.4, 1.1)}}},
    ],
    ids=lambda lacking: next(iter(lacking)),
)
def test_no_name_is_given_where_one_confirmation_is_lacking(lacking):
    space = rows(np.zeros(60), np.zeros((60, 4)))[1]
    selection = Selection(0.0, (3,), (3,), margin=2 * MARGIN, gain=100 * MARGIN)
    kinds = {"gravity_norm": {"ratio_ci95": (0.4, 0.6)}}
    found = Discovery(space, selection, kinds, agreed=1.0)
    assert found.effect.formula == "x: fx^4"
    assert replace(found, **lacking).effect is None


@pytest.mark.parametrize("power", [1, 2])
def test_the_reference_temperature_is_fitted(power):
    """Of ``c f (T - T0)^p`` in white noise, the columns' T0 another."""
    rng, found = np.random.default_rng(5), []
    f, warm = rng.normal(size=80), np.linspace(-8, 8, 80)
    terms = ("x: fx", "x: fx*T", "x: fx*T^2")
    columns = f[:, None] * warm[:, None] ** np.arange(3)
    space = Space("gyroscope", 25.0, terms, columns, ((0,), (1,), (2,)))
    for _ in range(100):
        values = 0.5 * f * (warm - 1.3) ** power + rng.normal(size=80)
        own = rows(values, columns)[0]
        found.append(likeliest_reference(own, space, (power,)))
    # as far off as its error, σ/√Σ(∂/∂T0)², says
    change = 0.5 * f * power * (warm - 1.3) ** (power - 1)
    assert np.mean(found) == pytest.approx(1.3, abs=4 * np.std(found) / 10)
    assert np.std(found) == pytest.approx(1 / np.linalg.norm(change), rel=0.3)
    # where a scale factor takes it up nothing says what it is
    known = replace(own, jacobian=np.column_stack([np.ones(80), f]))
    assert power == 2 or likeliest_reference(known, space, (1,)) == 0.0


def test_nothing_is_found_in_noise_more_often_than_its_level():
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(40, 60))
    found = [
        select(*rows(rng.normal(size=40), columns), level=0.05, draws=100, seed=k).candidates
        for k in range(60)
    ]
    # 3 expected; 9 or more by chance once in 500
    assert sum(map(bool, found)) < 9
