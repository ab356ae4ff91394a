"""Power that a filter took at the top of the band is named, motion between rests is not it."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, lfilter

from calibrate.devices import planned
from imuloop.core.samples import CHANNELS
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from seeds import seeds


def filter_notes(log, kind):
    """Return what the noise of a log says of power that a filter took."""
    segments, _ = segment_session(log, kind, SegmentSettings())
    session = RecordedSession("log", kind, log, segments)
    found = estimate_noise("imu", [session], NoiseSettings(), views=False)
    return [note for note in found.notes if "power is lacking" in note]


@seeds(1, 3)
@pytest.mark.parametrize("rate", [10.0, 25.0, 40.0])
def test_short_rests_at_a_low_rate_are_not_filtered(rate, seeds):
    """Protects from motion between short rests passing for noise without its upper half."""
    truth = planned(example_truth(rate=rate), poses=12)
    for seed in range(30, 30 + seeds):
        log = simulate_session(truth, "multi_position", seed)
        log[[*CHANNELS]] = (log[[*CHANNELS]] * ([2048] * 3 + [1000] * 3)).round()
        log[[*CHANNELS]] /= [2048] * 3 + [1000] * 3
        assert not filter_notes(log.assign(t=np.arange(len(log)) / rate), "multi_position")


@pytest.mark.parametrize(("rate", "seconds"), [(20.0, 120), (400.0, 8)])
def test_a_filter_is_named_where_rests_carry_it(rate, seconds):
    n = round(rate * seconds)
    noise = lfilter(*butter(2, 0.3), np.random.default_rng(8).normal(size=(n, 6)), axis=0)
    values = noise * ([0.03] * 3 + [0.002] * 3) + [0.1, 0.2, 9.7, 0, 0, 0]
    log = pd.DataFrame(values, columns=CHANNELS).assign(t=np.arange(n) / rate)
    assert [note[:2] for note in filter_notes(log, "static")] == [*CHANNELS]
