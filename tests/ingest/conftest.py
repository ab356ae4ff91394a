"""A small log, and ingest into a fresh folder."""

from collections import namedtuple

import numpy as np
import pandas as pd
import pytest

from imuloop.core.files import read_json
from imuloop.core.samples import read_metadata, read_samples
from imuloop.ingest.ingest import ingest

Ingested = namedtuple("Ingested", "samples quality metadata path")


@pytest.fixture
def log():
    """500 rows at 100 Hz, a sensor at rest with z up; whole 1e-6, so text keeps it exactly."""
    rng = np.random.default_rng(7)
    table = pd.DataFrame({"t": np.arange(500) / 100})
    for name, mean in zip("ax ay az gx gy gz".split(), [0.1, -0.2, 9.8, 0, 0, 0.01], strict=True):
        table[name] = np.round(mean + 0.01 * rng.normal(size=500), 6)
    return table


@pytest.fixture
def run(tmp_path):
    """Ingest paths; give samples, quality and metadata."""

    def call(*paths, **declared):
        target = tmp_path / "out" / "samples.parquet"
        ingest(
            **{"device": "imu", "session": "poses", "kind": "static", **declared},
            paths=paths,
            samples_path=target,
            quality_path=tmp_path / "out" / "quality.json",
        )
        quality = read_json(tmp_path / "out" / "quality.json")
        return Ingested(read_samples(target), quality, read_metadata(target), target)

    return call
