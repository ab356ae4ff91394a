"""What the noise stage tells of a device of which it could tell everything."""

from dataclasses import asdict, replace

import numpy as np
import pandas as pd

from imuloop.core.noise_model import Coefficient, GaussMarkovTerm, SinusoidTerm
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.noise.spectrum import COLUMNS

KEYS = "mean std std_10s std_100s".split()
# axis, amplitude and frequency; axis, drive and correlation time
LINE, HUMP = ("az", 2e-3, 0.08), ("gx", 2e-5, 30.0)


def known(value):
    """Return a coefficient with an interval that is wider above."""
    return Coefficient(value, (0.9 * value, 1.2 * value), 1.15 * value, True)


def statistics():
    return {axis: dict.fromkeys(KEYS, 0.0123456) for axis in CHANNELS}


def plausible_noise(axes, rate):
    """Return what noise.json holds of a device with a line and a hump.

    `axes` are an `AxisNoise` each.
    """
    line = SinusoidTerm(*map(known, LINE[1:]), "50 Hz mains, alias of its 2nd harmonic")
    hump = GaussMarkovTerm(*map(known, HUMP[1:]))
    axes = axes | {LINE[0]: replace(axes[LINE[0]], sinusoid=(line,))}
    axes |= {HUMP[0]: replace(axes[HUMP[0]], gauss_markov=(hump,))}
    return {
        "axes": {a: asdict(noise) for a, noise in axes.items()},
        "notes": ["K would need a record of 40 h"],
        "rate_hz": rate,
        "rates_hz": dict.fromkeys(SENSORS, rate),
        "spectrum": {a: {"misfit": 0.02} for a in CHANNELS},
    }


def plausible_spectra(samples, rate):
    """Return spectra.parquet of a record, from its periodogram."""
    rows = []
    for axis in CHANNELS:
        x = samples[axis].to_numpy()
        power = np.abs(np.fft.rfft(x - x.mean())) ** 2 * 2 / (rate * len(x))
        for part in np.array_split(np.arange(1, len(power)), 60):
            share = 1.96 / np.sqrt(len(part))
            density, f = power[part].mean(), part.mean() * rate / len(x)
            rows.append((axis, f, density, density * (1 - share), density * (1 + share)))
    return pd.DataFrame(rows, columns=COLUMNS)
