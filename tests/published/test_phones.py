"""Noise of a phone from published coefficients: simulated, recovered within the intervals.

No measured recording: 8.5 h at rest of an iPhone 6 (InvenSense MP67B, 100 Hz) are simulated from
the published Q, N, B, K and R. Their unit of time is one sample; in SI they are Q dt, N sqrt(dt),
B, K/sqrt(dt), R/dt.
"""

from functools import cache

import numpy as np
import pytest

from imuloop.noise.settings import NoiseSettings
from imuloop.simulate.noise import axis_noise
from imuloop.simulate.truth import Noise
from noise.one_record import estimate_record

RATE = 100.0
DT = 1 / RATE
# Q, N, B, K, R, m/s^2 or rad/s, with samples for seconds
PUBLISHED = {
    "ax": (2.0366e-3, 8.7870e-3, 3.8420e-4, 1.4347e-6, 2.9201e-9),
    "ay": (0, 9.4675e-3, 6.3518e-4, 1.1727e-5, 2.0825e-8),
    "az": (0, 1.08523e-2, 7.0923e-4, 4.4226e-6, 8.6142e-9),
    "gx": (2.5916e-4, 7.2805e-4, 4.3849e-5, 5.0468e-7, 5.2632e-10),
    "gy": (0, 1.1113e-3, 4.1315e-5, 1.9715e-7, 4.1766e-10),
    "gz": (0, 6.8243e-4, 3.0527e-5, 1.7728e-7, 0),
}
TO_SI = np.array([DT, DT**0.5, 1, DT**-0.5, 1 / DT])
TRUTH = {axis: dict(zip("QNBKR", TO_SI * row, strict=True)) for axis, row in PUBLISHED.items()}
# widths of intervals that some minutes of record could not give, share of the value
NARROW = {"Q": 0.05, "N": 0.01, "B": 0.12}
# one of each sensor; the others by the study
QUICK = ("ax", "gy")


@cache
def estimated_noise(axis):
    """Return the noise that is estimated of an axis."""
    n = round(8.5 * 3600 * RATE)
    seed = np.random.SeedSequence(6).spawn(len(TRUTH))[list(TRUTH).index(axis)]
    noise = Noise(**{name: (value,) for name, value in TRUTH[axis].items()})
    return estimate_record(axis_noise(n, DT, noise, 0, seed), RATE, NoiseSettings()).noise


def holds(coefficient, truth):
    """Tell whether the interval of a coefficient, or its limit where not identifiable, holds."""
    if not coefficient.identifiable:
        return truth < coefficient.upper95
    low, high = coefficient.ci95
    return low <= truth <= high


# true values outside intervals of 95 % (a zero is missed only by a false find): of 9 at most 1 miss
# has a probability of 93 %, of 25 at most 3 one of 96.6 %; 44 and 23 % if intervals were of 80 %
@pytest.mark.parametrize(
    ("axes", "most"), [(QUICK, 1), pytest.param([*PUBLISHED], 3, marks=pytest.mark.study)]
)
def test_published_coefficients_lie_within_their_intervals(axes, most):
    missed = [
        f"{name} of {axis}: {truth:.4g} is not in {getattr(estimated_noise(axis), name)}"
        for axis in axes
        for name, truth in TRUTH[axis].items()
        if not holds(getattr(estimated_noise(axis), name), truth)
    ]
    assert len(missed) <= most, "\n".join(missed)


@pytest.mark.parametrize(
    "axis", [a if a in QUICK else pytest.param(a, marks=pytest.mark.study) for a in PUBLISHED]
)
def test_what_hours_determine_is_found_closely_and_nothing_else(axis):
    noise = estimated_noise(axis)
    assert not noise.gauss_markov and not noise.sinusoid
    for name, truth in TRUTH[axis].items():
        coefficient = getattr(noise, name)
        assert truth or not coefficient.identifiable
        if truth and name in NARROW:
            low, high = coefficient.ci95
            assert high - low < NARROW[name] * truth, name
