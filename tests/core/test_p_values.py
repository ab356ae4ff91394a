"""P-values of several tests together."""

import numpy as np

from imuloop.core.p_values import holm


def test_holm_against_its_paper():
    # S. Holm 1979: the smallest times m, the next times m - 1, …, never falling, at most 1
    np.testing.assert_allclose(holm([0.03, 0.01, 0.04, 0.6]), [0.09, 0.04, 0.09, 0.6])
