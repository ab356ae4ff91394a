"""Gaps in the samples: where a step of time begins to be one, and what it lost."""

import numpy as np
import pytest

from imuloop.core.gaps import LONG_GAP_STEPS, gap_limit, lost_samples


def test_a_step_of_two_usual_ones_is_a_gap_of_one_sample():
    steps = 0.01 * np.array([1.0, 0.2, 1.49, 1.51, 2.0, 11.0])
    assert lost_samples(steps, 0.01).tolist() == [0, 0, 0, 1, 1, 10]
    assert ((steps > gap_limit(0.01)) == (lost_samples(steps, 0.01) > 0)).all()


def test_a_long_gap_is_of_nine_samples():
    assert gap_limit(0.01, LONG_GAP_STEPS) == pytest.approx(0.095)
    assert lost_samples(np.array([0.1]), 0.01) == 9
