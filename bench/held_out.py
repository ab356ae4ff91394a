"""Held-out errors whose weights and linearisation are of all poses, or of the training poses alone.

The diagnosis fits all poses once. Weights, with their variance components, and the point about
which residuals are linear come from there, and a fold's rows are left out of that linear problem.
Here the whole fit is repeated without the poses of each fold. Printed is, for each device and kind
of residual, the root mean square of the second errors over that of the first.
"""

import argparse
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench import measured
from bench.realistic.device import CASES, record
from bench.study.chain import through
from bench.tables import publish, table
from imuloop import chain
from imuloop.calibrate.calibrate import raw_units, read_recording, start_pair
from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import find_effect
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.records.pose_diagnosis import pose_problem
from imuloop.diagnose.settings import DiagnoseSettings

# measured devices, and the effects of their gyroscope
MEASURED = {"xsens_mti": ("g_sensitivity",), "mpu9150_1": ()}
# seed of the first simulated device
FIRST = 9300


def held_out_errors(problem, effects=()):
    """Return the held-out errors of a PoseProblem by both ways, by kind of residual.

    Returns
    -------
    dict of str to (ndarray, ndarray)
        SI, shape (m,) each: weights and linearisation of all poses, and of the training poses.
    """
    pair, recording, parts = problem.sensor, problem.recording, problem.part_of_pose
    by_all = Choices(problem).errors(lambda missing: effects)[:, 0]
    alone = np.full(len(by_all), np.nan)
    for part in range(problem.parts):
        training = recording.select(parts != part)
        how = problem.settings, problem.tests, problem.found, problem.information
        solution = pose_problem(pair, training, *how).fitted(effects)
        left, _ = pair.model(solution, recording).residuals(solution.fit.x)
        rows = np.flatnonzero(problem.part_of_row == part)
        alone[rows] = left[rows]
    rows = {kind: problem.of_kind(kind) for kind in pair.kinds}
    return {kind: (by_all[at], alone[at]) for kind, at in rows.items()}


def ratios(problem, effects=()):
    """Return the ratio of the root mean squares of both errors, by kind of residual."""
    errors = held_out_errors(problem, effects).items()
    return {kind: float(np.sqrt(np.mean(b**2) / np.mean(a**2))) for kind, (a, b) in errors}


def problem_of(device):
    """Return the PoseProblem of an ingested device, without static sessions."""
    through(device, (chain.segment, chain.noise))
    settings = CalibrateSettings()
    recording = read_recording(device.sessions, settings.longest_rotation)
    units = dict(zip(SENSORS, raw_units(device.sessions), strict=True))
    noise = NoiseModel.from_json(device.file("noise.json"))
    pair, reasons = start_pair(recording, noise, device.gravity, units, settings)
    if pair is None:
        raise RuntimeError(f"{device.name}: {reasons}")
    return pose_problem(pair, recording, DiagnoseSettings(), 1)


def simulated(seed, folder):
    """Return an ingested device of `bench.realistic`: one case after the other."""
    case = CASES[seed % len(CASES)]
    record(seed, case).write(folder / "log.csv")
    device = chain.Device(f"{case}_{seed}", folder, {"log": "multi_position"})
    chain.ingest(device, "log", {}, [folder / "log.csv"])
    return device


def main():
    """Print and publish the ratios of measured and of simulated devices."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=12, help="simulated devices")
    rows, every = [], []
    for name in (*MEASURED, *range(FIRST, FIRST + parser.parse_args().devices)):
        if name in MEASURED and (why := measured.missing(name)):
            print(f"{name}: {why}")
            continue
        effects = [OfSensor(find_effect(e)(), "gyroscope") for e in MEASURED.get(name, ())]
        with TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            make = measured.ingested if name in MEASURED else simulated
            device = make(name, Path(folder))
            try:
                problem = problem_of(device)
                found = ratios(problem, tuple(effects))
            except RuntimeError as error:
                print(error, flush=True)
                continue
        every += found.values()
        poses = len(problem.recording.poses)
        rows.append((device.name, poses, *(f"{x:.4f}" for x in found.values())))
        print(*rows[-1], flush=True)
    summary = f"Median {np.median(every):.4f}, least {min(every):.4f}, largest {max(every):.4f}."
    header = ("device", "poses", "gravity norm", "rate at rest", "rotation")
    publish("held_out", "Held-out errors by less data", f"{table(header, rows)}\n\n{summary}\n")


if __name__ == "__main__":
    main()
