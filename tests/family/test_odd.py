"""Devices that stand out: named where there are some, and hardly ever where none are."""

import numpy as np

from family.members import EVERY, Family
from imuloop.core.p_values import holm
from imuloop.family.family import SIGNIFICANCE, compare_devices
from imuloop.family.odd import AT_MOST, deviations
from seeds import least_count, seeds

KINDS = ("accelerometer.b", "gyroscope.K")


def odd_names(family):
    return {each["device"] for each in compare_devices(family.members())["odd"]}


@seeds(4, 40)
def test_odd_devices_are_named_and_others_are_not(seeds):
    hits, count, false = 0, 0, 0
    for seed in range(seeds):
        # a chip of another lot: three axes of one kind
        family = Family(seed, unlike=KINDS)
        found = odd_names(family)
        hits, count = hits + len(found & {*family.odd}), count + len(family.odd)
        false += bool(found - {*family.odd}) + bool(odd_names(Family(1000 + seed)))
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


def test_two_odd_devices_do_not_hide_each_other_or_themselves():
    rng = np.random.default_rng(0)
    y, std = rng.normal(size=30), np.full(30, 0.1)
    y[3], y[4] = 12.0, 12.5
    away, p = deviations(y, std**2)
    assert set(np.flatnonzero(holm(p) < SIGNIFICANCE)) == {3, 4}
    assert away[3] > 8
    # of fewer than ten devices none is left out beforehand
    assert int(AT_MOST * 9) == 0


def test_a_device_that_knows_little_of_itself_is_not_odd():
    rng = np.random.default_rng(4)
    y, std = rng.normal(size=30), np.full(30, 0.1)
    y[3], std[3] = 12.0, 10.0
    away, p = deviations(y, std**2)
    assert abs(away[3]) < 2 and holm(p).min() > SIGNIFICANCE


def test_what_is_the_same_in_all_devices_but_for_noise_has_no_odd_one():
    rng = np.random.default_rng(2)
    std = np.full(20, 1e-3)
    away, p = deviations(1e-3 * rng.normal(size=20), std**2)
    assert np.isfinite(away).all() and holm(p).min() > SIGNIFICANCE
