import numpy as np
import pytest
from scipy.signal import lfilter

from imuloop.noise.allan import allan_variance, averaging_factors
from imuloop.noise.curve_covariance import curve_covariance
from imuloop.noise.fit import design, fit_curve
from imuloop.noise.settings import NoiseSettings

SETTINGS = NoiseSettings()
SEEDS = 40


def simulate(length, rate, seed, Q=0.0, N=0.0, B=0.0, K=0.0, R=0.0):
    """A record of known coefficients; flicker as a sum of Gauss-Markov processes, 4 a decade."""
    rng = np.random.default_rng(seed)
    dt = 1 / rate
    x = N * np.sqrt(rate) * rng.standard_normal(length) + R * dt * np.arange(length)
    if Q:
        x += Q * rate * np.diff(rng.standard_normal(length + 1))
    if K:
        x += K * np.sqrt(dt) * np.cumsum(rng.standard_normal(length))
    if B:
        # equal variances at log-spaced times: density B^2/(pi f) between their ends
        times = np.geomspace(dt / 10, 30 * length * dt, int(4 * np.log10(300 * length)))
        std = B * np.sqrt(np.log(times[1] / times[0]) / np.pi)
        for rho in np.exp(-dt / times):
            drive = std * np.sqrt(1 - rho**2) * rng.standard_normal(length)
            drive[0] = std * rng.standard_normal()
            x += lfilter([1], [1, -rho], drive)
    return x


def fits(length, rate, seeds=SEEDS, **truth):
    factors = averaging_factors(length, SETTINGS)
    covariance = curve_covariance(factors, [length], rate)
    curves = [allan_variance([simulate(length, rate, s, **truth)], factors) for s in range(seeds)]
    return [fit_curve(factors / rate, curve, covariance, SETTINGS) for curve in curves]


def relative_rms(coefficients, truth):
    return np.sqrt(np.mean([(c.value / truth - 1) ** 2 for c in coefficients]))


def test_white_noise_gives_n_with_an_honest_interval_and_nothing_else():
    found = [fit.noise for fit in fits(20_000, 10.0, N=0.01)]
    assert relative_rms([f.N for f in found], 0.01) < 0.02
    assert sum(f.N.ci95[0] <= 0.01 <= f.N.ci95[1] for f in found) >= 34
    for name in "QBKR":
        assert sum(getattr(f, name).identifiable for f in found) <= 2, name


def test_what_is_not_supported_is_a_limit_and_no_number():
    noise = fits(20_000, 10.0, seeds=1, N=0.01)[0].noise
    assert noise.K.value is None and noise.K.ci95 is None and not noise.K.identifiable
    # where walk and white cross within the record: sqrt(3) N/K
    assert np.sqrt(3) * 0.01 / 2000 < noise.K.upper95 < 1e-3


def test_random_walk_is_found_with_its_interval():
    found = [fit.noise for fit in fits(20_000, 10.0, N=0.01, K=5e-4)]
    walks = [f.K for f in found if f.K.identifiable]
    assert len(walks) >= 38
    assert relative_rms(walks, 5e-4) < 0.25
    assert sum(k.ci95[0] <= 5e-4 <= k.ci95[1] for k in walks) >= 34
    assert sum(k.upper95 >= 5e-4 for k in walks) >= 34


def test_a_limit_holds_a_walk_that_is_too_weak_to_see():
    found = [fit.noise for fit in fits(4000, 10.0, N=0.01, K=1e-4)]
    assert sum(f.K.identifiable for f in found) <= 4
    assert sum(f.K.upper95 >= 1e-4 for f in found) >= 36


def test_flicker_is_found_with_its_interval():
    found = [fit.noise for fit in fits(20_000, 10.0, N=0.01, B=3e-3)]
    flicker = [f.B for f in found if f.B.identifiable]
    assert len(flicker) >= 38
    assert relative_rms(flicker, 3e-3) < 0.15
    assert sum(b.ci95[0] <= 3e-3 <= b.ci95[1] for b in flicker) >= 34


def test_all_five_terms_together():
    truth = {"Q": 0.02, "N": 0.01, "B": 8e-3, "K": 2e-3, "R": 2e-4}
    found = [fit.noise for fit in fits(100_000, 10.0, seeds=12, **truth)]
    for name, tolerance in {"Q": 0.05, "N": 0.15, "B": 0.3, "K": 0.3}.items():
        terms = [getattr(f, name) for f in found]
        assert sum(t.identifiable for t in terms) >= 10, name
        assert relative_rms([t for t in terms if t.identifiable], truth[name]) < tolerance, name
    assert np.mean([f.R.upper95 for f in found]) == pytest.approx(2e-4, rel=0.3)


@pytest.mark.parametrize("term", range(4))
def test_the_model_curve_itself_gives_the_model_back(term):
    factors = averaging_factors(20_000, SETTINGS)
    tau = factors / 10.0
    theta = np.eye(5)[term] * 4.0
    fit = fit_curve(tau, design(tau) @ theta, curve_covariance(factors, [20_000], 10.0), SETTINGS)
    assert fit.theta == pytest.approx(theta, abs=1e-9)
    assert fit.misfit == 0


def test_scaled_output_scales_every_coefficient():
    factors = averaging_factors(5000, SETTINGS)
    covariance = curve_covariance(factors, [5000], 10.0)
    curve = allan_variance([simulate(5000, 10.0, 1, N=0.01, K=1e-3)], factors)
    one = fit_curve(factors / 10, curve, covariance, SETTINGS).noise
    other = fit_curve(factors / 10, curve * 1e-8, covariance, SETTINGS).noise
    for name in "QNBKR":
        assert getattr(other, name).upper95 == pytest.approx(1e-4 * getattr(one, name).upper95)
    assert other.N.value == pytest.approx(1e-4 * one.N.value)


def test_a_filtered_sensor_shows_a_misfit_that_widens_the_intervals():
    x = simulate(50_000, 10.0, 2, N=0.01)
    filtered = lfilter([0.3], [1, -0.7], x)  # low-pass: unit gain, correlated over 3 samples
    factors = averaging_factors(50_000, SETTINGS)
    covariance = curve_covariance(factors, [50_000], 10.0)
    plain, smooth = (
        fit_curve(factors / 10, allan_variance([y], factors), covariance, SETTINGS)
        for y in (x, filtered)
    )
    assert plain.misfit == 0 and smooth.misfit > 0.05
    width = [np.diff(f.noise.N.ci95)[0] for f in (plain, smooth)]
    assert width[1] > 3 * width[0]
    assert smooth.noise.N.ci95[0] <= 0.01 <= smooth.noise.N.ci95[1]


@pytest.mark.parametrize("curve", [np.zeros(20), np.r_[np.ones(19), 0.0], np.ones(5)])
def test_a_curve_that_carries_no_fit_gives_no_term(curve):
    factors = np.arange(1, len(curve) + 1)
    fit = fit_curve(factors, curve, curve_covariance(factors, [100], 1.0), SETTINGS)
    assert not fit.theta.any() and not fit.noise.N.identifiable and fit.noise.N.upper95 is None


def test_a_ramp_without_noise_is_only_a_ramp():
    factors = averaging_factors(1000, SETTINGS)
    curve = allan_variance([1e-3 * np.arange(1000.0)], factors)
    noise = fit_curve(factors, curve, curve_covariance(factors, [1000], 1.0), SETTINGS).noise
    assert noise.R.value == pytest.approx(1e-3, rel=1e-6)
    assert not noise.K.identifiable
