"""Fisher's combined p-value against scipy's."""

import numpy as np
import pytest
from scipy.stats import combine_pvalues

from imuloop.core.fisher import fisher


def test_combined_p_values_are_those_of_fisher():
    for p in ([0.3], [0.2, 1e-3], [0.9, 0.04, 1e-12]):
        assert fisher(np.log(p)) == pytest.approx(np.log(combine_pvalues(p).pvalue), rel=1e-9)
