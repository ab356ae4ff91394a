"""The measured recordings through the whole workflow, once for all tests of published figures."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from imuloop.calibrate.calibrate import read_recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.config import fetched, resolve
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.ingest.sources import file_name

DEVICES = ("xsens_mti", "mpu9150_1", "mpu9150_2", "mpu9150_3", "ferraris", "thermal_chamber")


@dataclass(frozen=True)
class Measured:
    """Results of the measured config."""

    folder: Path

    def json(self, device, name):
        return json.loads((self.folder / device / f"{name}.json").read_text())

    def session(self, device, session):
        """Return the files of a session, as the library's stages take them."""
        folder = self.folder / device / session
        kind = {"poses": "multi_position", "faces": "six_position"}[session]
        return {
            "kind": kind,
            "samples": folder / "samples.parquet",
            "segments": folder / "segments.parquet",
        }

    def fit_of(self, device):
        """Return the recording of a device's poses, its noise and its base calibration."""
        sessions = {"poses": self.session(device, "poses")}
        recording = read_recording(sessions, CalibrateSettings().longest_rotation)
        noise = NoiseModel.from_json(self.folder / device / "noise.json")
        return recording, noise, Calibration.from_json(self.folder / device / "multi_position.json")


@pytest.fixture(scope="session")
def measured(repository, recordings, tmp_path_factory):
    """Return the results of ``config/measured.yaml``, all stages up to the diagnosis."""
    config = yaml.safe_load((repository / "config/measured.yaml").read_text())
    for source in fetched(resolve(config)).values():
        recordings(file_name(source))
    folder = tmp_path_factory.mktemp("measured")
    targets = [f"results/{device}/diagnosis.json" for device in DEVICES]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IMULOOP_MIRROR", str(recordings.folder))
        snakemake(folder, repository / "config/measured.yaml", targets)
    return Measured(folder / "results")


def snakemake(folder, config, targets, *options):
    """Make targets of a config in a folder."""
    snakefile = Path(__file__).resolve().parents[2] / "Snakefile"
    command = [sys.executable, "-m", "snakemake", "-s", snakefile, "-d", folder, "-c2"]
    command += ["--configfile", config, *options, "--quiet", "all", "--", *targets]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
