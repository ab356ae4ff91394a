"""Measured logs at half their rate: what their turns lose is foreseen, in all and turn by turn."""

import numpy as np
import pytest

from imuloop import chain
from imuloop.calibrate.sessions import read_recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.calibrate.undersampling import aliased_turns
from imuloop.core.rotation import exponential, matrix, prefix_product, step_vectors
from published import array_chips as array
from published.conftest import BOARDS


def turn_of_samples(rates, seconds):
    """Return the matrix of the turn that samples of an angular rate, rad/s, make."""
    steps = step_vectors(rates, np.full(len(rates) - 1, seconds))
    return matrix(prefix_product(exponential(steps))[-1])


def halve_rate(recording):
    """Return foreseen and measured errors of one axis, mean square of each turn, rad².

    Every second sample, from the first and from the second on, is a log of half the rate; the whole
    log shows the error of its turns, minus the noise of the samples left out.
    """
    rotations, poses = recording.rotations, recording.poses
    rest = poses.w[rotations.first], poses.variance[rotations.first, 3:]
    t, w = np.asarray(recording.logs[0].t), recording.logs[0].w
    usual = np.median(np.diff(t))
    first, last = np.searchsorted(t, rotations.start_s), np.searchsorted(t, rotations.end_s)
    foreseen, measured = [], []
    for phase in (0, 1):
        begin, end = (first + 1 - phase) // 2, (last - phase) // 2
        foreseen.append(aliased_turns(t[phase::2], w[phase::2], begin, end, *rest)[0])
        for i, j, bias in zip(2 * begin + phase, 2 * end + phase, rest[0], strict=True):
            whole = turn_of_samples(w[i : j + 1] - bias, usual)
            lack = turn_of_samples(w[i : j + 1 : 2] - bias, 2 * usual) @ whole.T
            measured.append(np.sum((lack - lack.T) ** 2) / 24)
    noise = (last - first) * usual**2 * rest[1].mean(axis=1)
    return np.mean(foreseen, axis=0), np.mean(np.reshape(measured, (2, -1)), axis=0) - noise


def held_to(recording, ratio):
    foreseen, measured = halve_rate(recording)
    assert np.sqrt(np.mean(foreseen) / np.mean(measured)) == pytest.approx(ratio, rel=0.1)
    assert np.corrcoef(foreseen, measured)[0, 1] > 0.2


@pytest.mark.parametrize("board", BOARDS)
def test_chips_with_a_filter_lose_less_than_samples_at_instants_would(measured_results, board):
    recording, *_ = measured_results.fit_of(f"mpu9150_{board}")
    assert 5e-4 < np.sqrt(recording.rotations.aliased.mean()) < 1.1e-3
    # of the 21 turns of each board, those between rests in the hand too
    held_to(recording, {1: 1.47, 2: 1.25, 3: 1.64}[board])


def test_the_array_loses_what_is_foreseen(recordings, monkeypatch, tmp_path):
    name = array.RECORDINGS[0]
    monkeypatch.setenv("IMULOOP_MIRROR", str(recordings(f"{name}.parquet").parent))
    device = array.ingest_chip(name, 1, tmp_path)
    chain.segment(device)
    recording = read_recording(device.sessions, CalibrateSettings().longest_rotation)
    assert 3e-3 < np.sqrt(recording.rotations.aliased.mean()) < 4e-3
    held_to(recording, 0.95)


def test_an_xsens_follows_its_turns(measured_results):
    assert not measured_results.fit_of("xsens_mti")[0].rotations.aliased.any()
