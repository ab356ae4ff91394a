"""Verdicts on the measured devices do not hang on what should not matter."""

import json
import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from imuloop import chain
from imuloop.config import resolve
from imuloop.core.units import DEGREE

DEVICES = ("xsens_mti", "mpu9150_1")
TURNED = {"ax": "ay", "ay": "az", "az": "ax", "gx": "gy", "gy": "gz", "gz": "gx"}


def as_logged(table, segments):
    return table


def axes_permuted(table, segments):
    columns = {name: table[TURNED.get(name, name)] for name in table.column_names}
    return pa.table(columns).replace_schema_metadata(table.schema.metadata)


def another_unit(table, segments):
    about = json.loads(table.schema.metadata[b"imuloop"])
    about["raw_units"] = {
        "acceleration": {"name": "g", "scale": 9.80665, "offset": 0.0},
        "angular_rate": {"name": "deg/s", "scale": DEGREE, "offset": 0.0},
    }
    changed = {b"imuloop": json.dumps(about).encode()}
    return table.replace_schema_metadata(table.schema.metadata | changed)


def one_pose_less(table, segments):
    last = max(r["start_s"] for r in segments.to_pylist() if r["kind"] == "static")
    return table.filter(pa.array(table["t"].to_numpy() < last))


def diagnosed(measured, settings, name, folder, change, **segment):
    """Return verdict and effects of both sensors at the poses, the log or a setting changed."""
    source = measured.folder / name / "poses"
    (folder / "poses").mkdir(parents=True)
    shutil.copy(source / "quality.json", folder / "poses")
    segments = pq.read_table(source / "segments.parquet")
    table = change(pq.read_table(source / "samples.parquet"), segments)
    pq.write_table(table, folder / "poses/samples.parquet")
    own = {key: settings[key] for key in ("gravity", "diagnose")}
    device = chain.Device(name, folder, {"poses": "multi_position"}, **own, segment=segment)
    for stage in (chain.segment, chain.noise, chain.calibrate, chain.diagnose):
        assert stage(device) == []
    found = json.loads(device.file("diagnosis.json").read_text())["sensors"]
    return {
        sensor: (parts["poses"]["verdict"], [e["name"] for e in parts["poses"]["effects"]])
        for sensor, parts in found.items()
    }


@pytest.mark.parametrize("name", DEVICES)
def test_verdicts_are_stable(measured, repository, tmp_path, monkeypatch, name):
    # what takes longest, and is no part of a verdict
    monkeypatch.setattr("imuloop.diagnose.content.detection_limits", lambda *a, **k: {})
    config = yaml.safe_load((repository / "config/measured.yaml").read_text())
    settings = resolve(config)[name]
    changes = {
        "axes": (axes_permuted, {}),
        "unit": (another_unit, {}),
        "less": (one_pose_less, {}),
        "short": (as_logged, {"window_s": 0.7}),
        "long": (as_logged, {"window_s": 1.3}),
    }
    expected = diagnosed(measured, settings, name, tmp_path / "plain", as_logged)
    for label, (change, segment) in changes.items():
        found = diagnosed(measured, settings, name, tmp_path / label, change, **segment)
        assert found == expected, label
