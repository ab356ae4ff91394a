import numpy as np
import pytest

from imuloop.core.samples import ACCELERATION, CHANNELS
from imuloop.noise.statistics import repeatability, summary


def test_figures_of_a_known_sequence():
    x = [np.array([1.0, 2, 3]), np.array([4.0, 5])]
    figures = summary(x, rate=0.1)
    assert figures["mean"] == 3
    assert figures["std"] == pytest.approx(np.sqrt(2.5))
    assert figures["std_10s"] == pytest.approx(np.sqrt(2.5))  # one sample is 10 s long
    assert figures["std_100s"] is None
    assert [list(each) for each in x] == [[1, 2, 3], [4, 5]]


def rests(tilts, rates=(1e-3, 3e-3, 5e-3)):
    """Means of sessions tilted about x by these angles, degrees, with these rates about z."""
    return {
        str(i): {"ax": 0.0, "ay": 9.8 * np.sin(a), "az": 9.8 * np.cos(a)}
        | {"gx": 0.0, "gy": 0.0, "gz": rate}
        for i, (a, rate) in enumerate(zip(np.radians(tilts), rates, strict=False))
    }


def test_runs_in_one_attitude_give_all_axes():
    found = repeatability(rests([0.0, 0.3, 0.9]))
    assert list(found) == list(CHANNELS)
    assert found["gz"] == {"std": pytest.approx(2e-3), "sessions": 3}
    expected = 9.8 * np.std(np.sin(np.radians([0.0, 0.3, 0.9])), ddof=1)
    assert found["ay"] == {"std": pytest.approx(expected), "sessions": 3}


@pytest.mark.parametrize("tilts", [[0.0, 1.1], [0.0, 0.9, -0.9], [0.0, 180.0]])
def test_gravity_in_another_attitude_is_no_change_of_the_bias(tilts):
    found = repeatability(rests(tilts))
    assert all(found[axis] is None for axis in ACCELERATION)
    assert found["gz"]["sessions"] == len(tilts)


def test_one_run_has_no_repeatability_and_free_fall_no_attitude():
    assert repeatability(rests([0.0])) is None
    floating = dict.fromkeys(CHANNELS, 0.0)
    assert repeatability({"a": floating, "b": floating})["az"] is None
