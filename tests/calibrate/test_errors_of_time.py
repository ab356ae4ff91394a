"""Intervals hold, of whole logs, over lost samples and late stamps, beside what is clipped."""

import numpy as np
import pytest

from calibrate.devices import calibrated, known_noise, recorded, scores
from imuloop.calibrate import accelerometer, errors_of_time, gyroscope
from imuloop.calibrate.calibrate import read_recording
from imuloop.calibrate.recording import record
from imuloop.calibrate.undersampling import PARTS
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME, read_metadata, read_samples
from imuloop.core.tables import write_table
from imuloop.diagnose.records.motion import knocks
from imuloop.diagnose.records.pose_diagnosis import too_few
from imuloop.ingest.ingest import ingest
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from loggers import lose, stamp_late

TRUTH = example_truth()
NOISE = known_noise(TRUTH)
SEEDS = 3


def of_log(log):
    made = recorded(log)
    return *calibrated(made, NOISE, TRUTH.gravity), made


def in_order(log):
    """Return a log without stamps that go back, as the ingest stage leaves it."""
    return log[log[TIME] > log[TIME].cummax().shift(fill_value=-1)].reset_index(drop=True)


HARMS = {
    "none": lambda log, rng: log,
    "3 % lost, 2 to 5 in a row": lambda log, rng: lose(log, 0.03, rng, range(2, 6)),
    "1 % lost, stamps off by 2 ms": lambda log, rng: in_order(
        stamp_late(lose(log, 0.01, rng), 0.002, rng)
    ),
}


# without harm intervals are tested in test_sensor_pair.py, too
@pytest.mark.parametrize(
    "harm", [pytest.param(harm, marks=[pytest.mark.study] * (harm == "none")) for harm in HARMS]
)
def test_parameters_are_unbiased_and_intervals_cover_the_truth(harm):
    found = []
    for seed in range(100, 100 + SEEDS):
        log = simulate_session(TRUTH, "multi_position", seed)
        force, turn, made = of_log(HARMS[harm](log, np.random.default_rng(seed)))
        assert force.not_testable is None and turn.not_testable is None
        assert made.lost.rotations - made.lost.left_out == len(made.rotations) >= 37
        assert made.rotations.extra_covariance.any() == (harm != "none")
        sensors = (
            scores(force, TRUTH.accelerometer, accelerometer.NAMES),
            scores(turn, TRUTH.gyroscope, gyroscope.NAMES),
        )
        found.append((np.concatenate(sensors), turn.reduced_chi2))
    each, chi2 = (np.array(part) for part in zip(*found, strict=True))
    # the mean score has a standard error of 1/sqrt(SEEDS)
    drift = each.mean(axis=0) * np.sqrt(SEEDS)
    assert np.all(np.abs(drift) < 3.3), drift
    # of 63 scores, some of one device alike
    assert (np.abs(each) < 1.96).mean() >= 0.88
    assert np.mean(chi2) == pytest.approx(1, abs=0.25)


def test_turns_lost_to_gaps_are_counted_and_named():
    log = simulate_session(TRUTH, "multi_position", 4)
    segments, _ = segment_session(log, "multi_position", SegmentSettings())
    moves = segments[segments["kind"] == "motion"]
    middle = ((moves["start_s"] + moves["end_s"]) / 2).to_numpy()[3:]
    lost = (np.abs(log[TIME].to_numpy()[:, None] - middle) < 0.2).any(axis=1)
    left = log[~lost].reset_index(drop=True)
    longest = round(left[TIME].diff().max() * 100) - 1
    _, fitted, made = of_log(left)
    assert len(made.rotations) == 3 and fitted.method == "multi_position"
    assert too_few(made)["gyroscope"] == (
        "calibrated; too few turns to test for missing effects: 3 turns between poses, 6 needed; "
        f"{len(middle)} of {len(moves)} turns lost up to {longest} samples in a row and are left "
        "out"
    )


@pytest.mark.parametrize("n", [1, 3])
def test_the_error_of_a_gap_is_that_of_the_interpolation(n):
    # white noise: weights of the cubic through samples at -1, 0, n + 1, n + 2 and of those between
    h = n + 1
    at = np.array([-1, 0, h, h + 1])
    powers = np.vander(at, 4, increasing=True).T
    weights = np.linalg.solve(powers, h ** np.arange(1, 5) / np.arange(1, 5))
    whole = np.zeros(n + 4)
    for k in range(h):
        whole[k : k + 4] += np.array([-1, 13, 13, -1]) / 24
    whole[at + 1] -= weights
    w = np.random.default_rng(1).normal(size=(100_000, 3)) * 0.1
    lost = np.zeros(len(w) - 1, dtype=int)
    lost[::1000] = n
    covariance = errors_of_time.gap_covariance(w, lost, 0.01)
    assert covariance.shape == (100, 3, 3)
    variance = (0.1 * 0.01) ** 2 * (whole @ whole)
    np.testing.assert_allclose(covariance[0] / variance, np.eye(3), atol=0.03)
    # a cubic is interpolated as it is
    t = np.arange(500) / 100
    cubic = np.column_stack([t, t**2 - t, t**3])
    assert np.abs(errors_of_time.gap_covariance(cubic, lost[:499], 0.01)).max() < 1e-24
    # of a turn that is too broken nothing is known
    assert errors_of_time.gap_covariance(w[:200], np.tile([0, 0, 0, 2], 50)[:199], 0.01) is None


