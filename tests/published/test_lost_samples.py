"""Xsens MTi with samples taken out: the gyroscope is that of the whole recording."""

import numpy as np

from imuloop.calibrate.calibrate import calibrate_accelerometer, calibrate_gyroscope
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import read_samples
from imuloop.core.units import RawUnit
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.logger import lose

GRAVITY = 9.81744
UNITS = RawUnit("m/s^2", 1.0), RawUnit("rad/s", 1.0)


def gyroscope(samples, noise):
    segments, _ = segment_session(samples, "multi_position", SegmentSettings())
    made, settings = record([samples], [segments], 30.0), CalibrateSettings()
    force = calibrate_accelerometer(made.poses, noise, GRAVITY, UNITS[0], settings)
    return calibrate_gyroscope(made, noise, force, UNITS[1], settings), len(made.rotations)


def test_one_per_cent_lost_leaves_the_gyroscope_as_it_is(measured):
    samples = read_samples(measured.session("xsens_mti", "poses")["samples"])
    noise = NoiseModel.from_json(measured.of("xsens_mti") / "noise.json")
    whole, count = gyroscope(samples, noise)
    lost, left = gyroscope(lose(samples, 0.01, np.random.default_rng(21), [2, 3, 4, 5]), noise)
    assert left == count
    names = whole.names
    difference = [
        getattr(lost, n[0])[tuple(map(int, n[1:]))] - getattr(whole, n[0])[tuple(map(int, n[1:]))]
        for n in names
    ]
    assert np.all(np.abs(difference) < [whole.std[n] for n in names])
    # fewer samples cannot tell more, and tell little less
    assert np.all([0.9 < lost.std[n] / whole.std[n] < 2 for n in names])
