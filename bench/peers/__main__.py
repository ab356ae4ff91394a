"""Allan curves and six faces beside the packages of the registry: `make bench`."""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench.peers.calls import CURVES, FACES, GRAVITY, LENGTH, RATE, averaging_factors
from bench.tables import REPOSITORY, publish, table
from imuloop.calibrate.six_position import decompose
from imuloop.simulate.truth import example_truth

# every so many averaging times are computed in extended precision; below DIGITS all agree
EVERY, DIGITS = 10, 1e-14
# SI, white noise and random walk of accelerometer and gyroscope
N, K = (1e-3, 1e-4), (2e-5, 2e-6)
# simulated sessions; degrees that a face is off, about both axes that lie in it; m/s^2 a sample
SESSIONS, TILT, NOISE = 50, 1.0, 0.02
COMPUTES = {
    None: "accelerometer, with covariance",
    "imucal": "accelerometer; from three turns of known angle gyroscope and g-sensitivity",
}
# freed memory stays with the process: else page faults of temporaries count, or not, by chance
ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": os.pathsep.join([str(REPOSITORY / "workflow/lib"), str(REPOSITORY)]),
    "MALLOC_MMAP_THRESHOLD_": str(1 << 25),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 32),
}


def contend(calls, folder, environment, rounds):
    """Return for each distribution what its best round gave, or why it failed.

    Contenders take turns, each in a process of its own, in this environment or in that of the
    peers: a virtual one.
    """
    found = {}
    for distribution in [*calls] * rounds:
        if isinstance(found.get(distribution), str):
            continue
        python = environment / "bin/python" if distribution else sys.executable
        command = [
            str(python),
            "-m",
            "bench.peers.calls",
            calls[distribution].__name__,
            str(folder),
        ]
        if not Path(python).exists():
            found[distribution] = "there is no environment of the peers"
            continue
        how = {"env": os.environ | ENVIRONMENT, "capture_output": True, "text": True}
        done = subprocess.run(command, **how)
        if done.returncode:
            found[distribution] = (done.stderr.strip().splitlines() or [str(done.returncode)])[-1]
            continue
        made = json.loads(done.stdout.splitlines()[-1])
        found[distribution] = min(
            made, found.get(distribution, made), key=lambda one: one["seconds"]
        )
    return found


def reference(axes, factors):
    """Return the overlapping Allan deviation in extended precision, shape (6, k)."""
    found = np.empty((len(axes), len(factors)))
    for i, x in enumerate(axes):
        total = np.zeros(len(x) + 1, dtype=np.longdouble)
        np.cumsum(x.astype(np.longdouble) - x.mean(), out=total[1:])
        for k, m in enumerate(factors):
            second = total[2 * m :] - 2 * total[m:-m] + total[: -2 * m]
            found[i, k] = np.sqrt((second @ second) / len(second) / 2) / m
    return found


def named(distribution, found):
    """Return a contender's name and version."""
    version = "" if isinstance(found, str) else f" {found['version']}"
    return f"{distribution}{version}" if distribution else "**imuloop**"


