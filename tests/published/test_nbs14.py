"""NBS14, the 1000-point set of NIST SP 1065, section 12.4, table 31 (p. 108)."""

import numpy as np
import pytest

from imuloop.noise.allan import allan_variance
from imuloop.noise.deviations import hadamard_variance, modified_variance, total_variance

FACTORS = np.array([1, 10, 100])
PRINTED = {
    "overlapping": [2.922319e-1, 9.159953e-2, 3.241343e-2],
    "hadamard": [2.943883e-1, 9.581083e-2, 3.237638e-2],
    "modified": [2.922319e-1, 6.172376e-2, 2.170921e-2],
    "total": [2.922319e-1, 9.134743e-2, 3.406530e-2],
    "plain": [2.922319e-1, 9.965736e-2, 3.897804e-2],
}


@pytest.fixture
def frequency():
    """n_{i+1} = 16807 n_i mod (2^31 - 1), n_0 = 1234567890, over 2^31 - 1."""
    n = [1234567890]
    for _ in range(999):
        n.append(16807 * n[-1] % 2147483647)
    return np.array(n) / 2147483647


def test_data_are_those_of_the_table(frequency):
    assert frequency.mean() == pytest.approx(4.897745e-1, abs=5e-8)
    assert frequency.std(ddof=1) == pytest.approx(2.884664e-1, abs=5e-8)


def test_overlapping_deviation_agrees_in_all_printed_digits(frequency):
    found = np.sqrt(allan_variance([frequency], FACTORS))
    assert found == pytest.approx(PRINTED["overlapping"], rel=0, abs=5e-8)


def test_plain_deviation_of_consecutive_means_is_another_figure(frequency):
    # the plain estimator is the overlapping one at m = 1 of the means
    found = [
        np.sqrt(allan_variance([frequency.reshape(-1, m).mean(axis=1)], [1])[0]) for m in FACTORS
    ]
    assert found == pytest.approx(PRINTED["plain"], rel=0, abs=5e-8)


@pytest.mark.parametrize(
    ("name", "variance"),
    [
        ("hadamard", hadamard_variance),
        ("modified", modified_variance),
        ("total", total_variance),
    ],
)
def test_other_deviations_agree_in_all_printed_digits(frequency, name, variance):
    found = np.sqrt(variance([frequency], FACTORS))
    assert found == pytest.approx(PRINTED[name], rel=0, abs=5e-8)
