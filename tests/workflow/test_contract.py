"""Every result file of a run, field by field, as users and tools rely on them."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.result_files import ALSO, SCHEMAS, fault
from imuloop import Calibration

CHANNELS = ("ax", "ay", "az", "gx", "gy", "gz")
COEFFICIENTS = ("Q", "N", "B", "K", "R")
VERDICTS = {"consistent", "explained", "partly_explained", "unexplained", "not_testable"}
STATUS = {"added", "rejected", "not_observable", "not_available", "confounded"}
RESIDUALS = {
    ("accelerometer", "poses"): {"gravity_norm": "m/s^2"},
    ("accelerometer", "static_record"): {"bias": "m/s^2"},
    ("gyroscope", "poses"): {"pose_rate": "rad/s", "rotation": "rad"},
    ("gyroscope", "static_record"): {"bias": "rad/s"},
}
EFFECTS = {
    "accelerometer": """bias_temperature scale_temperature bias_temperature_rate thermal_hysteresis
        warm_up bias_drift quadratic cubic asymmetry cross_coupling reorientation
        vibration_rectification lever_arm time_offset turn_on_bias gauss_markov sinusoid steps
        ramp""".split(),
    "gyroscope": """g_sensitivity g2_sensitivity bias_temperature scale_temperature
        bias_temperature_rate thermal_hysteresis warm_up bias_drift scale_nonlinearity
        scale_asymmetry earth_rate time_offset turn_on_bias gauss_markov sinusoid steps
        ramp""".split(),
}
ERRORS = ("before", "after", "in_sample_before", "in_sample_after")
# residuals of the rows of a table, with their components
ROWS = {
    "poses": {"gravity_norm": "", "pose_rate": "xyz"},
    "moves": {"rotation": "12"},
}
MEASURED = {
    "poses": (*CHANNELS, "temperature"),
    "moves": ("angle_rad", "speed_rad_s", "axis_x", "axis_y", "axis_z"),
}
DEVICES = ("posed", "resting")


def read(path):
    """Return the content of a JSON file that holds no NaN and no infinity."""
    return json.loads(Path(path).read_text(), parse_constant=pytest.fail)


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and np.isfinite(value)


def check_quality(path):
    quality = read(path)
    assert quality["status"] in ("ok", "rejected")
    assert all(isinstance(reason, str) and reason for reason in quality["reasons"])
    assert bool(quality["reasons"]) == (quality["status"] == "rejected")
    assert isinstance(quality["rows"], int)
    assert is_number(quality["duration_s"])
    assert {"jitter", "gaps", "duplicates", "non_finite", "clipped", "constant"} <= set(quality)
    if quality["status"] == "ok":
        assert quality["duration_s"] == pytest.approx(
            (quality["rows"] - 1) / quality["rate_hz"] + quality["gaps"]["total_s"], rel=0.02
        )
    assert isinstance(quality["duplicates"], int)
    assert isinstance(quality["non_finite"], int)
    assert set(quality["clipped"]) == set(CHANNELS)
    assert set(quality["constant"]) <= set(CHANNELS)
    return quality


def check_samples(path, quality):
    table = pq.read_table(path)
    logged = ["t", *CHANNELS, *(["temperature"] if "temperature" in table.column_names else [])]
    assert table.column_names == logged
    assert {str(column.type) for column in table.schema} == {"double"}
    assert len(table) == (quality["rows"] if quality["status"] == "ok" else 0)
    metadata = json.loads(table.schema.metadata[b"imuloop"])
    assert {"source", "units", "sha256"} <= set(metadata)
    assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest in metadata["sha256"].values())
    t = table["t"].to_numpy()
    if len(t):
        assert t[0] == 0
        assert (np.diff(t) > 0).all()
        assert t[-1] == pytest.approx(quality["duration_s"])
    return table


def check_segments(path, samples):
    table = pq.read_table(path)
    channels = [name for name in samples.column_names if name != "t"]
    assert {"start_s", "end_s", "kind"} <= set(table.column_names)
    assert {f"{c}_{what}" for c in channels for what in ("mean", "std")} <= set(table.column_names)
    assert set(table["kind"].to_pylist()) <= {"static", "motion", "disturbed", "gap"}
    start, end = table["start_s"].to_numpy(), table["end_s"].to_numpy()
    assert (start < end).all()
    # nothing is dropped: the segments cover the log without overlap
    assert (start[1:] == end[:-1]).all()
    t = samples["t"].to_numpy()
    assert len(table) or not len(t)
    for row in table.to_pylist():
        if row["kind"] == "static":
            inside = (t >= row["start_s"]) & (t < row["end_s"])
            for c in channels:
                values = samples[c].to_numpy()[inside]
                assert row[f"{c}_mean"] == pytest.approx(values.mean(), rel=1e-9, abs=1e-12)
                # with or without Bessel's correction
                assert row[f"{c}_std"] == pytest.approx(values.std(), rel=1 / len(values))
    return table


def check_allan(path):
    table = pq.read_table(path)
    names = ["axis", "tau_s", "adev", "ci_low", "ci_high", "edf", "stage"]
    assert table.column_names == names
    assert set(table["stage"].to_pylist()) <= {"raw", "corrected"}
    assert set(table["axis"].to_pylist()) <= set(CHANNELS)
    tau, adev, low, high, edf = (table[name].to_numpy() for name in names[1:6])
    assert (tau > 0).all()
    assert (low <= adev).all()
    assert (adev <= high).all()
    assert (edf > 0).all()
    return len(table)


def check_coefficient(content, measured):
    assert set(content) == {"value", "ci95", "upper95", "identifiable", "needed_s"}
    assert isinstance(content["identifiable"], bool)
    assert content["needed_s"] is None or (
        not content["identifiable"] and is_number(content["needed_s"])
    )
    assert is_number(content["upper95"]) or not measured
    assert (content["value"] is not None) == content["identifiable"]
    if content["identifiable"]:
        low, high = content["ci95"]
        assert 0 <= low <= content["value"] <= high


def check_noise(path, device):
    noise = read(path)
    assert (noise["format"], noise["device"]) == (1, device)
    assert tuple(noise["axes"]) == CHANNELS
    for name, axis in noise["axes"].items():
        assert {*COEFFICIENTS, "gauss_markov", "sinusoid"} == set(axis)
        measured = any(axis[term]["upper95"] is not None for term in COEFFICIENTS)
        for term in COEFFICIENTS:
            check_coefficient(axis[term], measured)
        for line in axis["sinusoid"]:
            assert isinstance(line.pop("origin"), str | None), name
        for parts, keys in (("gauss_markov", "q tc"), ("sinusoid", "amplitude frequency")):
            for part in axis[parts]:
                assert set(part) == set(keys.split()), name
                for coefficient in part.values():
                    check_coefficient(coefficient, True)


def check_calibration(path, device, samples):
    content = read(path)
    assert (content["format"], content["device"]) == (1, device)
    assert 9.7 < content["gravity"] < 9.9
    calibrated = Calibration.from_json(path).apply(samples) if len(samples) else None
    for sensor, units, channels in (
        ("accelerometer", ("m/s^2", "g", "mg", "count"), CHANNELS[:3]),
        ("gyroscope", ("rad/s", "deg/s", "mrad/s", "deg/h", "count"), CHANNELS[3:]),
    ):
        one = content[sensor]
        assert one["raw_unit"] in units
        T, K, b = (np.array(one[key]) for key in "TKb")
        assert (T.shape, K.shape, b.shape) == ((3, 3), (3,), (3,))
        assert (np.diag(T) == 1).all()
        assert sensor == "gyroscope" or not np.tril(T, -1).any()
        names, matrix = one["covariance"]["names"], np.array(one["covariance"]["matrix"])
        added = [name for effect in one["effects"] for name in effect["parameters"]]
        allowed = r"T[012][012]|[Kb][012]"
        assert all(re.fullmatch(allowed, name) or name.split(".")[-1] in added for name in names)
        assert matrix.size == len(names) ** 2
        if names:
            assert (matrix == matrix.T).all() or np.allclose(matrix, matrix.T, rtol=1e-9)
            assert (np.diag(matrix) > 0).all()
        for effect in one["effects"]:
            assert effect["name"] in EFFECTS[sensor]
            assert set(effect) == {"name", "constants", "parameters", "std", "range"}
            assert set(effect["range"]) <= set(effect["parameters"])
            assert set(effect["parameters"]) == set(effect["std"])
        if calibrated is not None and not one["effects"]:
            # the model as the contract has it, from the file alone
            raw = samples[list(channels)].to_numpy() / one["raw_scale"] + one["raw_offset"]
            expected = (T @ np.diag(K) @ (raw - b).T).T
            np.testing.assert_allclose(calibrated[list(channels)], expected, atol=1e-9)


def check_diagnosis(path, device):
    content = read(path)
    assert (content["format"], content["device"]) == (1, device)
    assert set(content["sensors"]) == {"accelerometer", "gyroscope"}
    for sensor, data in content["sensors"].items():
        assert set(data) == {"poses", "static_record"}
        for kind, found in data.items():
            assert found["verdict"] in VERDICTS
            units = RESIDUALS[sensor, kind]
            if found["verdict"] == "not_testable":
                assert found["why"]
            else:
                assert {key: r["unit"] for key, r in found["residuals"].items()} == units
            for residual in found["residuals"].values():
                fields = ("n", "floor", "before", "after", "chi2_before", "chi2_after")
                assert all(is_number(residual[field]) for field in fields), (sensor, kind)
                low, high = residual.get("floor_range", [residual["floor"]] * 2)
                assert low <= residual["floor"] <= high
            for effect in found["effects"]:
                assert effect["name"] in EFFECTS[sensor]
                assert set(effect["parameters"]) == set(effect["std"]) != set()
                assert 0 <= effect["p_value"] <= 1
                assert effect["heldout_after"] < effect["heldout_before"]
                low, high = effect["ratio_ci95"]
                assert low <= effect["heldout_after"] / effect["heldout_before"] <= high
            for candidate in found["candidates"]:
                assert candidate["name"] in EFFECTS[sensor]
                assert candidate["status"] in STATUS
                assert candidate["why"]
                if candidate["status"] in ("added", "rejected"):
                    assert 0 <= candidate["p_value"] <= 1
                    assert is_number(candidate["heldout_after"])
                    assert candidate["detection_limit"]
            added = {c["name"] for c in found["candidates"] if c["status"] == "added"}
            assert added == {effect["name"] for effect in found["effects"]}


def check_poses_and_moves(folder, kinds):
    """Check both tables; `kinds` has the kind of each session."""
    found = read(folder / "diagnosis.json")["sensors"]
    told = {k: r for each in found.values() for k, r in each["poses"]["residuals"].items()}
    tables = {name: pq.read_table(folder / f"{name}.parquet") for name in ROWS}
    for name, table in tables.items():
        errors = [
            column
            for kind, parts in ROWS[name].items()
            for column in (
                *(f"{kind}_{e}{p}" for e in ERRORS for p in ("", *(f"_{p}" for p in parts))),
                f"{kind}_floor",
            )
        ]
        columns = ["session", "pose", "start_s", "end_s", *MEASURED[name], *errors]
        assert table.column_names == columns
        types = ["large_string", "int64"] + ["double"] * (len(columns) - 2)
        assert [str(column.type) for column in table.schema] == types
        rows = table.to_pandas()
        assert (rows["start_s"] < rows["end_s"]).all()
        for kind in ROWS[name]:
            values = rows[rows["session"].map(kinds) == "multi_position"]
            for when in (*ERRORS, "floor"):
                error = values[f"{kind}_{when}"]
                if kind not in told:
                    assert error.isna().all()
                    continue
                assert np.sqrt((error**2).mean()) == pytest.approx(told[kind][when], rel=1e-9)
                assert len(error) == told[kind]["n"]
    poses, moves = (table.to_pandas() for table in tables.values())
    for session, kind in kinds.items():
        segments = pq.read_table(folder / session / "segments.parquet").to_pandas()
        rests = segments[segments["pose"] >= 0].groupby("pose")
        own = poses[poses["session"] == session].reset_index()
        assert len(own) == (len(rests) if kind != "static" else 0)
        if len(own):
            assert list(own["pose"]) == list(range(len(own)))
            np.testing.assert_array_equal(own["start_s"], rests["start_s"].min())
            np.testing.assert_array_equal(own["end_s"], rests["end_s"].max())
            for channel in CHANNELS:
                means = rests[f"{channel}_mean"]
                assert (own[channel] >= means.min().to_numpy() - 1e-12).all()
                assert (own[channel] <= means.max().to_numpy() + 1e-12).all()
        turned = moves[moves["session"] == session]
        # a move lies between its pose and the next
        assert set(turned["pose"]) <= set(range(len(own) - 1))
        for move in turned.itertuples():
            assert own["end_s"][move.pose] == pytest.approx(move.start_s, abs=0.1)
            assert own["start_s"][move.pose + 1] == pytest.approx(move.end_s, abs=0.1)
    assert (moves["angle_rad"] >= 0).all()
    assert np.isfinite(moves[list(MEASURED["moves"])]).to_numpy().all()


def check_attitude(path, device):
    content, series = read(path), pq.read_table(path.with_suffix(".parquet")).to_pandas()
    assert (content["format"], content["device"]) == (1, device)
    assert {"session", "method", "model", "t_s", "at", "error_deg"} <= set(series)
    if content["status"] == "not_testable":
        assert content["why"]
        assert not len(series)
        return
    assert content["status"] == "ok"
    assert set(content["gains"]) == {"k_P", "k_I"}
    for methods in (content["methods"], *content["sessions"].values()):
        for method in ("rotation", "stretch", "mahony"):
            found = methods[method]
            for errors in found["models"].values():
                assert set(errors) == {"rms_deg", "median_deg", "p95_deg"}
                assert all(map(is_number, errors.values()))
            assert set(found["models"]) == {"raw", "base", "final"} == set(series["model"])
            assert found["ratio_ci95"][0] <= found["base_over_final"] <= found["ratio_ci95"][1]
    assert is_number(content["methods"]["rotation"]["floor_deg"])


def check_device(folder, device, sessions):
    """Check everything that the contract says of one device's folder of results.

    `sessions` has the kind of each session by its name.
    """
    assert sessions
    logs = []
    for session in sessions:
        quality = check_quality(folder / session / "quality.json")
        samples = check_samples(folder / session / "samples.parquet", quality)
        check_segments(folder / session / "segments.parquet", samples)
        check_allan(folder / session / "allan.parquet")
        logs.append(samples.to_pandas())
    check_noise(folder / "noise.json", device)
    for name in ("six_position", "multi_position", "calibration"):
        check_calibration(folder / f"{name}.json", device, max(logs, key=len))
    check_diagnosis(folder / "diagnosis.json", device)
    check_poses_and_moves(folder, sessions)
    check_attitude(folder / "attitude.json", device)


@pytest.mark.parametrize("device", DEVICES)
def test_every_json_file_of_a_device_fits_its_schema(finished, device):
    paths = list((finished[0] / "results" / device).rglob("*.json"))
    assert {ALSO.get(p.stem, p.stem) for p in paths} | {"config", "common"} == {
        path.name.partition(".")[0] for path in SCHEMAS.glob("*.yaml")
    }
    assert {str(p): wrong for p in paths if (wrong := fault(p))} == {}


@pytest.mark.parametrize("device", DEVICES)
def test_every_field_of_a_device_is_as_the_contract_says(finished, config, device):
    folder, _ = finished
    sessions = config["devices"][device]["sessions"]
    kinds = {name: session["kind"] for name, session in sessions.items()}
    check_device(folder / "results" / device, device, kinds)


def test_comparison_has_a_row_a_device_and_units_in_its_header(finished):
    folder, _ = finished
    with open(folder / "results/comparison.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["device"] for row in rows] == list(DEVICES)
    unitless = re.compile("device|label|status|why|simulated|.*_verdict")
    for name in rows[0]:
        assert unitless.fullmatch(name) or re.search(r" \[[^\]]+\]$", name), name
    for row in rows:
        for name, value in row.items():
            if not unitless.fullmatch(name) and value:
                assert np.isfinite(float(value)), name


@pytest.mark.parametrize("device", DEVICES)
def test_the_calibration_can_be_taken_away(finished, device):
    folder = finished[0] / f"results/{device}/exports"
    names = {path.name for path in folder.glob("[!.]*")}
    listed = re.findall(r"^(\S+\.\w+)(: | \()", (folder / "README.txt").read_text(), re.M)
    assert {name for name, mark in listed if mark == ": "} == names - {"README.txt"}
    assert {"kalibr_imu.yaml", "imu_tk_gyro.calib"} <= names


def test_report_is_one_file_that_needs_no_other(finished):
    folder, _ = finished
    report = (folder / "results/report.html").read_text()
    loaded = re.findall(r"""(?:src|href|xlink:href)=["']([^"'#][^"']*)|url\(([^)#]+)\)""", report)
    outside = [link for link in map("".join, loaded) if not re.match("data:|https?:", link)]
    # links to the figures' numbers may lie beside the report; nothing is loaded
    assert not [link for link in outside if not (folder / "results" / link).exists()]
    assert not re.search(r"<(?:script|img|link|iframe)\b[^>]*(?:src|href)=[\"']https?:", report)
