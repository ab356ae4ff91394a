"""The measured recordings through all stages, each device once for all tests of its figures."""

import json
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import pytest

from bench.study.chain import LIMITS, run_stages
from imuloop.calibrate.sessions import read_recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.noise_model import NoiseModel
from imuloop.model.calibration import Calibration
from published.measured import devices, fetch_fault, ingest_device
from quick import verdicts

# of one make, and of them the first alone but in a study
BOARDS = [1, *(pytest.param(board, marks=pytest.mark.study) for board in (2, 3))]
DEVICES = ["xsens_mti", "mpu9150_1", "ferraris"]
DEVICES += [
    pytest.param(name, marks=pytest.mark.study)
    for name in ("mpu9150_2", "mpu9150_3", "thermal_chamber")
]
# of which the error of the vertical is tested, too
WHOLE = "xsens_mti"


@dataclass(frozen=True)
class Measured:
    """Results of the measured devices, each made when it is asked for first."""

    folder: Path

    def of(self, device):
        folder = self.folder / device
        if not folder.exists():
            if reason := fetch_fault(device):
                assert "cannot be fetched" in reason
                pytest.skip(f"{reason}; data/README.md describes it")
            imu = ingest_device(device, folder)
            if device == WHOLE:
                with patch(LIMITS, return_value={}):
                    run_stages(imu)
            else:
                verdicts(imu)
        return folder

    def json(self, device, name):
        return json.loads((self.of(device) / f"{name}.json").read_text())

    def session(self, device, session):
        """Return the files of a session, as the library's stages take them."""
        kind = devices()[device]["sessions"][session]["kind"]
        files = ("samples", "segments")
        return {"kind": kind} | {f: self.of(device) / session / f"{f}.parquet" for f in files}

    def fit_of(self, device):
        """Return the recording of a device's poses, its noise and its base calibration."""
        sessions = {"poses": self.session(device, "poses")}
        recording = read_recording(sessions, CalibrateSettings().longest_rotation)
        noise = NoiseModel.from_json(self.of(device) / "noise.json")
        return recording, noise, Calibration.from_json(self.of(device) / "multi_position.json")


@pytest.fixture(scope="session")
def measured_results(recordings, tmp_path_factory):
    """Return the results of the devices of both configs, up to the diagnosis."""
    with pytest.MonkeyPatch.context() as patch:
        if recordings.folder.is_dir():
            patch.setenv("IMULOOP_MIRROR", str(recordings.folder))
        yield Measured(tmp_path_factory.mktemp("measured"))