def curves(n, environment, rounds):
    """Return the table of the Allan curves of six axes of `n` samples, and their differences."""
    rng, axes, factors = np.random.default_rng(1), np.empty((6, n)), averaging_factors(n)
    for i, x in enumerate(axes):
        x[:] = np.cumsum(rng.standard_normal(n) * K[i // 3] / np.sqrt(RATE))
        x += N[i // 3] * np.sqrt(RATE) * rng.standard_normal(n) + 9.8 * (i == 2)
    rows, true = [], reference(axes, factors[::EVERY])
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        np.save(folder / "axes.npy", axes)
        np.save(folder / "factors.npy", factors)
        for distribution, found in (every := contend(CURVES, folder, environment, rounds)).items():
            if isinstance(found, str):
                rows.append((named(distribution, found), f"failed: {found}", *"––"))
                continue
            made = np.load(folder / f"{CURVES[distribution].__name__}.npy")
            off = np.abs(made[:, ::EVERY] / true - 1).max()
            time = f"{found['seconds']:.3g} ({found['seconds'] / every[None]['seconds']:.2f}×)"
            accuracy = f"{off:.0e}" if off > DIGITS else "< 1e-14"
            rows.append(
                (named(distribution, found), time, accuracy, f"{found['memory'] / 1e6:.0f}")
            )
    size = f"{n:,} × 6, {len(factors)} τ: s"
    return table((size, "processor time", "largest relative difference", "memory, MB"), rows)


def sessions():
    """Return sessions whose faces are a little off, (k, 9 × LENGTH, 6), and the true parameters."""
    rng, sensor = np.random.default_rng(1), example_truth().accelerometer
    inverse = np.linalg.inv(sensor.T @ np.diag(sensor.K))
    up = np.concatenate([np.kron(np.eye(3), [[1], [-1]]), np.eye(3)])
    # the turns only fill their place: they do not enter what is compared
    turning = np.repeat(np.concatenate([np.zeros((6, 3)), -60 * np.eye(3)]), LENGTH, axis=0)
    made = []
    for _ in range(SESSIONS):
        off = np.cross(rng.normal(0, np.radians(TILT), (len(up), 3)), up)
        direction = (up + off) / np.linalg.norm(up + off, axis=1, keepdims=True)
        raw = np.repeat(GRAVITY * direction @ inverse.T + sensor.b, LENGTH, axis=0)
        made.append(np.column_stack([raw + rng.normal(0, NOISE, raw.shape), turning]))
    return np.array(made), np.concatenate([sensor.T[np.triu_indices(3, 1)], sensor.K, sensor.b])


def faces(environment, rounds):
    """Return the table of the six-position calibrations."""
    made, truth = sessions()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        np.save(folder / "sessions.npy", made)
        for distribution, found in contend(FACES, folder, environment, rounds).items():
            if isinstance(found, str):
                rows.append((named(distribution, found), f"failed: {found}", *"––––"))
                continue
            each = np.load(folder / f"{FACES[distribution].__name__}.npy")
            fitted = np.array([decompose(one[:, :3], one[:, 3])[0] for one in each])
            misalignment, scale, bias = np.split(fitted - truth, [3, 6], axis=-1)
            rms = [np.sqrt(np.mean(x**2)) for x in (scale / truth[3:6], bias, misalignment)]
            errors = f"{rms[0]:.3%}", f"{rms[1]:.2g}", f"{np.degrees(rms[2]):.2g}"
            time = f"{1e3 * found['seconds']:.2f}"
            rows.append((named(distribution, found), time, *errors, COMPUTES[distribution]))
    return table(
        ("", "processor time, ms", "scale factor", "bias, m/s²", "misalignment, °", "computes"),
        rows,
    )


def main():
    parser = argparse.ArgumentParser(prog="python -m bench.peers", description=__doc__)
    parser.add_argument("--sizes", default="100000,1000000,3060000", help="samples, with commas")
    parser.add_argument("--rounds", type=int, default=3, help="the best counts")
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="the peers'")
    options = parser.parse_args()
    how = options.environment, options.rounds
    tables = [curves(n, *how) for n in map(int, options.sizes.split(","))]
    text = (
        "## Allan curve of six axes, intervals too", *tables,
        "In brackets multiples of imuloop. Differences are those to extended precision, at every "
        f"{EVERY}th τ. Freed memory stays with each process, which favours the peers.",
        "## Six faces", faces(*how),
        f"Errors are rms over {SESSIONS} simulated sessions, faces off by {TILT:g}° about each "
        f"axis, {LENGTH} samples each.",
    )  # fmt: skip
    publish("peers", "Beside other packages", "\n\n".join(text))


if __name__ == "__main__":
    main()
