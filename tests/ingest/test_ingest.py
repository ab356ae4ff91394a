"""One call: files written in one step, errors of one line, provenance."""

import hashlib
import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import schema
from imuloop.ingest import convert


@pytest.fixture
def path(log, tmp_path):
    """The log as CSV."""
    log.to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv"


def test_provenance(path, run):
    source = {"log": {"url": "https://example.org/log.csv", "sha256": "ab"}}
    done = run(path, sources=source)
    assert done.metadata == {
        "device": "imu",
        "session": "poses",
        "kind": "static",
        "log_format": "csv",
        "source": source,
        "sha256": {"log.csv": hashlib.sha256(path.read_bytes()).hexdigest()},
        "units": {"time": "s", "acceleration": "m/s^2", "angular_rate": "rad/s"},
        "raw_units": {
            "acceleration": {"name": "m/s^2", "scale": 1.0, "offset": 0.0},
            "angular_rate": {"name": "rad/s", "scale": 1.0, "offset": 0.0},
        },
        "simulated": False,
        "start": None,
    }
    for key, value in done.metadata.items():
        assert done.quality[key] == value
    fields = pq.read_schema(done.path)
    assert fields.equals(schema(False, {}))


def test_the_same_bytes_again(path, run):
    assert run(path).path.read_bytes() == run(path).path.read_bytes()


@pytest.mark.parametrize("coarse", [True, False])
def test_threads_change_nothing_and_progress_is_told(log, path, run, monkeypatch, coarse):
    monkeypatch.setattr("imuloop.ingest.ingest.ROW_GROUP", 1000)
    log = pd.concat([log] * 12, ignore_index=True)
    log["t"] = np.arange(len(log)) / 100
    log["ax"] = np.random.default_rng(2).normal(size=len(log)).round(1 if coarse else 6)
    log.to_csv(path, index=False)
    size, told = path.stat().st_size, []
    first = run(path, batch_rows=500)
    again = run(path, batch_rows=500, threads=2, progress=lambda *all: told.append(all))
    assert again.quality == first.quality
    assert again.path.read_bytes() == first.path.read_bytes()
    pd.testing.assert_frame_equal(again.samples, log)
    encodings = pq.read_metadata(again.path).row_group(0).column(1).encodings
    assert any("DICTIONARY" in each for each in encodings) == coarse
    assert {total for _, _, total in told} == {size}
    done = [(what, done) for what, done, _ in told]
    assert done == sorted(done, key=lambda one: (one[0] != "read", one[1]))
    assert [what for what, _ in done].count("read") == 6
    assert done[5] == ("read", size) and done[-1] == ("measured", size)


def test_rejected_samples_are_empty_and_whole(path, run):
    path.write_text("t,ax,ay,az,gx,gy,gz,temp\n" + "0,1,2,3,4,5,6,7\n" * 9)
    done = run(path)
    assert done.quality["status"] == "rejected"
    assert pq.read_schema(done.path).equals(schema(True, {}))
    assert len(done.samples) == 0
    assert {str(kind) for kind in done.samples.dtypes} == {"float64"}


def test_a_stop_in_the_middle_leaves_the_old_file(path, run, monkeypatch, tmp_path):
    old = run(path)
    before = {p.name: p.read_bytes() for p in old.path.parent.iterdir()}
    assert set(before) == {"samples.parquet", "quality.json"}
    kept = convert.stamp_values
    calls = []

    def stop_later(column):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return kept(column)

    monkeypatch.setattr(convert, "stamp_values", stop_later)
    monkeypatch.setattr("imuloop.ingest.ingest.ROW_GROUP", 64)
    path.write_text(path.read_text().replace("9.8", "9.7"))
    with pytest.raises(KeyboardInterrupt):
        run(path, batch_rows=70)
    assert {p.name: p.read_bytes() for p in old.path.parent.iterdir()} == before


@pytest.mark.parametrize(
    ("declared", "text"),
    [
        ({"units": {"acceleration": "count"}}, r"needs nominal\.acceleration"),
        ({"units": {"acceleration": "ft/s^2"}}, r"'ft/s\^2' is not a unit of acceleration"),
        ({"units": {"time": "sec"}}, r"units\.time: 'sec' is not a unit; did you mean 's'\?"),
        ({"units": {"time": "ISO 8601"}}, "column 't' holds numbers"),
        ({"columns": {"time": "when"}}, "no column 'when'; there are t, ax"),
        ({"columns": {"time": None}}, "no time column"),
        ({"format": "parqet"}, r"'parqet' is not a format; did you mean 'parquet'\?"),
    ],
)
def test_wrong_declarations_stop_with_one_line(path, run, declared, text):
    with pytest.raises(ImuloopError, match=text) as caught:
        run(path, **declared)
    assert str(caught.value).startswith(f"imu/poses: {path}: ")
    assert "\n" not in str(caught.value)
    assert not list(path.parent.glob("out/*"))


def test_text_as_time_is_named(log, run, tmp_path):
    log["t"] = "morning"
    log.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(ImuloopError, match="'t' holds neither numbers nor ISO 8601"):
        run(tmp_path / "log.csv")


def test_missing_file_and_unknown_ending(run, tmp_path):
    with pytest.raises(ImuloopError, match="there is no such file"):
        run(tmp_path / "none.csv")
    (tmp_path / "log.xyz").write_text("")
    with pytest.raises(ImuloopError, match=r"log\.xyz does not say its format; add format: csv"):
        run(tmp_path / "log.xyz")


def test_quality_is_plain_json(path, run):
    done = run(path)
    text = (done.path.parent / "quality.json").read_text()
    assert json.loads(text, parse_constant=pytest.fail) == done.quality


def test_a_long_log_in_row_groups(log, run, tmp_path, monkeypatch):
    monkeypatch.setattr("imuloop.ingest.ingest.ROW_GROUP", 128)
    log.to_parquet(tmp_path / "log.parquet", index=False)
    done = run(tmp_path / "log.parquet", batch_rows=100)
    pd.testing.assert_frame_equal(done.samples, log, check_exact=True)
    file = pq.ParquetFile(done.path)
    assert [file.metadata.row_group(i).num_rows for i in range(4)] == [128, 128, 128, 116]
