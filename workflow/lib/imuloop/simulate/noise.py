"""Noise of known coefficients: each process follows its definition, not its Allan curve.

Each function makes `n` samples, `dt` s apart.
"""

import numpy as np
from scipy.fft import irfft, next_fast_len


def white(n, dt, N, rng):
    """Return n samples of white noise, (n,), SI, of the density `N`, SI/√Hz.

    The time between two samples is `dt` = Δt, s. N² is the two-sided density, and the band ends at
    half the sampling rate, so the standard deviation of a sample is N/√Δt.
    """
    return N / np.sqrt(dt) * rng.standard_normal(n)


def quantisation(n, dt, Q, rng):
    """Return quantisation noise, SI, (n,).

    It is the error of the rate of an integrated signal that is read with white errors q: ``x_k =
    (q_{k+1} - q_k)/Δt`` (IEEE Std 952-1997, C.1.2). The errors q have the standard deviation `Q`,
    SI·s, and the samples are `dt` = Δt apart, s. The rounding of the logged value itself is another
    process, which is not included.
    """
    return np.diff(Q * rng.standard_normal(n + 1)) / dt


def flicker(n, dt, B, rng):
    """Return n samples of flicker noise, (n,), SI, of bias instability `B`, SI.

    The time between two samples is `dt`, s. The two-sided density is ``S(f) = B²/(2π|f|)``, that is
    ``B²/(πf)`` one-sided, and the Allan variance is ``(2 ln 2/π) B²``. The noise is a sum of an
    independent Gaussian cosine and sine, of variance ``B²/(πf) Δf``, at each frequency f, in steps
    of Δf. The sum is periodic, so it is computed for twice the length and cut in half: start and
    end of the result are then not equal, and its lowest frequency is half that of its length.

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
    """Return a random walk that starts near zero, SI, (n,).

    Its steps have the standard deviation K √Δt. `K` is in SI/√s, and the samples are `dt` = Δt
    apart, s.
    """
    return np.cumsum(K * np.sqrt(dt) * rng.standard_normal(n))


def ramp(n, dt, R):
    """Return a ramp ``R t`` that starts at zero, SI, (n,).

    The time between two samples is `dt`, s, and `R` is in SI/s.
    """
    return R * dt * np.arange(n)


def steps(n, dt, size, times):
    """Return n samples of a bias that jumps at each of the times `times`, s, (n,), SI.

    The time between two samples is `dt`, s.

    The bias jumps from zero to `size`, SI, at the first time, back to zero at the second, and so
    on.
    """
    return size * (np.searchsorted(np.sort(times), dt * np.arange(n), side="right") % 2)


# process of each coefficient of a `Noise` that has a random stream
PROCESSES = {"N": white, "Q": quantisation, "B": flicker, "K": walk}


def axis_noise(n, dt, noise, axis, seed):
    """Return the sum of all processes of one axis, SI, (n,).

    There are `n` samples; the time between two of them is `dt`, s. `noise` is the `Noise` of a
    sensor, `axis` the number of the axis. Each process draws from its own child of the SeedSequence
    `seed`, so that one process does not change another.
    """
    total = ramp(n, dt, noise.R[axis])
    for (name, process), child in zip(PROCESSES.items(), seed.spawn(4), strict=True):
        if value := getattr(noise, name)[axis]:
            total += process(n, dt, value, np.random.default_rng(child))
    for term in noise.steps:
        total += steps(n, dt, term.size[axis], term.times)
    return total
