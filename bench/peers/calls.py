"""Each contender's call on the same data: ``calls NAME FOLDER``, in either environment.

For Allan curves the folder holds `axes.npy`, shape (6, n), SI, and `factors.npy`, the averaging
factors; imports and a first call on a short part are not timed. For six faces it holds
`sessions.npy`, shape (k, 9 × `LENGTH`, 6): acceleration and angular rate at the faces, then at
three turns, as imucal wants them; the first session is timed. What was computed goes to
``NAME.npy``; printed are seconds of processor time.
"""

import contextlib
import io
import sys
import time
from pathlib import Path

import numpy as np

# Hz; m/s^2
RATE, GRAVITY = 100.0, 9.80665
# averaging times, of which the shortest coincide
COUNT = 116
# sections of a session by imucal's names, the faces first, and the samples of each
SECTIONS = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a", "x_rot", "y_rot", "z_rot")
LENGTH = 400


def averaging_factors(n):
    """Return the averaging factors of all, spaced as `allan-variance` spaces them, about 100."""
    spaced = np.logspace(0, np.log2(n // 3), COUNT, base=2)
    return np.unique(np.rint(spaced)).astype(int)


def curves_allantools(axes, factors):
    """One axis a call."""
    from allantools import oadev

    taus = factors / RATE
    return [oadev(x, rate=RATE, data_type="freq", taus=taus)[1] for x in axes]


def curves_allan_variance(axes, factors):
    """Its averaging times are those of `factors`; an axis a call: it is three times as fast so."""
    from allan_variance import compute_avar

    times = {"tau_min": 1 / RATE, "tau_max": (factors[-1] + 0.5) / RATE}
    found = [compute_avar(x, 1 / RATE, n_clusters=COUNT, **times) for x in axes]
    assert np.array_equal(np.rint(found[0][0] * RATE), factors)
    return np.sqrt([variance for _, variance in found])


def curves_imuloop(axes, factors):
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


def faces_imucal(session):
    """Accelerometer, gyroscope and g-sensitivity, by its own two calls; A, c of ``A raw + c``."""
    import pandas as pd
    from imucal import FerrarisCalibration, ferraris_regions_from_section_list

    names = [f"{sensor}_{axis}" for sensor in ("acc", "gyr") for axis in "xyz"]
    edges = {n: (k * LENGTH, (k + 1) * LENGTH) for k, n in enumerate(SECTIONS)}
    sections = pd.DataFrame(edges, index=["start", "end"]).T
    regions = ferraris_regions_from_section_list(pd.DataFrame(session, columns=names), sections)
    found = FerrarisCalibration(grav=GRAVITY).compute(
        regions, RATE, from_acc_unit="m/s^2", from_gyr_unit="deg/s"
    )
    matrix = np.linalg.inv(found.K_a @ found.R_a)
    return np.column_stack([matrix, -matrix @ found.b_a])


def faces_imuloop(session):
    """Accelerometer with its covariance; A, c of ``A raw + c``, shape (3, 4)."""
    from imuloop.calibrate.six_position import fit_six_position

    means = session[: 6 * LENGTH, :3].reshape(6, LENGTH, 3).mean(axis=1)
    fit = fit_six_position(means, np.array([1, -1, 2, -2, 3, -3]), GRAVITY)
    matrix = np.eye(3)
    matrix[np.triu_indices(3, 1)] = fit.x[:3]
    matrix = fit.case @ matrix @ np.diag(fit.x[3:6])
    return np.column_stack([matrix, -matrix @ fit.x[6:9]])


# by distribution, as bench/requirements.txt has it
CURVES = {
    "imuloop": curves_imuloop,
    "allantools": curves_allantools,
    "allan-variance": curves_allan_variance,
}
FACES = {"imuloop": faces_imuloop, "imucal": faces_imucal}


def seconds(call, *arguments):
    """Return what a call returns, and its seconds of processor time."""
    before = time.process_time()
    values = call(*arguments)
    return values, time.process_time() - before


def main():
    name, folder = sys.argv[1], Path(sys.argv[2])
    call = globals()[name]
    # they print progress
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        if call in CURVES.values():
            axes, factors = np.load(folder / "axes.npy"), np.load(folder / "factors.npy")
            short = axes[:, : len(axes[0]) // 10].copy()
            call(short, averaging_factors(len(short[0])))
            values, took = seconds(call, axes, factors)
        else:
            sessions = np.load(folder / "sessions.npy")
            values = [call(session) for session in sessions]
            took = min(seconds(call, sessions[0])[1] for _ in range(10))
    np.save(folder / f"{name}.npy", np.asarray(values))
    print(took)


if __name__ == "__main__":
    main()
