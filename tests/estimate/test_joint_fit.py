"""Both sensors in one fit: recovery, priors, fixed parameters, and a plain fit."""

from dataclasses import replace

import numpy as np

from calibrate.devices import (
    calibrate_recording,
    known_noise,
    record_samples,
    recording,
    scores,
    without_noise,
)
from imuloop.calibrate.recording import Log, pose_means
from imuloop.core.samples import CHANNELS
from imuloop.model.state import NAMES
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from seeds import seeds

TRUTH = example_truth()
NOISE = known_noise(TRUTH)
# for many devices
COARSE = example_truth(rate=50.0)


def test_without_noise_the_truth_comes_back():
    quiet = without_noise(TRUTH)
    for sensor, made in zip(
        ("accelerometer", "gyroscope"),
        calibrate_recording(recording(quiet, 0), known_noise(quiet), TRUTH.gravity),
        strict=True,
    ):
        # the remaining error comes from the integration between samples
        for name in "TKb":
            true = getattr(getattr(quiet, sensor), name)
            np.testing.assert_allclose(getattr(made, name), true, atol=1e-5)


def without_flicker(truth):
    """Return the device without flicker: with the same seed all other noise is the same."""
    quiet = {
        name: replace(sensor, noise=replace(sensor.noise, B=(0.0, 0.0, 0.0)))
        for name, sensor in (("accelerometer", truth.accelerometer), ("gyroscope", truth.gyroscope))
    }
    return replace(truth, **quiet)


@seeds(6, 40)
def test_intervals_cover_the_truth_and_the_mean_of_the_bias_over_the_rests(seeds):
    pulls = []
    for seed in range(seeds):
        log, bare = (
            simulate_session(truth, "multi_position", 500 + seed)
            for truth in (COARSE, without_flicker(COARSE))
        )
        made, channels = record_samples(log), list(CHANNELS)
        slow = Log.of(log.assign(**{c: log[c] - bare[c] for c in channels}))
        share = made.poses.duration_s / made.poses.duration_s.sum()
        bias = [share @ pose_means(made.poses, made.logs, [own]) for own in (slow.f, slow.w)]
        each = []
        for sensor, names, level, own in zip(
            ("accelerometer", "gyroscope"),
            NAMES.values(),
            bias,
            calibrate_recording(made, NOISE, COARSE.gravity),
            strict=True,
        ):
            true = getattr(COARSE, sensor)
            each.append(scores(own, replace(true, b=true.b + level), names))
        pulls.append(np.concatenate(each))
    pulls = np.array(pulls)
    # T, K and b of the accelerometer, then of the gyroscope
    for kind in np.split(np.arange(21), [3, 6, 9, 15, 18]):
        own = np.abs(pulls[:, kind]) < 1.96
        # four standard errors, as if parameters of a device were independent
        assert own.mean() > 0.95 - 4 * np.sqrt(0.95 * 0.05 / own.size), kind


def test_a_bias_that_is_held_stays_at_the_first_rest():
    made = recording(TRUTH, 2)
    force, turn = calibrate_recording(made, NOISE, TRUTH.gravity, gyroscope_bias="initial_rest")
    np.testing.assert_array_equal(turn.b, made.poses.w[0])
    # its error is the error of the mean of that rest
    expected = np.sqrt(made.poses.mean_covariance(NOISE)[3:, 0, 0])
    np.testing.assert_allclose([turn.std[f"b{k}"] for k in range(3)], expected)
    assert not turn.covariance[:9, 9:].any()
    assert force.method == turn.method == "multi_position"
