"""What the noise stage tells of a device of which it could tell everything."""

import copy

import numpy as np
import pandas as pd

from imuloop.core.samples import CHANNELS

KEYS = "mean std min q25 median q75 max peak_to_peak std_10s std_100s".split()
# the coefficient that a disturbance changes most, and how
DISTURBED = ("gy", "K", 3.0e-5)
LINE = {"axis": "az", "amplitude": 2e-3, "frequency": 0.08}
HUMP = {"axis": "gx", "q": 2e-5, "tc": 30.0}


def known(value):
    """Return a coefficient with an interval that is wider above."""
    interval = [0.9 * value, 1.2 * value]
    return {"value": value, "ci95": interval, "upper95": 1.15 * value, "identifiable": True}


def statistics():
    """Return summary figures of six axes."""
    return {axis: dict.fromkeys(KEYS, 0.0123456) for axis in CHANNELS}


def plausible_noise(device, session, rate, axes):
    """Return noise.json of a device with a line, a hump and a disturbance that was cut."""
    axes = copy.deepcopy(axes)
    for content in axes.values():
        for key in "QKR":
            content[key]["needed_s"] = 40 * 3600.0
    line = {"amplitude": known(LINE["amplitude"]), "frequency": known(LINE["frequency"])}
    axes[LINE["axis"]]["sinusoid"] = [{**line, "origin": "50 Hz mains, alias of its 2nd harmonic"}]
    axes[HUMP["axis"]]["gauss_markov"] = [{"q": known(HUMP["q"]), "tc": known(HUMP["tc"])}]
    uncut = copy.deepcopy(axes)
    axis, key, value = DISTURBED
    uncut[axis][key] = known(value)
    fit = {a: {k: content[k]["value"] or 0.0 for k in "QNBKR"} for a, content in axes.items()}
    fit["ay"]["N"] *= 1.3
    return {
        "format": 1,
        "device": device,
        "axes": axes,
        "statistics": {session: statistics()},
        "sessions": [session],
        "notes": ["K would need a record of 40 h"],
        "rate_hz": rate,
        "curve_fit": fit,
        "spectrum": {a: {"misfit": 0.02, "band_hz": 0.25 * rate} for a in CHANNELS},
        "uncut": {"seconds": 6.0, "axes": uncut},
        "repeatability": {
            a: {"std": 2e-4, "sessions": 3} if a[0] == "g" else None for a in CHANNELS
        },
    }


def plausible_views(samples, rate, allan):
    """Return views.parquet of a record: periodogram, autocorrelation and all deviations."""
    rows = []
    for axis in CHANNELS:
        x = samples[axis].to_numpy()
        power = np.abs(np.fft.rfft(x - x.mean())) ** 2 * 2 / (rate * len(x))
        for part in np.array_split(np.arange(1, len(power)), 60):
            share = 1.96 / np.sqrt(len(part))
            density, f = power[part].mean(), part.mean() * rate / len(x)
            rows.append(("psd", axis, f, density, density * (1 - share), density * (1 + share)))
        for lag in range(40):
            rho = 0.5**lag
            rows.append(("autocorrelation", axis, lag / rate, rho, -0.03, 0.03))
        curve = allan[(allan["axis"] == axis) & (allan["stage"] == "raw")]
        for k, view in enumerate(("total", "modified", "hadamard", "m_sample_3")):
            for tau, *values in curve[["tau_s", "adev", "ci_low", "ci_high"]].to_numpy():
                rows.append((view, axis, tau, *(v * (0.9 + 0.1 * k) for v in values)))
    return pd.DataFrame(rows, columns=["view", "axis", "x", "value", "ci_low", "ci_high"])
