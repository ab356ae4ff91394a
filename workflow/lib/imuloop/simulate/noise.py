"""Noise of known coefficients: each process follows its definition, not its Allan curve."""

import numpy as np
from scipy.fft import irfft, next_fast_len


def white(n, dt, N, rng):
    """Return `n` samples of white noise, SI, (n,).

    `dt` = Δt is the time between two samples, s, and `N` the coefficient, SI/√Hz. N² is the
    two-sided density, and the band ends at half the sampling rate, so the standard deviation of a
    sample is N/√Δt. `rng` is a numpy Generator, the source of random numbers.
    """
    return N / np.sqrt(dt) * rng.standard_normal(n)


def quantisation(n, dt, Q, rng):
    """Return `n` samples of quantisation noise, SI, (n,).

    A sensor reads the integral of its input with white errors q of the standard deviation `Q`,
    SI·s. The noise is the error of the rate of this integral: ``x_k = (q_{k+1} - q_k)/Δt`` (IEEE
    Std 952-1997, C.1.2). `dt` = Δt is the time between two samples, s, and `rng` is a numpy
    Generator, the source of random numbers. The rounding of the logged value is another process and
    is not included here.
    """
    return np.diff(Q * rng.standard_normal(n + 1)) / dt


def flicker(n, dt, B, rng):
    """Return `n` samples of flicker noise, SI, (n,).

    `dt` is the time between two samples, s, and `B` the coefficient, the bias instability, SI. The
    two-sided density is ``S(f) = B²/(2π|f|)``, that is ``B²/(πf)`` one-sided, and the Allan
    variance is ``(2 ln 2/π) B²``. At each frequency f, in steps of Δf, the noise has an independent
    Gaussian cosine and sine of variance ``B²/(πf) Δf``. Their sum is periodic. So the noise is
    computed for twice the length and cut in half. Then the start of the result does not repeat at
    its end, and the lowest frequency has a period of twice its length. `rng` is a numpy Generator,
    the source of random numbers.

    References
    ----------
    Timmer & König, Astronomy & Astrophysics 300 (1995) 707; IEEE Std 952-1997, C.1.3.
    """
    m = next_fast_len(2 * n, real=True)
    df = 1 / (m * dt)
    f = df * np.arange(1, m // 2 + 1)
    std = B * np.sqrt(df / (np.pi * f))
    # a cosine of amplitude a has the coefficient a m/2 in a spectrum of m samples
    spectrum = np.zeros(m // 2 + 1, dtype=complex)
    spectrum[1:] = (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) * std * m / 2
    return irfft(spectrum, m)[:n]


def walk(n, dt, K, rng):
    """Return `n` samples of a random walk that starts near zero, SI, (n,).

    `dt` = Δt is the time between two samples, s, and `K` the coefficient, SI/√s: a step from sample
    to sample has the standard deviation K √Δt. `rng` is a numpy Generator, the source of random
    numbers.
    """
    return np.cumsum(K * np.sqrt(dt) * rng.standard_normal(n))


def ramp(n, dt, R):
    """Return `n` samples of a ramp ``R t`` that starts at zero, SI, (n,).

    `dt` is the time between two samples, s, and `R` is the slope, SI/s.
    """
    return R * dt * np.arange(n)


def steps(n, dt, size, times):
    """Return `n` samples of a bias with steps, jumps between two values, SI, (n,).

    It jumps from zero to `size`, SI, at the first of the `times`, s, back to zero at the second,
    and so on. `dt` is the time between two samples, s.
    """
    return size * (np.searchsorted(np.sort(times), dt * np.arange(n), side="right") % 2)


# random process of each coefficient of a `Noise`, by name
PROCESSES = {"N": white, "Q": quantisation, "B": flicker, "K": walk}


def axis_noise(n, dt, noise, axis, seed):
    """Return `n` samples of the noise of one axis, the sum of all its processes, SI, (n,).

    `dt` is the time between two samples, s. `noise` is the `Noise` of the sensor, and `axis` the
    number of the axis, 0, 1 or 2. Each process draws its random numbers from its own child of
    `seed`, a SeedSequence, so that a change of one process does not change another.
    """
    total = ramp(n, dt, noise.R[axis])
    for (name, process), child in zip(PROCESSES.items(), seed.spawn(4), strict=True):
        if value := getattr(noise, name)[axis]:
            total += process(n, dt, value, np.random.default_rng(child))
    for term in noise.steps:
        total += steps(n, dt, term.size[axis], term.times)
    return total
