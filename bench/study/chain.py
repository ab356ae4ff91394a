"""From the truth of a device to its diagnosis: the stages see its logs and nothing else."""

import json
import tempfile
from pathlib import Path

import numpy as np

from imuloop.calibrate.calibrate import calibrate_device, raw_units, read_recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import read_samples
from imuloop.core.segments import read_segments, write_segments
from imuloop.diagnose.diagnose import diagnose_device
from imuloop.diagnose.pose_diagnosis import pose_candidates
from imuloop.diagnose.pose_models import AccelerometerPoses, GyroscopePoses
from imuloop.diagnose.search import Search
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.ingest.ingest import ingest
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import Session
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import log_metadata, simulate_session, write_log


def diagnosis_of(truth, seed, also=None):
    """Return diagnosis.json of a simulated device.

    Parameters
    ----------
    truth : Truth
        The device.
    seed : int
        Of its motion and noise.
    also : callable, optional
        Takes the truth, the sessions and the folder of the results; what it returns comes second.
    """
    with tempfile.TemporaryDirectory() as folder:
        folder, sessions = Path(folder), {}
        for name, plan in truth.sessions.items():
            paths = {key: folder / f"{name}.{key}" for key in ("parquet", "samples", "segments")}
            write_log(
                paths["parquet"], simulate_session(truth, name, seed), log_metadata(truth, name)
            )
            ingest(
                device=truth.name,
                session=name,
                kind=plan.kind,
                paths=[paths["parquet"]],
                samples_path=paths["samples"],
                quality_path=folder / f"{name}.json",
            )
            samples = read_samples(paths["samples"])
            write_segments(
                paths["segments"], *segment_session(samples, plan.kind, SegmentSettings())
            )
            sessions[name] = {"kind": plan.kind, **paths}
        diagnosis = _diagnosis(truth, sessions, folder)
        return (diagnosis, also(truth, sessions, folder)) if also else diagnosis


def _diagnosis(truth, sessions, folder):
    """Return the diagnosis from samples and segments."""
    read = [
        Session(name, s["kind"], read_samples(s["samples"]), read_segments(s["segments"]))
        for name, s in sessions.items()
    ]
    estimate_noise(truth.name, read, NoiseSettings()).to_json(folder / "noise.json")
    common = {
        "device": truth.name,
        "gravity": truth.gravity,
        "sessions": sessions,
        "noise": folder / "noise.json",
    }
    six, multi = folder / "six_position.json", folder / "multi_position.json"
    calibrate_device(**common, settings=CalibrateSettings(), six_path=six, multi_path=multi)
    path = folder / "diagnosis.json"
    diagnose_device(
        **common,
        six_position=six,
        multi_position=multi,
        calibrate_settings=CalibrateSettings(),
        settings=DiagnoseSettings(),
        diagnosis_path=path,
        calibration_path=folder / "calibration.json",
    )
    return json.loads(path.read_text())


def likeness(truth, sessions, folder):
    """Return how alike the parameters of each effect are at the poses of a device.

    Returns
    -------
    dict of (str, str) to ndarray, shape (q, q)
        By sensor and effect, the information of its parameters with ones on the diagonal: zeros
        elsewhere where each parameter leaves a pattern square to those of the others.
    """
    recording = read_recording(sessions, CalibrateSettings().longest_rotation)
    if not len(recording.poses):
        return {}
    units = raw_units(sessions, ["multi_position", "static"])
    noise = NoiseModel.from_json(folder / "noise.json")
    force = AccelerometerPoses(noise, truth.gravity, units[0], CalibrateSettings())
    found = {}
    for model in (force, GyroscopePoses(force, None, (), units[1])):
        available, _ = pose_candidates(model.sensor, recording)
        everything = np.ones(len(recording.poses), dtype=bool)
        search = Search(model, recording, everything, available, DiagnoseSettings(), 1)
        for cls, trial in search.step().trials.items():
            size = np.sqrt(np.diag(trial.information))
            found[model.sensor, cls.name] = trial.information / np.outer(size, size)
    return found
