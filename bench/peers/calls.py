"""Each contender's call on the same data: ``calls NAME FOLDER``, in either environment.

The folder holds `axes.npy`, shape (6, n), SI. Imports and a first call on a short part are not
timed. N, B and K of each axis, shape (6, 3), go to ``NAME.npy``, not-a-number if the package does
not give a value. The program prints seconds of processor time.
"""

import contextlib
import io
import re
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np

from bench.peers import log


def session_of(axes, _):
    """Return the RecordedSession of axes, (6, n), SI: one rest."""
    import pandas as pd

    from imuloop.core.samples import CHANNELS
    from imuloop.core.segments import segment_table
    from imuloop.noise.records import RecordedSession

    n = axes.shape[1]
    samples = pd.DataFrame({"t": np.arange(n) / log.RATE, **dict(zip(CHANNELS, axes, strict=True))})
    segments = segment_table(samples, [0.0], [n / log.RATE], ["static"], [0])
    return RecordedSession("log", "static", samples, segments)


def noise_imuloop(session):
    """The noise stage, then the Allan stage."""
    from imuloop.noise.allan import session_curves
    from imuloop.noise.noise import estimate_noise
    from imuloop.noise.settings import NoiseSettings

    axes = estimate_noise("log", [session], NoiseSettings()).model.axes.values()
    session_curves(session, NoiseSettings())
    return [[getattr(axis, name).value for name in "NBK"] for axis in axes]


def noise_allan_variance(axes):
    """All axes in one call, by its defaults."""
    from allan_variance import compute_avar, estimate_parameters

    estimates, _ = estimate_parameters(*compute_avar(axes.T, 1 / log.RATE))
    return estimates[["white", "flicker", "walk"]]


def noise_allan_variance_analyzer(axes):
    """Like its `run`, but with all digits of each axis; B is the minimum, as `run` prints it."""
    from allan_variance_analyzer import analysis
    from allan_variance_analyzer.statistics import compute_allan_variances

    periods = np.arange(0.1, 1000, step=0.1)
    curves = np.sqrt(compute_allan_variances(axes.T, periods, log.RATE, 0))
    until = np.flatnonzero(periods == 10)[0]
    sensors, estimates = (curves[:, :3], curves[:, 3:]), np.empty((6, 3))
    estimates[:, 0] = np.ravel(
        [analysis.compute_white_noise_params(periods, s, until)[0] for s in sensors]
    )
    estimates[:, 1], _ = analysis.compute_bias_instability(curves)
    estimates[:, 2] = np.ravel([analysis.compute_rate_random_walk(periods, s)[0] for s in sensors])
    return estimates


def recordings_of(axes, folder):
    """Write a recording for each axis, as all three of its sensor: dedrunk has a figure of each."""
    files = [Path(folder, f"{i}.mcap") for i in range(3)]
    for i, file in enumerate(files):
        log.write_mcap(file, axes[[i, i, i]], axes[[i + 3, i + 3, i + 3]])
    return files


def noise_dedrunk(files):
    """A process each, with the reading of its file; no B, and no N either where no K shows."""
    program, estimates = Path(sys.executable).with_name("dedrunk"), np.full((2, 3, 3), np.nan)
    for i, file in enumerate(files):
        command = [program, "--yes", "noise", file, "--csv", f"{file}.csv", "-O", f"{file}.yaml"]
        done = subprocess.run(command, capture_output=True, text=True)
        if "no clear slope" in done.stderr:
            continue
        if done.returncode:
            raise RuntimeError(done.stderr.strip().splitlines()[-1])
        text = Path(f"{file}.yaml").read_text()
        values = re.findall(r"(?:noise_density|random_walk): (\S+)", text)
        estimates[:, i, ::2] = np.reshape(values, (2, 2))
    return estimates.reshape(6, 3)


NOISE = {
    "imuloop": noise_imuloop,
    "allan-variance": noise_allan_variance,
    "allan-variance-analyzer": noise_allan_variance_analyzer,
    "dedrunk-cli": noise_dedrunk,
}
# functions that make the argument of a call from the axes, outside the time; and the number of
# times that a call does the same work
GIVEN = {"noise_imuloop": session_of, "noise_dedrunk": recordings_of}
TIMES = {"noise_dedrunk": 3}


def processor_seconds():
    """Return seconds of processor time of the process and those that it has waited for."""
    of = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in of)


def main():
    name, folder = sys.argv[1], Path(sys.argv[2])
    call = globals()[name]
    # they print progress
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        axes = np.load(folder / "axes.npy")
        short = axes[:, : len(axes[0]) // 10].copy()
        prepare = GIVEN.get(name, lambda axes, _: axes)
        # some refuse a short log
        with contextlib.suppress(Exception):
            call(prepare(short, folder))
        data, before = prepare(axes, folder), processor_seconds()
        values = call(data)
        took = processor_seconds() - before
    np.save(folder / f"{name}.npy", np.asarray(values, dtype=float))
    print(took / TIMES.get(name, 1))


if __name__ == "__main__":
    main()
