import numpy as np
import pytest

from imuloop.noise.statistics import consecutive_means, summary


def test_figures_of_a_known_sequence():
    figures = summary([np.array([1.0, 2, 3]), np.array([4.0, 5])], rate=0.1)
    assert figures["mean"] == 3 and figures["median"] == 3
    assert (figures["min"], figures["q25"], figures["q75"], figures["max"]) == (1, 2, 4, 5)
    assert figures["peak_to_peak"] == 4
    assert figures["std"] == pytest.approx(np.sqrt(2.5))
    assert figures["std_10s"] == pytest.approx(np.sqrt(2.5))  # one sample is 10 s long
    assert figures["std_100s"] is None


def test_means_do_not_cross_a_cut():
    found = consecutive_means([np.array([0.0, 2, 9]), np.array([4.0, 6, 1, 3, 7])], 2)
    assert list(found) == [1, 5, 2]


def test_white_noise_means_have_the_expected_scatter():
    rng = np.random.default_rng(0)
    figures = summary([rng.standard_normal(400_000)], rate=10.0)
    assert figures["std_10s"] == pytest.approx(0.1, rel=0.05)
    assert figures["std_100s"] == pytest.approx(0.1 / np.sqrt(10), rel=0.15)
