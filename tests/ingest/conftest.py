"""A small log, one of numbers that lose their last bit easily, and ingest into a fresh folder."""

import inspect
from collections import namedtuple
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from imuloop.core.files import read_json
from imuloop.core.samples import CHANNELS, read_metadata, read_samples
from imuloop.ingest.formats import FORMATS, find_format
from imuloop.ingest.ingest import Declared, ingest
from imuloop.ingest.stamps import stamp_values

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
def hard():
    """300 rows of six float64 of any mantissa, sign and size, zeros of both signs among them."""
    rng = np.random.default_rng(13)
    values = np.ldexp(rng.uniform(-1, 1, (300, 6)), rng.integers(-60, 60, (300, 6)))
    values[0] = 0.1, 1 / 3, -0.0, 0.0, np.nextafter(1, 2), np.nextafter(np.float32(1), 0)
    return values


@pytest.fixture
def hard_stamps():
    """300 stamps in ns that no float64 holds, in uneven steps."""
    steps = np.random.default_rng(17).integers(9_000_001, 11_000_001, 300)
    return 1_700_000_000_123_456_789 + np.cumsum(steps)


@pytest.fixture
def in_process(monkeypatch):
    """Read all formats in the process of the test, where it is their values that count."""
    for name, form in FORMATS.items():
        monkeypatch.setitem(FORMATS, name, replace(form, read=inspect.unwrap(form.read)))


@pytest.fixture
def every_bit():
    """Read a log; compare its values and stamps with what was written, bit by bit."""

    def check(path, values, stamps, columns=None, format=None):
        paths = path if isinstance(path, dict) else {"log": path}
        _, form = find_format(format, paths)
        table = pa.Table.from_batches(form.read(paths, columns, 64).batches)
        read = np.column_stack([table[name] for name in CHANNELS])
        assert read.dtype == float
        np.testing.assert_array_equal(read.view("u8"), values.astype(float).view("u8"))
        found, readable, _ = stamp_values(table["stamp"].combine_chunks())
        assert readable.all() and found.dtype == np.asarray(stamps).dtype
        np.testing.assert_array_equal(found, stamps)

    return check


@pytest.fixture
def run(tmp_path):
    def call(*paths, **declared):
        if isinstance(paths[0], pd.DataFrame):
            paths[0].to_parquet(tmp_path / "log.parquet", index=False)
            paths = [tmp_path / "log.parquet"]
        target = tmp_path / "out" / "samples.parquet"
        where = {"device": "imu", "session": "poses", "kind": "multi_position"}
        where |= {key: declared.pop(key) for key in {*where, "batch_rows", "threads"} & {*declared}}
        ingest(
            **where,
            declared=Declared(**{key: each for key, each in declared.items() if each is not None}),
            paths=paths,
            samples_path=target,
            quality_path=tmp_path / "out" / "quality.json",
        )
        quality = read_json(tmp_path / "out" / "quality.json")
        return Ingested(read_samples(target), quality, read_metadata(target), target)

    return call
