"""A small sound log, and ingest into a fresh folder."""

from collections import namedtuple

import numpy as np
import pandas as pd
import pytest

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.files import read_json
from imuloop.core.samples import CHANNELS, read_metadata, read_samples
from imuloop.ingest.ingest import Declared, ingest
from ingest.logs import brief

Ingested = namedtuple("Ingested", "samples quality metadata path")


@pytest.fixture
def log():
    return brief()


@pytest.fixture
def single(log):
    """The log as autopilots keep it: single precision, whole microseconds."""
    return log.astype(np.float32).assign(t=np.arange(500) * 10_003 * 1e-6)


@pytest.fixture
def same():
    """Check that the samples of a log are those that were written, each value and its time."""

    def check(done, log, within=1e-12):
        np.testing.assert_array_equal(done.samples[[*CHANNELS]], log[[*CHANNELS]])
        np.testing.assert_allclose(done.samples.t, log.t - log.t.iloc[0], rtol=0, atol=within)

    return check


@pytest.fixture
def run(tmp_path):
    def call(*paths, **declared):
        if isinstance(paths[0], pd.DataFrame):
            paths[0].to_parquet(tmp_path / "log.parquet", index=False)
            paths = [tmp_path / "log.parquet"]
        target = tmp_path / "out" / "samples.parquet"
        where = {"device": "imu", "session": "poses", "kind": "multi_position"}
        where |= {key: declared.pop(key) for key in {*where} & {*declared}}
        ingest(
            **where,
            declared=Declared(**{key: x for key, x in declared.items() if x is not None}),
            paths=paths,
            samples_path=target,
            quality_path=tmp_path / "out" / "quality.json",
        )
        quality = read_json(tmp_path / "out" / "quality.json")
        return Ingested(read_samples(target), quality, read_metadata(target), target)

    return call


@pytest.fixture
def refused(run):
    """Check that a log is refused in one line: as rejected, or, where `error`, as misdeclared."""

    def check(line, *paths, error=True, **declared):
        with pytest.raises(ImuloopError if error else RejectedLog, match=line) as caught:
            raise RejectedLog(*run(*paths, **declared).quality["reasons"][:1])
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 600

    return check
