"""How many seeds a statistical test runs: few by default, all under the marker ``study``."""

import pytest
from scipy.stats import binom


def seeds(few, many):
    """Parametrise a test by ``seeds``, their number, by which its tolerance is computed."""
    return pytest.mark.parametrize("seeds", [few, pytest.param(many, marks=pytest.mark.study)])


def least_count(number, share, chance):
    """Return the least count of `number` events of probability `share`, but for a `chance`."""
    return binom.ppf(chance, number, share)
