"""Bias and coverage of the calibration over simulated devices: ``make coverage``.

Each seed makes a static and a multi-position session of a device with a known truth, and the
stages see the logs alone: the noise model too is the one that they estimate. Samples may be missing
and stamps late, as a logger does it (`--missing`, `--in-a-row`, `--late`).
"""

import argparse

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.calibrate import calibrate_accelerometer, calibrate_gyroscope
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.units import RawUnit
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import Session
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.logger import lose, stamp_late
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth


def calibrated(truth, seed, missing=0.0, in_a_row=1, late=0.0):
    """Return the two sensors' calibrations from the logs of one seed.

    Parameters
    ----------
    truth : Truth
        The device.
    seed : int
        Of its motion, its noise and its logger.
    missing, in_a_row : float, int
        Share of the samples that are lost, and up to how many in a row.
    late : float
        Standard deviation of the stamps, s, integrated as they are.
    """
    rng = np.random.default_rng([seed, 1])
    logs = {}
    for kind in ("static", "multi_position"):
        log = lose(simulate_session(truth, kind, seed), missing, rng, range(1, in_a_row + 1))
        log = stamp_late(log, late, rng)
        # as the ingest stage drops them
        logs[kind] = log[log["t"] > log["t"].cummax().shift(fill_value=-1)].reset_index(drop=True)
    segments = {
        kind: segment_session(log, kind, SegmentSettings())[0] for kind, log in logs.items()
    }
    still = Session("static", "static", logs["static"], segments["static"])
    noise = estimate_noise(truth.name, [still], NoiseSettings()).model
    log, table = logs["multi_position"], segments["multi_position"]
    settings = CalibrateSettings()
    recording = record([log], [table], settings.longest_rotation)
    force = calibrate_accelerometer(
        recording.poses, noise, truth.gravity, RawUnit("m/s^2", 1.0), settings
    )
    turn = calibrate_gyroscope(recording, noise, force, RawUnit("rad/s", 1.0), settings)
    return force, turn


def errors(fitted, true, names):
    """Return estimate less truth of parameters T01 … b2, and their standard errors."""
    difference = [
        getattr(fitted, name[0])[tuple(map(int, name[1:]))]
        - getattr(true, name[0])[tuple(map(int, name[1:]))]
        for name in names
    ]
    return np.array(difference), np.array([fitted.std[name] for name in names])


def main():
    """Print one line a parameter: bias, scatter, standard error, coverage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--missing", type=float, default=0.0, help="share of the samples, 1")
    parser.add_argument("--in-a-row", type=int, default=1, help="samples lost at once, at most")
    parser.add_argument("--late", type=float, default=0.0, help="scatter of the stamps, s")
    given = parser.parse_args()
    seeds, harm = given.seeds, (given.missing, given.in_a_row, given.late)
    truth = example_truth()
    pairs = [calibrated(truth, given.first + seed, *harm) for seed in range(seeds)]
    for index, (sensor, names) in enumerate(
        (("accelerometer", accelerometer.NAMES), ("gyroscope", gyroscope.NAMES))
    ):
        made = [errors(pair[index], getattr(truth, sensor), names) for pair in pairs]
        difference, std = (np.array(column) for column in zip(*made, strict=True))
        inside = np.abs(difference) < 1.96 * std
        chi2 = np.mean([pair[index].reduced_chi2 for pair in pairs])
        print(f"{sensor}: {seeds} devices, 95 % intervals cover {inside.mean():.1%}, ", end="")
        print(f"mean reduced chi square {chi2:.2f}")
        print("parameter  mean error  its error  scatter   std. error  coverage")
        for k, name in enumerate(names):
            mean, scatter = difference[:, k].mean(), difference[:, k].std(ddof=1)
            print(
                f"{name:9}  {mean:10.2e}  {scatter / np.sqrt(seeds):9.1e}  {scatter:8.1e}  "
                f"{std[:, k].mean():10.1e}  {inside[:, k].mean():8.0%}"
            )


if __name__ == "__main__":
    main()
