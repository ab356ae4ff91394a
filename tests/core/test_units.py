"""Counts and gravity against values that anyone can look up; tests/ingest has the other units."""

import numpy as np
import pytest

from imuloop.core.units import RawUnit
from imuloop.local_gravity import normal_gravity


def test_counts_go_through_the_nominal_scale_and_back_exactly():
    unit = RawUnit("count", 1 / 415, 32768)
    counts = np.arange(0, 65536)
    np.testing.assert_array_equal(np.rint(unit.from_si(unit.to_si(counts))), counts)
    assert unit.to_si(32768 + 415) == pytest.approx(1.0)


@pytest.mark.parametrize(
    # NIMA TR8350.2, table 3.4: normal gravity at the equator and at the poles
    ("latitude", "gravity"),
    [(0, 9.7803253359), (90, 9.8321849378), (-90, 9.8321849378)],
)
def test_normal_gravity_at_the_ends_of_the_ellipsoid(latitude, gravity):
    assert normal_gravity(latitude, 0) == pytest.approx(gravity, abs=1e-9)


def test_gravity_falls_by_the_free_air_gradient():
    fall = normal_gravity(45, 0) - normal_gravity(45, 100)
    assert fall == pytest.approx(0.3086e-5 * 100, rel=2e-3)
