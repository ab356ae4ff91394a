"""Measured logs: as many poses as their authors count, disturbances that are real.

That the poses give the published calibrations is tested in tests/published.
"""

import numpy as np
import pytest

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from segment.logs import adis16405, ferraris, mpu9150, rests_of, thermal_chamber, xsens

SETTINGS = SegmentSettings()
MEANS = [f"{channel}_mean" for channel in ACCELERATION]


@pytest.mark.parametrize("board", [0, 1, 2])
def test_mpu9150_has_its_poses_and_knows_those_in_the_hand(recordings, board):
    """Five of 22 rests tremble with 0.5 to 1 deg/s; other rests are turned at one end."""
    segments, metadata = segment_session(mpu9150(recordings, board), "multi_position", SETTINGS)
    # the logs' author counts 14 to 18 that lie still
    assert metadata["hand_held"] and metadata["poses"] == 22
    rests = rests_of(segments)
    in_hand = (rests["tilt_rad"] > 0).to_numpy()
    for start, end in ((0.5, 6.5), (9.0, 13.6), (19.1, 20.9), (44.7, 49.9), (57.4, 62.5)):
        assert in_hand[(rests["start_s"] < end) & (rests["end_s"] > start)].all(), (start, end)
    # 0.39 to 0.45 mrad/s with those rests; the scatter of a white floor would be 0.06
    w = rests[~in_hand].groupby("pose")[[f"{c}_mean" for c in ANGULAR_RATE]].mean()
    assert np.sqrt(np.mean((w - w.mean()).to_numpy() ** 2)) < 0.25e-3


def test_xsens_has_its_poses(recordings):
    _, metadata = segment_session(xsens(recordings), "multi_position", SETTINGS)
    assert metadata["poses"] == 38


def test_ferraris_faces_are_rests_and_full_turns_are_not(recordings):
    samples, sections = ferraris(recordings)
    static = rests_of(segment_session(samples, "six_position", SETTINGS)[0])
    poses = []
    for name, section in sections.items():
        start, end = section["start"] / 204.8, section["end"] / 204.8
        overlap = np.minimum(static["end_s"], end) - np.maximum(static["start_s"], start)
        if name.endswith("_rot"):
            assert overlap.max() < 0.25, name
            # rests before and after the turn, in one attitude, are two poses
            before = static[static["end_s"] <= start + 0.3]["pose"].iloc[-1]
            after = static[static["start_s"] >= end - 0.3]["pose"]
            assert after.empty or after.iloc[0] != before
        else:
            assert overlap.max() > 0.9 * (end - start), name
            poses.append(static["pose"].iloc[int(np.argmax(overlap))])
            face = static[MEANS].iloc[int(np.argmax(overlap))].to_numpy()
            axis = "xyz".index(name[0])
            assert np.argmax(np.abs(face)) == axis
            assert (face[axis] > 0) == name.endswith("_p")
    assert len(set(poses)) == 6


def test_thermal_ramp_stays_and_the_steps_of_the_sensor_go(recordings):
    """−17 to 74 °C: the gyroscope's x bias jumps by 2.3 mrad/s at 1019 s (−10 °C)."""
    samples = thermal_chamber(recordings)
    segments, metadata = segment_session(samples, "static", SETTINGS)
    static = rests_of(segments)
    assert (static["end_s"] - static["start_s"]).sum() > 0.95 * samples[TIME].iloc[-1]
    disturbed = segments[segments["kind"] == "disturbed"]
    assert np.any((disturbed["start_s"] < 1019.5) & (disturbed["end_s"] > 1019.5))
    assert not np.any(disturbed["start_s"] > 1600)
    assert metadata["slow_tilts"] == 0


def test_adis16405_record_of_a_million_samples_stays_almost_whole(recordings):
    segments, metadata = segment_session(adis16405(recordings), "static", SETTINGS)
    static = rests_of(segments)
    assert (static["end_s"] - static["start_s"]).sum() > 0.99 * 10_000
    assert metadata["slow_tilts"] == 0
    # shaken in its first seconds: over 12 standard deviations at samples 328 to 700
    first = segments[segments["kind"] == "disturbed"].iloc[0]
    assert first["start_s"] < 6.9 and first["end_s"] > 3.3
