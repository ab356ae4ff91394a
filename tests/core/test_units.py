"""Units against values that anyone can look up."""

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.gravity import normal_gravity
from imuloop.core.units import RawUnit, raw_unit


@pytest.mark.parametrize(
    ("quantity", "name", "raw", "si"),
    [
        ("acceleration", "g", 1.0, 9.80665),
        ("acceleration", "mg", 1000.0, 9.80665),
        ("acceleration", "m/s^2", 2.0, 2.0),
        ("angular_rate", "deg/s", 180.0, np.pi),
        ("angular_rate", "deg/h", 360 * 3600.0, 2 * np.pi),
        ("angular_rate", "mrad/s", 1000.0, 1.0),
        ("angular_rate", "rad/s", -1.0, -1.0),
    ],
)
def test_units_are_those_of_the_field(quantity, name, raw, si):
    unit = raw_unit(quantity, name)
    assert unit.to_si(raw) == pytest.approx(si, rel=1e-12)
    assert unit.from_si(si) == pytest.approx(raw, rel=1e-12)


def test_counts_go_through_the_nominal_scale_and_back_exactly():
    unit = RawUnit("count", 1 / 415, 32768)
    counts = np.arange(0, 65536)
    np.testing.assert_array_equal(np.rint(unit.from_si(unit.to_si(counts))), counts)
    assert unit.to_si(32768 + 415) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "nominal", "message"),
    [("count", None, "needs nominal"), ("furlong", None, "is not a unit of acceleration")],
)
def test_a_unit_that_cannot_be_is_said_so(name, nominal, message):
    with pytest.raises(ImuloopError, match=message):
        raw_unit("acceleration", name, nominal)


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
