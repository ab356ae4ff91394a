"""Each contender's call on the same data: ``calls NAME FOLDER``, in either environment.

The folder holds `axes.npy`, shape (6, n), SI, and `factors.npy`, the averaging factors. Imports and
a first call on a short part are not timed. What was computed goes to ``NAME.npy``; printed is JSON:
seconds of processor time, bytes of memory at the peak, the version.
"""

import contextlib
import io
import json
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np

from bench.memory import peak_memory

# Hz
RATE = 100.0


def allantools(axes, factors):
    """One axis a call."""
    from allantools import oadev

    taus = factors / RATE
    return [oadev(x, rate=RATE, data_type="freq", taus=taus)[1] for x in axes]


def allan_variance(axes, factors):
    """Its averaging times are those of `factors`; an axis a call: it is three times as fast so."""
    from allan_variance import compute_avar

    times = {"tau_min": 1 / RATE, "tau_max": (factors[-1] + 0.5) / RATE}
    found = [compute_avar(x, 1 / RATE, n_clusters=COUNT, **times) for x in axes]
    assert np.array_equal(np.rint(found[0][0] * RATE), factors)
    return np.sqrt([variance for _, variance in found])


def avar(axes, factors):
    """One axis a call: it is faster so than by rows."""
    from avar import variance

    return np.sqrt([variance(x, factors) for x in axes])


def allan_variance_analyzer(axes, factors):
    """Its function below the class, which takes 10,000 evenly spaced times and no others."""
    from allan_variance_analyzer.statistics import compute_allan_variances

    # the function cuts off: the half keeps rounding from taking one sample less
    return np.sqrt(compute_allan_variances(axes.T, (factors + 0.5) / RATE, RATE, overlap=0)).T


def allan_variance_fit(axes, factors):
    """Curve and five coefficients; returned N and K of the accelerometer's axes."""
    from allan_variance import compute_avar, estimate_parameters

    last = {"tau_max": (factors[-1] + 0.5) / RATE, "n_clusters": COUNT}
    found = [estimate_parameters(*compute_avar(x, 1 / RATE, **last))[0] for x in axes]
    return [[each["white"], each["walk"]] for each in found[:3]]


def allan_variance_analyzer_fit(axes, _):
    """As its README shows; returned N and K of the accelerometer: it writes the largest of each."""
    from allan_variance_analyzer import AllanVarianceAnalyzer

    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "config.yaml"
        config.write_text(f"imu_rate: {RATE:g}\nmeasure_rate: {RATE:g}\nshow_plots: false\n")
        AllanVarianceAnalyzer(config, folder)(axes.T.copy())
        lines = (Path(folder) / "imu.yaml").read_text().splitlines()
    values = dict(line.split(": ") for line in lines if line.startswith("accelerometer"))
    names = ("accelerometer_noise_density", "accelerometer_random_walk")
    return [[float(values[name]) for name in names]]


def imuloop(axes, factors):
    """The curve alone."""
    from imuloop.noise.allan import allan_variance

    return np.sqrt([allan_variance([x], factors) for x in axes])


def imuloop_intervals(axes, factors):
    """The curve, its intervals by the noise fitted to it, as allan.parquet holds them."""
    from imuloop.core.noise_model import AxisNoise, Coefficient
    from imuloop.noise.allan import allan_table, allan_variance
    from imuloop.noise.curve import TERMS, CurveVariance, fit_curve

    tau, tables = factors / RATE, []
    spread = CurveVariance.of(factors, [axes.shape[1]], RATE)
    for name, x in zip(("ax", "ay", "az", "gx", "gy", "gz"), axes, strict=True):
        curve = allan_variance([x], factors)
        fitted = fit_curve(tau, curve, spread)
        noise = AxisNoise(
            **{t: Coefficient(v, identifiable=v > 0) for t, v in zip(TERMS, fitted, strict=True)}
        )
        tables.append(allan_table(name, tau, curve, spread.degrees_of_freedom(noise, tau)))
    return [table["adev"] for table in tables]


# averaging times, of which the shortest coincide
COUNT = 116
# name: call, distribution
CALLS = {
    "allantools": (allantools, "allantools"),
    "allan-variance": (allan_variance, "allan-variance"),
    "avar": (avar, "avar"),
    "allan-variance-analyzer": (allan_variance_analyzer, "allan-variance-analyzer"),
    "allan-variance, fit": (allan_variance_fit, "allan-variance"),
    "allan-variance-analyzer, fit": (allan_variance_analyzer_fit, "allan-variance-analyzer"),
    "imuloop": (imuloop, None),
    "imuloop, intervals": (imuloop_intervals, None),
}


def averaging_factors(n):
    """Return the averaging factors of all, spaced as `allan-variance` spaces them, about 100."""
    spaced = np.logspace(0, np.log2(n // 3), COUNT, base=2)
    return np.unique(np.rint(spaced)).astype(int)


def main():
    name, folder = sys.argv[1], Path(sys.argv[2])
    call, distribution = CALLS[name]
    axes, factors = np.load(folder / "axes.npy"), np.load(folder / "factors.npy")
    # they print progress
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        short = axes[:, : len(axes[0]) // 10].copy()
        # one of them needs more than a short part
        with contextlib.suppress(Exception):
            call(short, averaging_factors(len(short[0])))
        before = time.process_time()
        values = call(axes, factors)
        seconds = time.process_time() - before
    np.save(folder / f"{name}.npy", np.asarray(values))
    release = distribution and version(distribution)
    print(json.dumps({"seconds": seconds, "memory": peak_memory(), "version": release}))


if __name__ == "__main__":
    main()
