"""The measured recordings through the whole workflow, once for all tests of published figures."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from imuloop.config import fetched, resolve
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


@pytest.fixture(scope="session")
def measured(repository, recordings, tmp_path_factory):
    """Return the results of ``config/measured.yaml``, all stages up to the diagnosis."""
    config = yaml.safe_load((repository / "config/measured.yaml").read_text())
    for source in fetched(resolve(config)).values():
        recordings(file_name(source))
    folder = tmp_path_factory.mktemp("measured")
    command = [
        *(sys.executable, "-m", "snakemake", "-s", repository / "Snakefile", "-d", folder),
        *("--configfile", repository / "config/measured.yaml", "-c2", "--quiet", "all", "--"),
        *(f"results/{device}/diagnosis.json" for device in DEVICES),
    ]
    environment = os.environ | {"IMULOOP_MIRROR": str(recordings.folder)}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return Measured(folder / "results")
