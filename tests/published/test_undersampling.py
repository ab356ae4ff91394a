"""Measured logs at half their rate: what their turns lose is foreseen, in all and turn by turn."""

import numpy as np
import pytest

from bench import array
from bench.undersampling import halved
from imuloop import chain
from imuloop.calibrate.calibrate import read_recording
from imuloop.calibrate.settings import CalibrateSettings


def held_to(recording, ratio):
    foreseen, found = halved(recording)
    assert np.sqrt(np.mean(foreseen) / np.mean(found)) == pytest.approx(ratio, rel=0.1)
    assert np.corrcoef(foreseen, found)[0, 1] > 0.2


@pytest.mark.parametrize("board", [1, 2, 3])
def test_chips_with_a_filter_lose_less_than_samples_at_instants_would(measured, board):
    recording, *_ = measured.fit_of(f"mpu9150_{board}")
    assert 5e-4 < np.sqrt(recording.rotations.aliased.mean()) < 1.1e-3
    held_to(recording, 1.45)


@pytest.mark.parametrize("name", array.RECORDINGS)
def test_the_array_loses_what_is_foreseen(recordings, monkeypatch, tmp_path, name):
    monkeypatch.setenv("IMULOOP_MIRROR", str(recordings(f"{name}.parquet").parent))
    device = array.ingested(name, 1, tmp_path)
    assert chain.segment(device) == []
    recording = read_recording(device.sessions, CalibrateSettings().longest_rotation)
    assert 3e-3 < np.sqrt(recording.rotations.aliased.mean()) < 4e-3
    held_to(recording, 0.95)


def test_an_xsens_follows_its_turns(measured):
    assert measured.fit_of("xsens_mti")[0].rotations.aliased is None
