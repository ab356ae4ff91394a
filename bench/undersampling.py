"""What half the rate loses of turns, foreseen and found: ``python -m bench.undersampling``.

Every second sample of a measured log, from the first and from the second on, is a log of half the
rate; what its turns lack, the whole log shows, less the noise of the samples left out.
IMULOOP_MIRROR names the folder of the recordings.
"""

import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from bench import array, measured
from imuloop import chain
from imuloop.calibrate.calibrate import read_recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.calibrate.undersampling import aliased_turns
from imuloop.core.rotation import exponential, matrix, prefix_product, step_vectors
from imuloop.core.samples import ANGULAR_RATE, TIME

LOGS = {
    **{f"MPU-9150 board {k}": (measured.ingested, f"mpu9150_{k}") for k in (1, 2, 3)},
    **{f"array, `{name}`": (array.ingested, name, 1) for name in array.RECORDINGS},
    "Xsens MTi": (measured.ingested, "xsens_mti"),
}


def turned(rates, seconds):
    """Return the matrix of the turn that samples of an angular rate, rad/s, make."""
    steps = step_vectors(rates, np.full(len(rates) - 1, seconds))
    return matrix(prefix_product(exponential(steps))[-1])


def halved(recording):
    """Return what is foreseen of one axis and what is found, mean square of each turn, rad²."""
    rotations, poses = recording.rotations, recording.poses
    rest = poses.w[rotations.first], poses.variance[rotations.first, 3:]
    t = np.asarray(recording.logs[0].t)
    usual = np.median(np.diff(t))
    first, last = np.searchsorted(t, rotations.start_s), np.searchsorted(t, rotations.end_s)
    foreseen, found = [], []
    for phase in (0, 1):
        log = {TIME: t[phase::2]} | {
            c: w[phase::2] for c, w in zip(ANGULAR_RATE, recording.logs[0].w.T, strict=True)
        }
        begin, end = (first + 1 - phase) // 2, (last - phase) // 2
        foreseen.append(aliased_turns(log, begin, end, *rest)[0])
        w = recording.logs[0].w
        for i, j, bias in zip(2 * begin + phase, 2 * end + phase, rest[0], strict=True):
            whole = turned(w[i : j + 1] - bias, usual)
            lack = turned(w[i : j + 1 : 2] - bias, 2 * usual) @ whole.T
            found.append(np.sum((lack - lack.T) ** 2) / 24)
    noise = (last - first) * usual**2 * rest[1].mean(axis=1)
    return np.mean(foreseen, axis=0), np.mean(np.reshape(found, (2, -1)), axis=0) - noise


def main():
    """Print a table of the logs."""
    print("| log | rate, Hz | foreseen at the rate | at half of it: foreseen, found, mrad | rank |")
    print("|---|---|---|---|---|")
    for name, (ingested, *which) in LOGS.items():
        if ingested is measured.ingested and (reason := measured.missing(*which)):
            raise SystemExit(reason)
        with tempfile.TemporaryDirectory() as folder:
            device = ingested(*which, Path(folder))
            if failures := chain.segment(device):
                raise SystemExit(str(failures[0]))
            recording = read_recording(device.sessions, CalibrateSettings().longest_rotation)
        rotations = recording.rotations
        rate = 1 / np.median(rotations.steps[rotations.steps > 0])
        whole = 0.0 if rotations.aliased is None else np.sqrt(rotations.aliased.mean())
        foreseen, found = halved(recording)
        sizes = (1e3 * np.sqrt(max(np.mean(each), 0)) for each in (foreseen, found))
        half, rank = ", ".join(f"{size:.2f}" for size in sizes), spearmanr(foreseen, found)[0]
        print(f"| {name} | {rate:.4g} | {1e3 * whole:.2f} | {half} | {rank:.2f} |")


if __name__ == "__main__":
    main()
