"""A prior from the other devices: what it is worth to one of six poses, and what it never does."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import UNITS, calibrated, known_noise, planned, recording, true_parameters
from imuloop.calibrate.calibrate import calibrate_six_position
from imuloop.calibrate.poses import gather_poses
from imuloop.calibrate.raw_units import as_logged
from imuloop.calibrate.sensor_pair import BASES, parameters
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import FittedEffect
from imuloop.core.errors import ImuloopError
from imuloop.core.model import Calibration
from imuloop.effects.temperature import BiasTemperature
from imuloop.family import LEAST_OTHERS
from imuloop.family.prior import Prior, weighed, with_prior
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from seeds import seeds

SENSORS = tuple(BASES)
EXAMPLE = example_truth(rate=50.0)
NOISE = known_noise(EXAMPLE)
# spread of misalignment, scale factor error and both biases between devices
SPREAD = {"T": 0.004, "K": 0.006, "accelerometer": 0.1, "gyroscope": 0.01}
OFF_DIAGONAL = {"accelerometer": np.triu(np.ones((3, 3)), 1), "gyroscope": 1 - np.eye(3)}


def device(seed):
    """Return one of the devices of a type."""
    rng, sensors = np.random.default_rng(seed), {}
    for name in SENSORS:
        s = getattr(EXAMPLE, name)
        T = s.T + OFF_DIAGONAL[name] * rng.normal(0, SPREAD["T"], (3, 3))
        K, b = s.K + rng.normal(0, SPREAD["K"], 3), s.b + rng.normal(0, SPREAD[name], 3)
        sensors[name] = replace(s, T=T, K=K, b=b)
    return replace(EXAMPLE, **sensors)


def by_poses(truth, seed, poses):
    """Return a device's recording of some poses after a rest, and its calibration by them."""
    made = recording(planned(truth, poses=poses - 1, initial_rest_s=10.0), seed)
    return made, Calibration("d", truth.gravity, *calibrated(made, NOISE, truth.gravity))


def by_faces(truth, seed):
    """Return no recording, and the calibration by six faces."""
    samples = simulate_session(planned(truth, "six_position"), "six_position", seed)
    poses = gather_poses([segment_session(samples, "six_position", SegmentSettings())[0]])
    how = truth.gravity, tuple(UNITS.values()), CalibrateSettings()
    return None, Calibration("d", truth.gravity, *calibrate_six_position(poses, NOISE, *how))


def values(calibration):
    return np.concatenate([as_logged(getattr(calibration, s), BASES[s]) for s in SENSORS])


def errors(calibration):
    return np.concatenate([[getattr(calibration, s).std[n] for n in BASES[s]] for s in SENSORS])


def kinds():
    """Return where the parameters of each kind are, `accelerometer T` and so on."""
    owners = np.array([f"{sensor} {name[0]}" for sensor, name, _ in parameters()])
    return {kind: owners == kind for kind in dict.fromkeys(owners.tolist())}


@pytest.fixture(scope="module")
def others():
    """Return calibrations of eight other devices by 26 poses each."""
    return [by_poses(device(k), k, 26)[1] for k in range(100, 108)]


# of a device with six poses: its gyroscope's bias is that of its rests, which no prior betters
LACKING = ("accelerometer T", "accelerometer K", "accelerometer b", "gyroscope T", "gyroscope K")


@seeds(20, 100)
@pytest.mark.parametrize("data", ["poses", "faces"])
def test_a_device_that_was_held_out_is_better_with_the_prior(seeds, data):
    """Each device has the prior of all others, by 26 poses of theirs, and six poses of its own."""
    truths = [device(k) for k in range(seeds)]
    whole = [by_poses(truth, k, 26)[1] for k, truth in enumerate(truths)]
    before, after, scores = [], [], []
    for k, truth in enumerate(truths):
        own = by_poses(truth, 1000 + k, 6) if data == "poses" else by_faces(truth, 1000 + k)
        prior = Prior.of([c for i, c in enumerate(whole) if i != k])
        made = with_prior(own[1], prior, own[0], NOISE, CalibrateSettings())
        before.append(values(own[1]) - true_parameters(truth))
        after.append(values(made) - true_parameters(truth))
        scores.append(after[-1] / errors(made))
    before, after = (np.sqrt(np.mean(np.square(each), axis=0)) for each in (before, after))
    ratio = {
        kind: float(np.linalg.norm(after[at]) / np.linalg.norm(before[at]))
        for kind, at in kinds().items()
    }
    # six faces determine all of an accelerometer, if not as well
    assert data == "faces" or all(ratio[kind] <= 0.7 for kind in LACKING), ratio
    assert all(found <= 1.02 for found in ratio.values()), ratio
    share = np.mean(np.abs(scores) < 1.96)
    low, high = (0.91, 0.99) if seeds < 100 else (0.93, 0.97)
    assert low <= share <= high