def test_stamps_at_which_the_sensor_was_sampled_add_nothing():
    rng = np.random.default_rng(5)
    t = np.arange(5000) / 100
    stamps = t + rng.normal(0, 0.002, len(t))
    for sampled_at, parts in ((stamps, 0), (t, PARTS)):
        w = 2 * np.sin(2 * sampled_at[:, None] + np.arange(3)) + rng.normal(0, 1e-3, (len(t), 3))
        where = np.array([1000]), np.array([1300]), np.zeros((1, 3)), np.full((1, 3), 1e-6)
        [(at, _)], _ = errors_of_time.errors_of_time(stamps, w, *where)
        assert len(at) == np.count_nonzero(np.diff(stamps[1000:1301]) > 0.015) + parts


def calibrated_from_file(log, folder):
    """Return the calibration of both sensors and the Recording of a log, by the stages' files."""
    paths = {"kind": "multi_position", "samples": folder / "s.parquet"}
    log.to_csv(folder / "log.csv", index=False)
    declared = {"device": "d", "session": "s", "kind": paths["kind"], "paths": [folder / "log.csv"]}
    ingest(**declared, samples_path=paths["samples"], quality_path=folder / "q.json")
    samples = read_samples(paths["samples"])
    paths["segments"] = folder / "g.parquet"
    rails = read_metadata(paths["samples"])["rails"]
    table = segment_session(samples, paths["kind"], SegmentSettings(), rails=rails)[0]
    write_table(paths["segments"], table)
    made = read_recording({"s": paths}, 30.0)
    return *calibrated(made, NOISE, TRUTH.gravity), made


# the upper end alone, or both
@pytest.mark.parametrize("low", [pytest.param(-np.inf, marks=pytest.mark.study), -1.0])
def test_turns_beyond_the_range_are_left_out_and_pull_nothing(low, tmp_path):
    log = simulate_session(TRUTH, "multi_position", 106)
    top = 0.75 * log[list(ANGULAR_RATE)].abs().max().max()
    log[list(ANGULAR_RATE)] = log[list(ANGULAR_RATE)].clip(low * top, top)
    _, turn, made = calibrated_from_file(log, tmp_path)
    assert 0 < made.lost.clipped < 0.5 * made.lost.rotations
    assert len(made.rotations) == made.lost.rotations - made.lost.clipped
    assert np.abs(scores(turn, TRUTH.gyroscope, gyroscope.NAMES)).max() < 4
    assert turn.reduced_chi2 < 1.6


# of the second, turns come to half of what gravity shows: no scale of the logger
@pytest.mark.parametrize("limit", [pytest.param(0.3, marks=pytest.mark.study), 0.5])
def test_of_turns_that_are_all_beyond_the_range_the_reason_says_so(limit, tmp_path):
    log = simulate_session(TRUTH, "multi_position", 106)
    log[list(ANGULAR_RATE)] = log[list(ANGULAR_RATE)].clip(-limit, limit)
    _, turn, made = calibrated_from_file(log, tmp_path)
    assert len(made.rotations) < 5
    assert "choose a wider range or turn more slowly" in too_few(made)["gyroscope"]
    # the rests still know the bias
    np.testing.assert_allclose(turn.b, TRUTH.gyroscope.b, atol=1e-4)


def test_a_move_in_which_the_accelerometer_is_at_the_end_of_its_range_is_none():
    log = simulate_session(TRUTH, "multi_position", 106)
    segments = segment_session(log, "multi_position", SegmentSettings())[0]
    whole = record([log], [segments], 30.0)
    assert np.isfinite(knocks(whole, np.zeros(3))).all()
    k = 3
    inside = (log[TIME] > whole.rotations.start_s[k]) & (log[TIME] < whole.rotations.end_s[k])
    log.loc[inside[inside].index[5:7], "ay"] = 30.0
    made = record([log], [segments], 30.0, [{"ay": (None, 30.0)}])
    # its turn counts as before
    assert len(made.rotations) == len(whole.rotations)
    beyond = np.isnan(knocks(made, np.zeros(3)))
    assert np.flatnonzero(beyond).tolist() == [k]


def test_rests_at_the_end_of_the_range_are_left_out_and_pull_nothing(tmp_path):
    log = simulate_session(TRUTH, "multi_position", 106)
    log[list(ACCELERATION)] = log[list(ACCELERATION)].clip(-9.0, 9.0)
    force, turn, made = calibrated_from_file(log, tmp_path)
    assert 2 < made.lost.railed < 0.5 * len(made.poses)
    assert np.abs(scores(force, TRUTH.accelerometer, accelerometer.NAMES)).max() < 4
    assert np.abs(scores(turn, TRUTH.gyroscope, gyroscope.NAMES)).max() < 4
    assert force.reduced_chi2 < 1.6


def test_of_rests_that_are_nearly_all_at_the_end_of_the_range_the_reason_says_so(tmp_path):
    log = simulate_session(TRUTH, "multi_position", 106)
    log[list(ACCELERATION)] = log[list(ACCELERATION)].clip(-6.0, 6.0)
    force, _, made = calibrated_from_file(log, tmp_path)
    assert made.lost.railed > len(made.poses)
    assert f"{made.lost.railed} rests at the end of the accelerometer's range" in force.not_testable
