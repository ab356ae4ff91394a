"""The windows in which sensor and reference are compared: none reaches beyond its log."""

import numpy as np
import pytest

from beside import NOMINAL
from imuloop.calibrate.reference_windows import Places, ReferenceLog, Turns


@pytest.mark.parametrize("rate", [28.5, 33.3, 100.0, 285.7])
def test_windows_end_within_the_log_whatever_its_rate_and_length(rate):
    for count in range(round(3 * rate), round(3 * rate) + 40):
        attitude, still = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        log = np.arange(count) / rate, still, still, attitude, still, np.eye(3), (1, 1)
        for kind in (Turns, Places):
            windows = kind([ReferenceLog(*log)], 9.81, NOMINAL)
            assert len(windows.session) > 0 and windows.last.max() < count
