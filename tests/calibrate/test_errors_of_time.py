"""Intervals hold for whole logs, over lost samples and late stamps, and next to clipped samples."""

import numpy as np
import pytest

from calibrate.devices import calibrate_recording, known_noise, record_samples, scores
from imuloop.calibrate.recording import record
from imuloop.calibrate.sessions import read_recording
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME, read_metadata, read_samples
from imuloop.core.tables import write_table
from imuloop.diagnose.motion import knocks
from imuloop.diagnose.poses import too_few
from imuloop.ingest.ingest import ingest
from imuloop.model.state import NAMES
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from loggers import lose, stamp_late

TRUTH = example_truth()
NOISE = known_noise(TRUTH)
SEEDS = 3


def of_log(log):
    made = record_samples(log)
    return *calibrate_recording(made, NOISE, TRUTH.gravity), made


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


# without harm intervals are tested in test_joint_fit.py, too
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
        assert made.rotations.time_covariance.any() == (harm != "none")
        sensors = (
            scores(force, TRUTH.accelerometer, NAMES["accelerometer"]),
            scores(turn, TRUTH.gyroscope, NAMES["gyroscope"]),
        )
        found.append((np.concatenate(sensors), turn.reduced_chi2))
    each, chi2 = (np.array(part) for part in zip(*found, strict=True))
    # the mean score has a standard error of 1/sqrt(SEEDS)
    drift = each.mean(axis=0) * np.sqrt(SEEDS)
    assert np.all(np.abs(drift) < 3.3), drift
    # of 63 scores, some of which correlate within a device
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
    return *calibrate_recording(made, NOISE, TRUTH.gravity), made


# the upper end alone, or both
@pytest.mark.parametrize("low", [pytest.param(-np.inf, marks=pytest.mark.study), -1.0])
def test_turns_beyond_the_range_are_left_out_and_pull_nothing(low, tmp_path):
    log = simulate_session(TRUTH, "multi_position", 106)
    top = 0.75 * log[list(ANGULAR_RATE)].abs().max().max()
    log[list(ANGULAR_RATE)] = log[list(ANGULAR_RATE)].clip(low * top, top)
    _, turn, made = calibrated_from_file(log, tmp_path)
    assert 0 < made.lost.clipped < 0.5 * made.lost.rotations
    assert len(made.rotations) == made.lost.rotations - made.lost.clipped
    assert np.abs(scores(turn, TRUTH.gyroscope, NAMES["gyroscope"])).max() < 4
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
    assert np.abs(scores(force, TRUTH.accelerometer, NAMES["accelerometer"])).max() < 4
    assert np.abs(scores(turn, TRUTH.gyroscope, NAMES["gyroscope"])).max() < 4
    assert force.reduced_chi2 < 1.6


def test_of_rests_that_are_nearly_all_at_the_end_of_the_range_the_reason_says_so(tmp_path):
    log = simulate_session(TRUTH, "multi_position", 106)
    log[list(ACCELERATION)] = log[list(ACCELERATION)].clip(-6.0, 6.0)
    force, _, made = calibrated_from_file(log, tmp_path)
    assert made.lost.railed > len(made.poses)
    assert f"{made.lost.railed} rests at the end of the accelerometer's range" in force.not_testable
