"""Columns and rows that are not what they are taken for, and sound logs that look like them."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from ingest.logs import FORCE, RATE, brief, poses


def gravity(log, size=1.0, sign=1, digits=5):
    """A fusion filter's vector of gravity in place of the rate."""
    smooth = log[FORCE].rolling(20, min_periods=1).mean()
    unit = smooth.div(np.linalg.norm(smooth, axis=1), axis=0)
    return log.assign(
        **dict(zip(RATE, (sign * size * unit).round(digits).to_numpy().T, strict=True))
    )


def twice(log, units, other_first=False):
    """Each row twice, with one time stamp: values of the second row are in other units."""
    again = log.assign(**{name: log[name] * factor for name, factor in units.items()})
    parts = [again, log] if other_first else [log, again]
    return pd.concat(parts).sort_values("t", kind="stable", ignore_index=True)


G, DEGREES = dict.fromkeys(FORCE, 1 / STANDARD_GRAVITY), dict.fromkeys(RATE, 1 / DEGREE)


@pytest.mark.parametrize("how", [{}, {"size": STANDARD_GRAVITY}, {"sign": -1}, {"digits": 3}])
@pytest.mark.parametrize("log", [brief, poses])
def test_gravity_in_the_place_of_the_rate_is_named(run, log, how):
    found = run(gravity(log(), **how)).quality
    assert found["status"] == "rejected" and len(found["reasons"]) == 1
    assert "hold gravity: vectors of constant length along the acceleration" in found["reasons"][0]
    # nothing of cables, or of an end of the range
    assert found["warnings"] == []
    alone = run(gravity(log(), **how), columns={"angular_rate": None})
    assert alone.quality["status"] == "ok"


@pytest.mark.parametrize("rate", [1.1, 0.9, 5.0])
def test_a_steady_turn_about_the_vertical_is_no_gravity(run, log, rate):
    log.gz += rate
    assert run(log).quality["status"] == "ok"


@pytest.mark.parametrize("other_first", [False, True])
@pytest.mark.parametrize(
    ("units", "said"),
    [(G, "accelerometer in"), (DEGREES, "gyroscope in"), (G | DEGREES, " in ")],
)
def test_samples_in_two_units_are_named(run, log, units, said, other_first):
    log[RATE] += 0.1
    found = run(twice(log, units, other_first).round(6)).quality
    assert found["status"] == "rejected" and len(found["reasons"]) == 1
    assert "500 rows repeat the one before, with its time stamp, in another unit: " in str(found)
    assert said in found["reasons"][0]
    assert not any("declare its rate" in line for line in found["warnings"])


def test_packets_that_share_a_stamp_are_no_repeats(run):
    log = brief(2000)
    done = run(log.assign(t=log.t // 0.02 * 0.02))
    assert done.quality["status"] == "ok" and len(done.samples) == 2000
