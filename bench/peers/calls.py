"""Each contender's call on the same data: ``calls NAME FOLDER``, in either environment.

For Allan curves the folder holds `axes.npy`, shape (6, n), SI, and `factors.npy`, the averaging
factors; imports and a first call on a short part are not timed. For six faces it holds a log
``<i>.csv`` per session and its sections ``<i>.json``, as imucal's example has them: faces x_p …
z_a, turns x_rot … z_rot; the first session is timed, from the table in memory on. What was computed
goes to ``NAME.npy``; printed is JSON: seconds of processor time, bytes of memory at the peak, the
version.
"""

import contextlib
import io
import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

# Hz, of the record and of imucal's recording; m/s^2
RATE, FACES_RATE, GRAVITY = 100.0, 204.8, 9.80665
# averaging times, of which the shortest coincide
COUNT = 116
FACES = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
FORCE = ["acc_x", "acc_y", "acc_z"]


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


def imuloop(axes, factors):
    """The curve alone."""
    from imuloop.noise.allan import allan_variance

    return np.sqrt([allan_variance([x], factors) for x in axes])


def imuloop_intervals(axes, factors):
    """The curve, its intervals by the noise fitted to it, as allan.parquet holds them."""
    from imuloop.noise.allan import allan_table, allan_variance
    from imuloop.noise.curve import NoiseOfCurve, fit_curve

    tau, tables = factors / RATE, []
    expected = NoiseOfCurve.of(factors, [axes.shape[1]], RATE)
    for name, x in zip(("ax", "ay", "az", "gx", "gy", "gz"), axes, strict=True):
        curve = allan_variance([x], factors)
        theta = np.square(fit_curve(curve, expected))
        tables.append(allan_table(name, tau, curve, expected.degrees_of_freedom(theta)))
    return [table["adev"] for table in tables]


def faces_imucal(log, sections):
    """Accelerometer, gyroscope and g-sensitivity, by its own two calls; A, c of ``A raw + c``."""
    from imucal import FerrarisCalibration, ferraris_regions_from_section_list

    regions = ferraris_regions_from_section_list(log, pd.DataFrame(sections).T)
    found = FerrarisCalibration(grav=GRAVITY).compute(
        regions, FACES_RATE, from_acc_unit="m/s^2", from_gyr_unit="deg/s"
    )
    matrix = np.linalg.inv(found.K_a @ found.R_a)
    return np.column_stack([matrix, -matrix @ found.b_a])


def faces_imuloop(log, sections):
    """Accelerometer with its covariance; A, c of ``A raw + c``, shape (3, 4)."""
    from imuloop.calibrate.six_position import fit_six_position

    force = log[FORCE].to_numpy()
    means = [force[sections[f]["start"] : sections[f]["end"]].mean(axis=0) for f in FACES]
    fit = fit_six_position(means, np.array([1, -1, 2, -2, 3, -3]), GRAVITY)
    matrix = np.eye(3)
    matrix[np.triu_indices(3, 1)] = fit.x[:3]
    matrix = fit.case @ matrix @ np.diag(fit.x[3:6])
    return np.column_stack([matrix, -matrix @ fit.x[6:9]])


# name: call, distribution
CURVES = {
    "imuloop": (imuloop, None),
    "imuloop, intervals": (imuloop_intervals, None),
    "allantools": (allantools, "allantools"),
    "allan-variance": (allan_variance, "allan-variance"),
    "avar": (avar, "avar"),
    "allan-variance-analyzer": (allan_variance_analyzer, "allan-variance-analyzer"),
}
FACES_CALLS = {"imuloop, faces": (faces_imuloop, None), "imucal, faces": (faces_imucal, "imucal")}


def averaging_factors(n):
    """Return the averaging factors of all, spaced as `allan-variance` spaces them, about 100."""
    spaced = np.logspace(0, np.log2(n // 3), COUNT, base=2)
    return np.unique(np.rint(spaced)).astype(int)


def peak_memory():
    """Return the bytes of memory that this process had at most."""
    # what getrusage tells may be the parent's, from before the program began
    (line,) = (x for x in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in x)
    return 1024 * int(line.split()[1])


def timed(call, *arguments):
    """Return what a call returns, and its seconds."""
    before = time.process_time()
    values = call(*arguments)
    return values, time.process_time() - before


def main():
    name, folder = sys.argv[1], Path(sys.argv[2])
    call, distribution = (CURVES | FACES_CALLS)[name]
    # they print progress
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        if name in CURVES:
            axes, factors = np.load(folder / "axes.npy"), np.load(folder / "factors.npy")
            short = axes[:, : len(axes[0]) // 10].copy()
            call(short, averaging_factors(len(short[0])))
            values, seconds = timed(call, axes, factors)
        else:
            paths = sorted(folder.glob("*.csv"))
            sections = [json.loads(path.with_suffix(".json").read_text()) for path in paths]
            logs = list(zip(map(pd.read_csv, paths), sections, strict=True))
            values = [call(*each) for each in logs]
            seconds = min(timed(call, *logs[0])[1] for _ in range(10))
    np.save(folder / f"{name}.npy", np.asarray(values))
    release = distribution and version(distribution)
    print(json.dumps({"seconds": seconds, "memory": peak_memory(), "version": release}))


if __name__ == "__main__":
    main()
