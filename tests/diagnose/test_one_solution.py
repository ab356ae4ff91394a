"""What a reference says of a sensor joins what other records say as one fit would."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imuloop.diagnose.records.one_solution import OfRecords, symmetric

SEED = 12180


def test_both_together_are_one_fit():
    rng = np.random.default_rng(SEED)
    rows, values = rng.normal(size=(30, 7)), rng.normal(size=30)
    # the reference sees three sums of the seven, and one parameter of its own
    gain, of_reference = rng.normal(size=(3, 7)), rng.normal(size=(12, 4))
    more = rng.normal(size=12)
    covariance = np.linalg.inv(rows.T @ rows)
    x = covariance @ rows.T @ values
    records = OfRecords((), x, covariance, gain @ x, gain)
    known, z = records.rows()
    # by the reference, which takes what the records say of the three
    own = np.concatenate([of_reference, np.pad(known, ((0, 0), (0, 1)))])
    joint = np.linalg.lstsq(own, np.append(more, z), rcond=None)[0]
    found, spread = records.joined(joint, np.linalg.inv(own.T @ own))
    # all rows at once
    wide = of_reference[:, :3] @ gain
    whole = np.block([[rows, np.zeros((30, 1))], [wide, of_reference[:, 3:]]])
    expected = np.linalg.lstsq(whole, np.append(values, more), rcond=None)[0]
    np.testing.assert_allclose(found, expected, atol=1e-10)
    np.testing.assert_allclose(spread, np.linalg.inv(whole.T @ whole), atol=1e-10)


@pytest.mark.parametrize("size", [0.01, 0.1])
def test_axes_are_symmetric_but_for_a_rotation(size):
    rng = np.random.default_rng(SEED)
    x = np.append(rng.normal(0, size, 6), rng.normal(1, size, 3))
    T = np.eye(3)
    T[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]] = x[:6]
    *off, k0, k1, k2 = symmetric(x)
    S = np.eye(3)
    S[[0, 0, 1], [1, 2, 2]] = S[[1, 2, 2], [0, 0, 1]] = off
    turn = T * x[6:] @ np.linalg.inv(S * [k0, k1, k2])
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert Rotation.from_matrix(turn).magnitude() < 4 * size
