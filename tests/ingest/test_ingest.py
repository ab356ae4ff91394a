"""One call: files written in one step, errors of one line, provenance."""

import hashlib

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import schema
from imuloop.ingest.stamps import NANOSECONDS


@pytest.fixture
def path(log, tmp_path):
    log.to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv"


def test_provenance(path, run):
    source = {"log": {"url": "https://example.org/log.csv", "sha256": "ab"}}
    done = run(path, sources=source)
    assert done.metadata == {
        "device": "imu",
        "session": "poses",
        "kind": "multi_position",
        "log_format": "csv",
        "source": source,
        "sha256": {"log.csv": hashlib.sha256(path.read_bytes()).hexdigest()},
        "units": {"time": "s", "acceleration": "m/s^2", "angular_rate": "rad/s"},
        "raw_units": {
            "acceleration": {"name": "m/s^2", "scale": 1.0, "offset": 0.0},
            "angular_rate": {"name": "rad/s", "scale": 1.0, "offset": 0.0},
        },
        "declared": {},
        "sensor_ids": {},
        "simulated": False,
        "start": None,
    }
    for key, value in done.metadata.items():
        assert done.quality[key] == value
    fields = pq.read_schema(done.path)
    assert fields.equals(schema(False, {}))


def test_threads_change_nothing(log, path, run, monkeypatch):
    monkeypatch.setattr("imuloop.ingest.ingest.ROW_GROUP", 1000)
    log = pd.concat([log] * 12, ignore_index=True).assign(t=np.arange(6000) / 100)
    log.to_csv(path, index=False)
    first = run(path, batch_rows=500)
    again = run(path, batch_rows=500, threads=2)
    assert again.quality == first.quality
    assert again.path.read_bytes() == first.path.read_bytes()
    pd.testing.assert_frame_equal(again.samples, log)


def test_a_stop_in_the_middle_leaves_the_old_file(path, run, monkeypatch):
    old = run(path)
    before = {p.name: p.read_bytes() for p in old.path.parent.iterdir()}
    assert set(before) == {"samples.parquet", "quality.json"}
    kept = pq.ParquetWriter.write_table
    calls = []

    def stop_later(*args, **kwargs):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return kept(*args, **kwargs)

    monkeypatch.setattr(pq.ParquetWriter, "write_table", stop_later)
    monkeypatch.setattr("imuloop.ingest.ingest.ROW_GROUP", 64)
    path.write_text(path.read_text().replace("9.8", "9.7"))
    with pytest.raises(KeyboardInterrupt):
        run(path)
    assert {p.name: p.read_bytes() for p in old.path.parent.iterdir()} == before


@pytest.mark.parametrize(
    ("declared", "text"),
    [
        ({"units": {"acceleration": "count"}}, r"needs nominal\.acceleration"),
        ({"units": {"acceleration": "mi/h^2"}}, r"'mi/h\^2' is not a unit of acceleration"),
        ({"units": {"time": "sec"}}, r"units\.time: 'sec' is not a unit; did you mean 's'\?"),
        ({"units": {"time": "ISO 8601"}}, "column 't' holds numbers"),
        ({"columns": {"time": "when"}}, "no column 'when'; there are t, ax"),
        ({"format": "parqet"}, r"'parqet' is not a format; did you mean 'parquet'\?"),
    ],
)
def test_wrong_declarations_stop_with_one_line(path, run, declared, text):
    with pytest.raises(ImuloopError, match=text) as caught:
        run(path, **declared)
    assert str(caught.value).startswith(f"imu/poses: {path}: ")
    assert "\n" not in str(caught.value)
    assert not list(path.parent.glob("out/*"))


def test_stamps_that_are_too_large(log, path, run):
    """One is a missing stamp; where there are no others, the log is rejected."""
    for stamp in ("9999-12-31T23:59:{:06.3f}", "7" * 400 + "{:.2f}", "7" * 400 + "{:.0f}"):
        far = [stamp.format(t) for t in log.t]
        log.assign(t=far).to_csv(path, index=False)
        [reason] = run(path).quality["reasons"]
        assert reason.startswith("time column 't': its stamps, as ")
        near = [f"2024-01-01T00:00:{t:06.3f}" if "T" in stamp else f"{t:.2f}" for t in log.t]
        log.assign(t=[*near[:9], far[9], *near[10:]]).to_csv(path, index=False)
        done = run(path)
        assert (done.quality["status"], done.quality["non_finite"]) == ("ok", 1)


@pytest.mark.parametrize(
    ("header", "units", "logged"),
    [
        ("t,ax [furlong],ay [furlong],az [furlong],gx,gy,gz", {"acceleration": "m/s^2"}, "furlong"),
        ("t,ax,ay,az,gx [rph],gy [rph],gz [rph]", {"angular_rate": "rad/s"}, "rph"),
        ("t [week],ax,ay,az,gx,gy,gz", {"time": "s"}, "week"),
        ("t [UTC],ax,ay,az,gx,gy,gz", {"time": "s"}, "UTC"),
    ],
)
def test_a_unit_that_is_not_known_is_an_error_unless_declared(path, run, header, units, logged):
    [(quantity, unit)] = units.items()
    path.write_text("\n".join([header, *path.read_text().splitlines()[1:]]))
    with pytest.raises(
        ImuloopError, match=rf"log\.csv: units\.{quantity}: the log says '{logged}'"
    ):
        run(path)
    quality = run(path, units=units).quality
    assert f"units.{quantity} is {unit}, the log says {logged}; {unit} used" in quality["warnings"]


@pytest.mark.parametrize("sentinel", [-(2**63), 2**63 - 1])
@pytest.mark.parametrize("row", [0, 250])
def test_a_stamp_that_stands_for_none(log, path, run, sentinel, row):
    """Differences from it are more than 64 bits hold."""
    log["t"] = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(500)
    log.loc[row, "t"] = sentinel
    log.to_csv(path, index=False)
    done = run(path, units={"time": "ns"})
    assert (done.quality["status"], done.quality["non_finite"]) == ("ok", 1)
    first = 1 if row == 0 else 0
    kept = np.delete(np.arange(500), row) - first
    np.testing.assert_array_equal(done.samples.t, kept * 10_000_000 * 1e-9)


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_unix_time_in_a_finer_unit_than_declared_is_named(log, run, unit):
    # as s they are millennia ahead, and so many rows of a log at rest would show nothing wrong
    log["t"] = np.round((log["t"] + 1.7e9) * NANOSECONDS["s"] / NANOSECONDS[unit]).astype("int64")
    found = run(log).quality
    assert found["status"] == "rejected"
    [reason] = found["reasons"]
    assert f"in {unit} it is 2023-11-14" in reason and reason.endswith(f"units.time: {unit}")
    assert run(log, units={"time": unit}).quality["status"] == "ok"


def test_a_counter_of_days_is_no_unix_time(log, run):
    log["t"] += 400 * 86400
    assert run(log).quality["status"] == "ok"


def test_a_time_of_the_day_goes_on_after_midnight(log, run, tmp_path):
    ms = np.round(log["t"] * 1000).astype(int) + 86_397_000
    day = pd.to_datetime(ms % 86_400_000, unit="ms").dt.strftime("%H:%M:%S.%f").str[:-3]
    log.assign(t=day).to_csv(tmp_path / "log.csv", index=False)
    done = run(tmp_path / "log.csv")
    np.testing.assert_allclose(done.samples["t"], log["t"], atol=1e-9)
    assert done.quality["clock"]["rollovers"] == 1
