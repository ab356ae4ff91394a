"""Xsens MTi with samples removed: the gyroscope comes out as with the whole recording."""

import numpy as np

from calibrate.devices import calibrate_recording, difference, record_samples
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import read_samples
from loggers import lose

GRAVITY = 9.81744


def gyroscope(samples, noise):
    made = record_samples(samples)
    return calibrate_recording(made, noise, GRAVITY)[1], len(made.rotations)


def test_one_per_cent_lost_leaves_the_gyroscope_as_it_is(measured_results):
    samples = read_samples(measured_results.session("xsens_mti", "poses")["samples"])
    noise = NoiseModel.from_json(measured_results.of("xsens_mti") / "noise.json")
    whole, count = gyroscope(samples, noise)
    lost, left = gyroscope(lose(samples, 0.01, np.random.default_rng(21), [2, 3, 4, 5]), noise)
    assert left == count
    moved = difference(lost, whole, whole.names) / [*whole.std.values()]
    assert np.all(np.abs(moved) < 1)
    # fewer samples cannot tell more, and tell little less
    assert np.all([0.9 < lost.std[n] / whole.std[n] < 2 for n in whole.names])
