"""Effects that data cannot tell apart, before the data are seen and after."""

import numpy as np
import pytest

from diagnose.rows import Column, N, Other, T, search
from imuloop.estimate.likeness import imitations, twin

# what every fit has: a constant, far from the columns of the first tests
LAST = np.eye(N)[:, -1:]


def likeness(columns):
    made = search(np.random.default_rng(0).normal(size=N), LAST, columns)
    return imitations(made, [*made.problem.variants])


def test_the_share_that_another_imitates_is_the_squared_cosine():
    a, b = np.zeros((2, N))
    # the columns differ in a part that every fit absorbs
    a[0], a[-1], b[:2] = 1.0, 3.0, [np.cos(0.3), np.sin(0.3)]
    share = pytest.approx(np.cos(0.3) ** 2)
    assert likeness({Column(): a, Other(): b}) == [
        {"effect": "column", "with": "other", "share": share},
        {"effect": "other", "with": "column", "share": share},
    ]
    b[:2] = [np.cos(0.6), np.sin(0.6)]
    assert likeness({Column(): a, Other(): b}) == []


def test_a_plane_imitates_a_line_in_it_and_the_line_not_the_plane():
    line, plane = np.zeros((N, 1)), np.zeros((N, 2))
    line[:2, 0], plane[0, 0], plane[1, 1] = 1.0, 5.0, 1e-6
    (found,) = likeness({Column(): line, Other(): plane})
    assert (found["effect"], found["with"]) == ("column", "other")
    assert found["share"] == pytest.approx(1)


@pytest.mark.parametrize(("curve", "could"), [(T**1.1, True), (np.sin(9 * T), False)])
def test_a_candidate_stands_in_for_an_effect_of_nearly_its_shape(curve, could):
    rng = np.random.default_rng(0)
    # a slope of some twenty standard errors that was added to a constant
    values = 10 * T + rng.normal(size=N)
    slope = Column()
    made = search(values, np.ones((N, 1)), {slope: T, Other(): curve}, threshold=0.005)
    assert twin(made, (slope,), Other) == ("column" if could else None)
