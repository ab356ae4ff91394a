"""From the truth of a device to its diagnosis: the stages see its logs and nothing else."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

from imuloop import chain
from imuloop.calibrate.calibrate import start_fit
from imuloop.calibrate.sessions import raw_units, read_recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.chain import Device
from imuloop.core.files import read_json
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS, read_columns
from imuloop.core.segments import STATIC
from imuloop.diagnose.motion import no_result
from imuloop.diagnose.poses import pose_problem
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.estimate.choice import Choices
from imuloop.model.calibration import Calibration
from imuloop.model.state import NAMES
from imuloop.simulate.simulate import log_metadata, simulate_session, write_log
from imuloop.validate.attitude import no_attitude

# tests of a device that share the significance, as the library has about
TESTS = 30
# what takes longest, and is asked of devices without effects alone
LIMITS = "imuloop.diagnose.content.detection_limits"
# nothing that a study judges
ATTITUDE = "imuloop.validate.attitude.validate_attitude"
# what poses and static records are judged without: its own tests come on top of theirs
MOTION = "imuloop.diagnose.diagnose.diagnose_motion"


def run_stages(device, stages=(chain.segment, chain.noise, chain.calibrate, chain.diagnose)):
    """Do the stages of a device, by default up to the diagnosis; raise the error of one that fails.

    A rejected session raises too: figures of the others belong to another device.
    """
    for name, files in device.sessions.items():
        if reasons := read_json(files["quality"])["reasons"]:
            raise RuntimeError(f"{device.name}/{name} was rejected: {'; '.join(reasons)}")
    for stage in stages:
        stage(device)


def diagnosis_of(truth, seed, also=None, limits=True, motion=False):
    """Return diagnosis.json of a simulated device, its motion and noise by a seed.

    `also` takes the truth, the sessions and the folder of the results; its result is returned
    second. Detection limits are computed if `limits`, and motion is tested if `motion`.
    """
    without = nullcontext() if limits else patch(LIMITS, return_value={})
    attitude = no_attitude(truth.name, "not asked for")
    still = nullcontext() if motion else patch(MOTION, return_value=no_result("not asked for"))
    with without, still, patch(ATTITUDE, return_value=attitude), TemporaryDirectory() as folder:
        folder = Path(folder)
        kinds = {name: plan.kind for name, plan in truth.sessions.items()}
        device = Device(truth.name, folder, kinds, gravity=truth.gravity)
        for name in kinds:
            path = folder / f"{name}.parquet"
            write_log(path, simulate_session(truth, name, seed), log_metadata(truth, name))
            chain.ingest(device, name, {}, [path])
        run_stages(device)
        diagnosis = read_json(folder / "diagnosis.json")
        return (diagnosis, also(truth, device.sessions, folder)) if also else diagnosis


def base_pulls(truth, sessions, folder, seed):
    """Return the errors of T, K and b of calibration.json, in their standard errors.

    The result is a dict by sensor and parameter, without sensors that were not calibrated at the
    poses. The true bias is its level over the rests, with the slow noise of this recording.
    """
    calibration, pulls = Calibration.from_json(folder / "calibration.json"), {}
    level = _mean_slow_noise(truth, sessions, seed)
    for sensor, names in NAMES.items():
        fitted, true = getattr(calibration, sensor), getattr(truth, sensor)
        true = replace(true, b=np.add(true.b, level[sensor]))
        if fitted.method == "multi_position":
            pulls[sensor] = {
                n: float((_entry(fitted, n) - _entry(true, n)) / fitted.std[n]) for n in names
            }
    return pulls


def _mean_slow_noise(truth, sessions, seed):
    """Return the mean of flicker and random walk over the rests of the poses, raw units, (3,).

    The result is a dict by sensor. Each process has its own random numbers, so a second
    simulation without these two shows their sum.
    """
    without, none = truth, (0.0, 0.0, 0.0)
    for sensor in SENSORS:
        part = getattr(truth, sensor)
        noise = replace(part.noise, B=none, K=none)
        without = replace(without, **{sensor: replace(part, noise=noise)})
    slow = []
    for name, files in sessions.items():
        if files["kind"] != "multi_position":
            continue
        whole, plain = (simulate_session(t, name, seed) for t in (truth, without))
        segments = read_columns(files["segments"])
        rests = np.asarray(segments["kind"]) == STATIC
        ends = np.column_stack([np.asarray(segments[key])[rests] for key in ("start_s", "end_s")])
        rows = [slice(*row) for row in np.searchsorted(whole["t"], ends)]
        slow += [(whole - plain).to_numpy()[row, 1:7] for row in rows]
    mean = np.concatenate(slow).mean(axis=0) if slow else np.zeros(6)
    return dict(zip(SENSORS, np.split(mean, 2), strict=True))


def _entry(sensor, name):
    return getattr(sensor, name[0])[tuple(map(int, name[1:]))]


def likeness(truth, sessions, folder):
    """Return the similarity of the parameters of each effect at the poses of a device.

    By sensor and effect, the information of its parameters with ones on the diagonal, (q, q): zeros
    elsewhere where each parameter leaves a pattern square to the patterns of the others.
    """
    if (problem := _problem(truth, sessions, folder)) is None:
        return {}
    search, matrices = Choices(problem), {}
    for kind in (*search.problem.variants, *search.problem.scans):
        if trial := search.trial((), kind):
            _, _, covariance = search.estimate((), trial.effect)
            information = np.linalg.inv(covariance)
            size = np.sqrt(np.diag(information))
            matrices[kind.sensor, kind.name] = information / np.outer(size, size)
    return matrices


def _problem(truth, sessions, folder):
    """Return the PoseProblem of a device; None where poses determine no sensor."""
    settings = CalibrateSettings()
    recording = read_recording(sessions, settings.longest_rotation)
    units = dict(zip(SENSORS, raw_units(sessions), strict=True))
    noise = NoiseModel.from_json(folder / "noise.json")
    pair, _ = start_fit(recording, noise, truth.gravity, units)
    return pair and pose_problem(pair, recording, DiagnoseSettings(), TESTS)
