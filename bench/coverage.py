"""Bias and coverage of the calibration over simulated devices: ``make coverage``.

Each seed makes a static and a multi-position session of a device with a known truth, and the
stages see the logs alone: the noise model too is the one that they estimate. Samples may be missing
and stamps late, as a logger does it (`--missing`, `--in-a-row`, `--late`).
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from imuloop import Calibration, chain
from imuloop.calibrate import accelerometer, gyroscope
from imuloop.simulate.logger import lose, stamp_late
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth

KINDS = ("static", "multi_position")
NAMES = {"accelerometer": accelerometer.NAMES, "gyroscope": gyroscope.NAMES}


def calibrated(truth, seed, missing=0.0, in_a_row=1, late=0.0):
    """Return the calibration from the logs of one seed.

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
    with tempfile.TemporaryDirectory() as folder:
        device = chain.Device("imu", Path(folder), dict(zip(KINDS, KINDS, strict=True)))
        for kind in KINDS:
            log = lose(simulate_session(truth, kind, seed), missing, rng, range(1, in_a_row + 1))
            path = Path(folder) / f"{kind}.parquet"
            write_log(path, stamp_late(log, late, rng), {})
            chain.ingest(device, kind, {}, [path])
        for stage in (chain.segment, chain.noise, chain.calibrate):
            if failures := stage(device):
                raise RuntimeError(str(failures[0]))
        return Calibration.from_json(device.file("multi_position.json"))


def errors(fitted, true, names):
    """Return estimate less truth of parameters T01 … b2, and their standard errors."""
    difference = [
        getattr(fitted, name[0])[tuple(map(int, name[1:]))]
        - getattr(true, name[0])[tuple(map(int, name[1:]))]
        for name in names
    ]
    return np.array(difference), np.array([fitted.std[name] for name in names])


def main():
    """Print one line per parameter: bias, scatter, standard error, coverage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--missing", type=float, default=0.0, help="share of the samples, 1")
    parser.add_argument("--in-a-row", type=int, default=1, help="samples lost at once, at most")
    parser.add_argument("--late", type=float, default=0.0, help="scatter of the stamps, s")
    given = parser.parse_args()
    truth, harm = example_truth(), (given.missing, given.in_a_row, given.late)
    found = [calibrated(truth, given.first + seed, *harm) for seed in range(given.seeds)]
    for sensor, names in NAMES.items():
        each = [getattr(calibration, sensor) for calibration in found]
        made = [errors(one, getattr(truth, sensor), names) for one in each]
        difference, std = (np.array(column) for column in zip(*made, strict=True))
        inside = np.abs(difference) < 1.96 * std
        chi2 = np.mean([one.reduced_chi2 for one in each])
        print(
            f"{sensor}: {given.seeds} devices, 95 % intervals cover {inside.mean():.1%}, ", end=""
        )
        print(f"mean reduced chi square {chi2:.2f}")
        print("parameter  mean error  its error  scatter   std. error  coverage")
        for k, name in enumerate(names):
            mean, scatter = difference[:, k].mean(), difference[:, k].std(ddof=1)
            print(
                f"{name:9}  {mean:10.2e}  {scatter / np.sqrt(given.seeds):9.1e}  {scatter:8.1e}  "
                f"{std[:, k].mean():10.1e}  {inside[:, k].mean():8.0%}"
            )


if __name__ == "__main__":
    main()
