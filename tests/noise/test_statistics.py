import numpy as np
import pytest

from imuloop.noise.noise import summary


def test_figures_of_a_known_sequence():
    x = [np.array([1.0, 2, 3]), np.array([4.0, 5])]
    figures = summary(x, rate=0.1)
    assert figures["mean"] == 3
    assert figures["std"] == pytest.approx(np.sqrt(2.5))
    assert figures["std_10s"] == pytest.approx(np.sqrt(2.5))  # one sample is 10 s long
    assert figures["std_100s"] is None
    assert [list(part) for part in x] == [[1, 2, 3], [4, 5]]
