"""Verdicts on the measured devices do not hang on what should not matter."""

import json
import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.chain import Device
from imuloop.core.units import DEGREE
from published.measured import devices
from quick import verdicts

DEVICES = ("xsens_mti", "mpu9150_1")
TURNED = {"ax": "ay", "ay": "az", "az": "ax", "gx": "gy", "gy": "gz", "gz": "gx"}


def as_logged(table, segments):
    return table


def other_axes_and_unit(table, segments):
    columns = {name: table[TURNED.get(name, name)] for name in table.column_names}
    about = json.loads(table.schema.metadata[b"imuloop"])
    about["raw_units"] = {
        "acceleration": {"name": "g", "scale": 9.80665, "offset": 0.0},
        "angular_rate": {"name": "deg/s", "scale": DEGREE, "offset": 0.0},
    }
    changed = {b"imuloop": json.dumps(about).encode()}
    return pa.table(columns).replace_schema_metadata(table.schema.metadata | changed)


def one_pose_less(table, segments):
    last = max(r["start_s"] for r in segments.to_pylist() if r["kind"] == "static")
    return table.filter(pa.array(table["t"].to_numpy() < last))


def diagnose_change(measured, name, folder, change, **segment):
    """Return verdict and effects of both sensors at the poses, the log or a setting changed."""
    source = measured.of(name) / "poses"
    (folder / "poses").mkdir(parents=True)
    shutil.copy(source / "quality.json", folder / "poses")
    segments = pq.read_table(source / "segments.parquet")
    table = change(pq.read_table(source / "samples.parquet"), segments)
    pq.write_table(table, folder / "poses/samples.parquet")
    settings = {key: devices()[name][key] for key in ("gravity", "diagnose")}
    kinds = {"poses": "multi_position"}
    return verdicts_of(verdicts(Device(name, folder, kinds, **settings, segment=segment)))


def verdicts_of(sensors):
    return {
        sensor: (parts["poses"]["verdict"], [e["name"] for e in parts["poses"]["effects"]])
        for sensor, parts in sensors.items()
    }


@pytest.mark.study
@pytest.mark.parametrize("name", DEVICES)
@pytest.mark.parametrize(
    ("change", "segment"),
    [(other_axes_and_unit, {}), (one_pose_less, {}), (as_logged, {"window_s": 1.3})],
)
def test_verdicts_are_stable(measured_results, tmp_path, name, change, segment):
    expected = verdicts_of(measured_results.json(name, "diagnosis")["sensors"])
    assert diagnose_change(measured_results, name, tmp_path, change, **segment) == expected
