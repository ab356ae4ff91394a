"""Quantiles against those of scipy."""

import pytest
from scipy import stats

from imuloop.segment.quantiles import chi_squared, chi_squared_below, f_beyond, t_beyond


@pytest.mark.parametrize("k", [0.3, 1, 2.7, 3, 5, 6, 8, 41.2, 300, 5000.5])
@pytest.mark.parametrize("p", [1e-3, 0.05, 0.5, 0.975, 0.99])
def test_chi_squared(p, k):
    x = stats.chi2.ppf(p, k)
    assert chi_squared(p, k) == pytest.approx(x, rel=1e-11)
    assert chi_squared_below(x, k) == pytest.approx(p, rel=1e-11)


@pytest.mark.parametrize("m", [1, 2, 17, 54, 400, 20_000])
@pytest.mark.parametrize("p", [1e-10, 1e-7, 1e-3, 0.2, 0.7])
def test_beyond(p, m):
    for k in (1, 3, 6):
        x = f_beyond(p, k, m)
        assert stats.f.sf(x, k, m) == pytest.approx(p, rel=2e-10)
    if p < 0.5:
        assert stats.t.sf(t_beyond(p, m), m) == pytest.approx(p, rel=2e-10)
