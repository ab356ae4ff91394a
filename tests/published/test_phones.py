"""Noise of a phone from published coefficients: simulated, recovered within the intervals.

No measured recording: 8.5 h at rest of an iPhone 6 (InvenSense MP67B, 100 Hz) are simulated from
the published Q, N, B, K and R. Their unit of time is one sample, for the published N of two hours
at rest is the standard deviation of those samples; in SI they are Q dt, N sqrt(dt), B, K/sqrt(dt),
R/dt.
"""

import numpy as np
import pytest

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.noise.axis import estimate_record
from imuloop.noise.settings import NoiseSettings
from imuloop.simulate.noise import axis_noise
from imuloop.simulate.truth import Noise

RATE = 100.0
DT = 1 / RATE
# two hours: standard deviation and N, m/s^2 or rad/s; 8.5 h: Q, N, B, K, R with samples for seconds
PUBLISHED = {
    "ax": (0.008939, 0.0090073, (2.0366e-3, 8.7870e-3, 3.8420e-4, 1.4347e-6, 2.9201e-9)),
    "ay": (0.009675, 0.0097803, (0, 9.4675e-3, 6.3518e-4, 1.1727e-5, 2.0825e-8)),
    "az": (0.009832, 0.0099993, (0, 1.08523e-2, 7.0923e-4, 4.4226e-6, 8.6142e-9)),
    "gx": (0.000730, 7.4477e-4, (2.5916e-4, 7.2805e-4, 4.3849e-5, 5.0468e-7, 5.2632e-10)),
    "gy": (0.000733, 7.7488e-4, (0, 1.1113e-3, 4.1315e-5, 1.9715e-7, 4.1766e-10)),
    "gz": (0.000625, 6.5634e-4, (0, 6.8243e-4, 3.0527e-5, 1.7728e-7, 0)),
}
TO_SI = np.array([DT, DT**0.5, 1, DT**-0.5, 1 / DT])
TRUTH = {axis: dict(zip("QNBKR", TO_SI * row[2], strict=True)) for axis, row in PUBLISHED.items()}
# 25 true values beside intervals of 95 % (a zero is missed only by a false find): at most 3 misses
# have a probability of 96.6 %; 23 % if the intervals were of 80 %
MOST_MISSES = 3
# widths of intervals that some minutes of record could not give, share of the value
NARROW = {"Q": 0.05, "N": 0.01, "B": 0.12}


@pytest.mark.parametrize("axis", PUBLISHED)
def test_the_unit_of_time_is_a_sample(axis):
    std, two_hours, (Q, N, B, K, R) = PUBLISHED[axis]
    # with seconds for samples N would be a tenth of it
    assert two_hours == pytest.approx(std, rel=0.06)
    # the longer record agrees within 11 %, but for the gyroscope's y axis, half as much again
    assert N == pytest.approx(std, rel=0.52 if axis == "gy" else 0.11)
    # the Allan deviation of the publication, over m samples, is that of the SI coefficients
    m = np.geomspace(1, 1e6, 13)
    variance = 3 * Q**2 / m**2 + N**2 / m + 2 * np.log(2) / np.pi * B**2
    variance += K**2 * m / 3 + R**2 * m**2 / 2
    si = AxisNoise(*(Coefficient(value) for value in TRUTH[axis].values()))
    np.testing.assert_allclose(si.allan_variance(m * DT), variance, rtol=1e-12)


@pytest.fixture(scope="module")
def found():
    """Return the estimated AxisNoise of each simulated axis."""
    n = round(8.5 * 3600 * RATE)
    seeds = np.random.SeedSequence(6).spawn(len(TRUTH))
    estimates = {}
    for seed, (axis, truth) in zip(seeds, TRUTH.items(), strict=True):
        noise = Noise(**{name: (value,) for name, value in truth.items()})
        record = axis_noise(n, DT, noise, 0, seed)
        estimates[axis] = estimate_record(record, RATE, NoiseSettings()).noise
    return estimates


def holds(coefficient, truth):
    """Tell whether the interval of a coefficient, or its limit where not identifiable, holds."""
    if not coefficient.identifiable:
        return truth < coefficient.upper95
    low, high = coefficient.ci95
    return low <= truth <= high


def test_published_coefficients_lie_within_their_intervals(found):
    missed = [
        f"{name} of {axis}: {truth:.4g} is not in {getattr(found[axis], name)}"
        for axis, values in TRUTH.items()
        for name, truth in values.items()
        if not holds(getattr(found[axis], name), truth)
    ]
    assert len(missed) <= MOST_MISSES, "\n".join(missed)


@pytest.mark.parametrize("axis", PUBLISHED)
def test_what_hours_determine_is_found_closely_and_nothing_else(found, axis):
    noise = found[axis]
    assert not noise.gauss_markov and not noise.sinusoid
    for name, truth in TRUTH[axis].items():
        coefficient = getattr(noise, name)
        assert truth or not coefficient.identifiable
        if truth and name in NARROW:
            low, high = coefficient.ci95
            assert high - low < NARROW[name] * truth, name