def test_a_prior_is_as_wide_as_the_others_spread(others):
    prior, every = Prior.of(others), np.array([values(c) for c in others])
    # their own errors are small beside the spread
    wide = every.std(axis=0, ddof=1) * np.sqrt((1 + 1 / 8) * 7 / 5)
    np.testing.assert_allclose(prior.mean, every.mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(np.sqrt(prior.variance), wide, rtol=0.05)


def test_too_few_others_make_no_prior(others):
    own = by_poses(device(1), 1, 6)[1]
    prior = Prior.of(others[: LEAST_OTHERS - 1])
    assert np.isinf(prior.variance).all()
    with pytest.raises(ImuloopError, match="fewer than 4 other devices"):
        with_prior(own, prior)


def test_where_poses_are_enough_the_prior_hardly_counts(others):
    made, own = by_poses(device(2), 2, 26)
    found = with_prior(own, Prior.of(others), made, NOISE, CalibrateSettings())
    assert found.accelerometer.method == found.gyroscope.method == "multi_position"
    assert (np.abs(values(found) - values(own)) < 0.2 * errors(own)).all()
    assert (errors(found) <= errors(own)).all() and (errors(found) > 0.95 * errors(own)).all()


def test_information_adds_the_effects_included(others):
    own = by_poses(device(3), 3, 26)[1].gyroscope
    effect = BiasTemperature(reference_temperature=20.0)
    of_each = (dict.fromkeys(effect.parameters, value) for value in (1e-4, 2e-5))
    slope = FittedEffect(effect, *of_each)
    names = (*own.names, *(f"{slope.name}.{p}" for p in slope.values))
    # the bias and its slope have much in common
    covariance = np.zeros((len(names),) * 2)
    covariance[: len(own.names), : len(own.names)] = own.covariance
    covariance[range(-3, 0), range(-3, 0)] = 4e-10
    at = [names.index(n) for n in ("b0", "b1", "b2")]
    covariance[at, range(-3, 0)] = covariance[range(-3, 0), at] = (
        0.9 * 2e-5 * np.sqrt(np.diag(own.covariance)[-3:])
    )
    own = replace(own, names=names, covariance=covariance, effects=(slope,))
    mean, variance = as_logged(own, BASES["gyroscope"]) + 1e-3, np.full(12, 1e-8)
    found = weighed(own, "gyroscope", mean, variance)
    information = np.linalg.inv(covariance)
    information[:12, :12] += 1e8 * np.eye(12)
    x = np.append(as_logged(own, BASES["gyroscope"]), slope.vector)
    right = np.linalg.solve(covariance, x) + 1e8 * np.append(mean, np.zeros(3))
    expected = np.linalg.solve(information, right)
    made = np.append(as_logged(found, BASES["gyroscope"]), found.effects[0].vector)
    np.testing.assert_allclose(made, expected, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(information), rtol=1e-5, atol=1e-16)
    assert found.effects[0].std == pytest.approx(
        dict(zip(slope.values, np.sqrt(np.diag(found.covariance))[-3:], strict=True))
    )


def test_a_calibration_with_a_prior_is_written_and_read(others, tmp_path):
    made, own = by_poses(device(4), 4, 6)
    assert not own.accelerometer.measured
    found = with_prior(own, Prior.of(others), made, NOISE, CalibrateSettings())
    assert found.measured
    assert found.limits()[0] == (
        "accelerometer: family (6 poses found, at least 10 needed for 9 parameters and a check; "
        "completed by the other devices of its type)"
    )
    found.to_json(tmp_path / "family_calibration.json")
    again = Calibration.from_json(tmp_path / "family_calibration.json")
    np.testing.assert_allclose(values(again), values(found), rtol=1e-12)
    assert again.gyroscope.method == "family"
