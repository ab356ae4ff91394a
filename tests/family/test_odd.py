"""Devices that stand out: named where there are some, and hardly ever where none are."""

import numpy as np
import pytest

from family.members import EVERY, Family
from imuloop.core.p_values import holm
from imuloop.family.family import SIGNIFICANCE, compare_devices
from imuloop.family.odd import deviations
from seeds import least_count, seeds

KINDS = ("accelerometer.b", "gyroscope.K")


def odd_names(family):
    return {device["device"] for device in compare_devices(family.members())["odd"]}


@seeds(4, 40)
def test_odd_devices_are_named_and_others_are_not(seeds):
    hits, count, false = 0, 0, 0
    for seed in range(seeds):
        # a chip of another lot: three axes of one kind
        family = Family(seed, unlike=KINDS)
        named = odd_names(family)
        hits, count = hits + len(named & {*family.odd}), count + len(family.odd)
        false += bool(named - {*family.odd}) + bool(odd_names(Family(1000 + seed)))
    assert hits >= 0.95 * count
    assert false <= least_count(2 * seeds, SIGNIFICANCE, 0.99)


@seeds(4, 40)
def test_one_parameter_alone_is_named_as_often_as_an_exact_test_can(seeds):
    # Student's t with 48 degrees of freedom needs 4.66 at 0.05 over 1950 tests: of deviations of
    # five spreads 70 to 75 % reach it, whose spread is measured from 50 devices
    hits = count = 0
    for seed in range(seeds):
        single = Family(seed, unlike=[EVERY[seed % 21]])
        hits, count = hits + len(odd_names(single) & {*single.odd}), count + 1
    assert hits >= least_count(count, 0.65, 0.01)


# values and standard errors of devices, which of them are changed, and which stand out
RNG = np.random.default_rng(0)
ODD = {
    "two do not hide each other": (RNG.normal(size=30), 0.1, {3: 12.0, 4: 12.5}, {}, {3, 4}),
    "one that knows little": (RNG.normal(size=30), 0.1, {3: 12.0}, {3: 10.0}, set()),
    "no spread but noise": (1e-3 * RNG.normal(size=20), 1e-3, {}, {}, set()),
}


@pytest.mark.parametrize("case", ODD)
def test_devices_that_stand_out(case):
    y, error, changed, less_sure, odd = ODD[case]
    std = np.full(len(y), error)
    y[[*changed]], std[[*less_sure]] = [*changed.values()], [*less_sure.values()]
    away, p = deviations(y, std**2)
    assert np.isfinite(away).all() and {*np.flatnonzero(holm(p) < SIGNIFICANCE)} == odd
