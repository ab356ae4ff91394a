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
    for sensor, calibration in zip(
        ("accelerometer", "gyroscope"),
        calibrate_recording(recording(quiet, 0), known_noise(quiet), TRUTH.gravity),
        strict=True,
    ):
        # the remaining error comes from the integration between samples
        for name in "TKb":
            true = getattr(getattr(quiet, sensor), name)
            np.testing.assert_allclose(getattr(calibration, name), true, atol=1e-5)


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
        log_recording, channels = record_samples(log), list(CHANNELS)
        slow = Log.of(log.assign(**{c: log[c] - bare[c] for c in channels}))
        share = log_recording.poses.duration_s / log_recording.poses.duration_s.sum()
        bias = [
            share @ pose_means(log_recording.poses, log_recording.logs, [part])
            for part in (slow.f, slow.w)
        ]
        scored = []
        for sensor, names, level, part in zip(
            ("accelerometer", "gyroscope"),
            NAMES.values(),
            bias,
            calibrate_recording(log_recording, NOISE, COARSE.gravity),
            strict=True,
        ):
            true = getattr(COARSE, sensor)
            scored.append(scores(part, replace(true, b=true.b + level), names))
        pulls.append(np.concatenate(scored))
    pulls = np.array(pulls)
    # T, K and b of the accelerometer, then of the gyroscope
    for kind in np.split(np.arange(21), [3, 6, 9, 15, 18]):
        part = np.abs(pulls[:, kind]) < 1.96
        # four standard errors, as if parameters of a device were independent
        assert part.mean() > 0.95 - 4 * np.sqrt(0.95 * 0.05 / part.size), kind


def test_a_bias_that_is_held_stays_at_the_first_rest():
    log = recording(TRUTH, 2)
    force, turn = calibrate_recording(log, NOISE, TRUTH.gravity, gyroscope_bias="initial_rest")
    np.testing.assert_array_equal(turn.b, log.poses.w[0])
    # its error is the error of the mean of that rest
    expected = np.sqrt(log.poses.mean_covariance(NOISE)[3:, 0, 0])
    np.testing.assert_allclose([turn.std[f"b{k}"] for k in range(3)], expected)
    assert not turn.covariance[:9, 9:].any()
    assert force.method == turn.method == "multi_position"
