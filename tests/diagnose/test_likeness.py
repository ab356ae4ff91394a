"""Effects that data cannot tell apart, before the data are seen and after."""

import numpy as np
import pytest

from diagnose.rows import Column, N, Other, T, Third, search
from imuloop.diagnose.likeness import imitated, twin

# what every fit has: a constant, far from the columns of the first tests
LAST = np.eye(N)[:, -1:]


def likeness(columns):
    return imitated(search(np.random.default_rng(0).normal(size=N), LAST, columns))


def test_the_share_that_another_imitates_is_the_squared_cosine():
    a, b = np.zeros((2, N))
    a[0], b[:2] = 1.0, [np.cos(0.3), np.sin(0.3)]
    assert likeness({Column(): a, Other(): b}) == [
        {"effect": "column", "with": "other", "share": pytest.approx(np.cos(0.3) ** 2)},
        {"effect": "other", "with": "column", "share": pytest.approx(np.cos(0.3) ** 2)},
    ]
    b[:2] = [np.cos(0.6), np.sin(0.6)]
    assert likeness({Column(): a, Other(): b}) == []


def test_what_the_base_model_takes_is_no_likeness():
    # alike but for a part that every fit takes up
    a, b = np.zeros((2, N))
    a[[0, -1]], b[[0, -1]] = [1.0, 3.0], [1.0, -3.0]
    shares = [found["share"] for found in likeness({Column(): a, Other(): b})]
    assert shares == pytest.approx([1.0, 1.0])


def test_the_middle_shape_counts_and_the_nearest_of_the_other():
    a = np.zeros((3, N))
    a[:, 0], a[1, 1], a[2, 2] = 1.0, np.tan(0.2), np.tan(0.7)
    columns = {Column(k): a[k] for k in range(3)} | {Other(): a[0]}
    found = {(f["effect"], f["with"]): f["share"] for f in likeness(columns)}
    assert found == {
        ("column", "other"): pytest.approx(np.cos(0.2) ** 2),
        ("other", "column"): pytest.approx(1),
    }


def test_a_parameter_that_the_data_do_not_show_is_left_out():
    a, dead = np.eye(N)[:, :1], np.zeros((N, 1))
    found = likeness({Column(): np.hstack([a, dead]), Other(): a, Third(): dead})
    named = {(f["effect"], f["with"]) for f in found}
    assert named == {("column", "other"), ("other", "column")}


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


def test_of_two_patterns_that_are_one_the_first_of_the_library_is_named():
    rng = np.random.default_rng(0)
    pattern, *others = rng.normal(size=(3, N))
    columns = {Column(0): pattern, Column(1): others[0], Column(2): others[1], Other(): 2 * pattern}
    made = search(2 * pattern + rng.normal(size=N), np.ones((N, 1)), columns)
    assert made.trial((), Other).log_p < made.trial((), Column).log_p
    assert made.best(()).effect == Column(0)
    # what has more parameters does more than the best
    wide = {Column(0): np.column_stack([pattern, others[0]]), Other(): pattern}
    assert (
        search(2 * pattern + rng.normal(size=N), np.ones((N, 1)), wide).best(()).effect == Other()
    )
