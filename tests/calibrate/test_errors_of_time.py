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
    recording = record_samples(log)
    return *calibrate_recording(recording, NOISE, TRUTH.gravity), recording


def in_order(log):
    """Return a log without stamps that go back, as the ingest stage leaves it."""
    return log[log[TIME] > log[TIME].cummax().shift(fill_value=-1)].reset_index(drop=True)


HARMS = {
    "3 % lost, 2 to 5 in a row": lambda log, rng: lose(log, 0.03, rng, range(2, 6)),
    "1 % lost, stamps off by 2 ms": lambda log, rng: in_order(
        stamp_late(lose(log, 0.01, rng), 0.002, rng)
    ),
}


# without harm intervals are tested in tests/estimate/test_joint_fit.py
@pytest.mark.parametrize("harm", HARMS)
def test_parameters_are_unbiased_and_intervals_cover_the_truth(harm):
    results = []
    for seed in range(100, 100 + SEEDS):
        log = simulate_session(TRUTH, "multi_position", seed)
        force, turn, recording = of_log(HARMS[harm](log, np.random.default_rng(seed)))
        assert force.not_testable is None and turn.not_testable is None
        assert recording.lost.rotations - recording.lost.left_out == len(recording.rotations) >= 37
        assert recording.rotations.time_covariance.any()
        results.append((pulls(force, turn), turn.reduced_chi2))
    errors, chi2 = (np.array(part) for part in zip(*results, strict=True))
    # the mean score has a standard error of 1/sqrt(SEEDS)
    drift = errors.mean(axis=0) * np.sqrt(SEEDS)
    assert np.all(np.abs(drift) < 3.3), drift
    # of 63 scores, some of which correlate within a device
    assert (np.abs(errors) < 1.96).mean() >= 0.88
    assert np.mean(chi2) == pytest.approx(1, abs=0.25)


def pulls(force, turn):
    """Return the errors of T, K and b of both sensors, in their standard errors."""
    names = NAMES.values()
    calibrations = zip((force, turn), (TRUTH.accelerometer, TRUTH.gyroscope), names, strict=True)
    return np.concatenate([scores(*one) for one in calibrations])


def test_turns_lost_to_gaps_are_counted_and_named():
    log = simulate_session(TRUTH, "multi_position", 4)
    segments, _ = segment_session(log, "multi_position", SegmentSettings())
    moves = segments[segments["kind"] == "motion"]
    middle = ((moves["start_s"] + moves["end_s"]) / 2).to_numpy()[3:]
    lost = (np.abs(log[TIME].to_numpy()[:, None] - middle) < 0.2).any(axis=1)
    rest = log[~lost].reset_index(drop=True)
    longest = round(rest[TIME].diff().max() * 100) - 1
    _, fitted, recording = of_log(rest)
    assert len(recording.rotations) == 3 and fitted.method == "multi_position"
    assert too_few(recording)["gyroscope"] == (
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
    recording = read_recording({"s": paths}, 30.0)
    return *calibrate_recording(recording, NOISE, TRUTH.gravity), recording


# channels, the ends of their range as a share of the largest value, and what is said where nearly
# all is beyond; at 0.3 of the force each rest is at an end
CLIPPED = {
    "fastest turns": (ANGULAR_RATE, 0.75, -0.75, ""),
    "all turns": (ANGULAR_RATE, 0.15, -0.15, "choose a wider range or turn more slowly"),
    "some rests": (ACCELERATION, 9.0, -9.0, ""),
    "nearly all rests": (ACCELERATION, 6.0, -6.0, "rests at the end of the accelerometer's range"),
}


@pytest.mark.parametrize("clipped", CLIPPED)
def test_what_is_beyond_the_range_is_left_out_and_pulls_nothing(clipped, tmp_path):
    channels, high, low, why = CLIPPED[clipped]
    log = simulate_session(TRUTH, "multi_position", 106)
    size = log[list(channels)].abs().max().max() if channels == ANGULAR_RATE else 1.0
    log[list(channels)] = log[list(channels)].clip(low * size, high * size)
    force, turn, recording = calibrated_from_file(log, tmp_path)
    if why:
        assert why in (force.not_testable or too_few(recording)["gyroscope"])
        # the rests still know the bias
        if channels == ANGULAR_RATE:
            np.testing.assert_allclose(turn.b, TRUTH.gyroscope.b, atol=1e-4)
        return
    lost, total = (
        (recording.lost.clipped, recording.lost.rotations)
        if channels == ANGULAR_RATE
        else (recording.lost.railed, len(recording.poses))
    )
    assert 0 < lost < 0.5 * total
    assert np.abs(pulls(force, turn)).max() < 4
    assert max(force.reduced_chi2, turn.reduced_chi2) < 1.6


def test_a_move_in_which_the_accelerometer_is_at_the_end_of_its_range_is_none():
    log = simulate_session(TRUTH, "multi_position", 106)
    segments = segment_session(log, "multi_position", SegmentSettings())[0]
    whole = record([log], [segments], 30.0)
    assert np.isfinite(knocks(whole, np.zeros(3))).all()
    k = 3
    inside = (log[TIME] > whole.rotations.start_s[k]) & (log[TIME] < whole.rotations.end_s[k])
    log.loc[inside[inside].index[5:7], "ay"] = 30.0
    recording = record([log], [segments], 30.0, [{"ay": (None, 30.0)}])
    # its turn counts as before
    assert len(recording.rotations) == len(whole.rotations)
    beyond = np.isnan(knocks(recording, np.zeros(3)))
    assert np.flatnonzero(beyond).tolist() == [k]
