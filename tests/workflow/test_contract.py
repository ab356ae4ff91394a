"""Every result file of a run, as users and tools rely on them; JSON files by their schemas."""

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from imuloop import Calibration
from imuloop.model.effect import Effect
from result_files import ALSO, SCHEMAS, fault
from workflow.conftest import CONFIG

CHANNELS = ("ax", "ay", "az", "gx", "gy", "gz")
RESIDUALS = {
    ("accelerometer", "poses"): {"gravity_norm": "m/s^2"},
    ("accelerometer", "static_record"): {"bias": "m/s^2"},
    ("gyroscope", "poses"): {"pose_rate": "rad/s", "rotation": "rad"},
    ("gyroscope", "static_record"): {"bias": "rad/s"},
    ("accelerometer", "motion"): {"velocity_vertical": "m/s", "velocity_horizontal": "m/s"},
    ("gyroscope", "motion"): {"velocity_vertical": "m/s", "velocity_horizontal": "m/s"},
}
ERRORS = ("before", "after", "in_sample_before", "in_sample_after")
# residuals of the rows of a table with their components, and measured values
ROWS = {
    "poses": ({"gravity_norm": "", "pose_rate": "xyz"}, (*CHANNELS, "temperature")),
    "moves": (
        {"rotation": "12", "velocity_vertical": "", "velocity_horizontal": "12"},
        ("angle_rad", "speed_rad_s", "axis_x", "axis_y", "axis_z"),
    ),
}
DEVICES = ("posed", "resting")


def effects(sensor):
    return {name for name, effect in Effect.library.items() if sensor in effect.sensors}


@pytest.fixture(params=DEVICES)
def folder(finished_run, request):
    return finished_run[0] / "results" / request.param


@pytest.fixture
def kinds(folder):
    sessions = CONFIG["devices"][folder.name]["sessions"]
    return {name: session["kind"] for name, session in sessions.items()}


def read(path):
    return json.loads(path.read_text())


def test_every_json_file_fits_its_schema(folder):
    paths = list(folder.rglob("*.json"))
    expected = {path.name.partition(".")[0] for path in SCHEMAS.glob("*.yaml")}
    expected -= {"config", "common", "family", "sensors"}
    assert {ALSO.get(p.stem, p.stem) for p in paths} == expected
    assert {str(p): wrong for p in paths if (wrong := fault(p))} == {}


def test_samples_are_those_that_the_quality_counts(folder, kinds):
    for session in kinds:
        quality = read(folder / session / "quality.json")
        table = pq.read_table(folder / session / "samples.parquet")
        assert table.column_names in (["t", *CHANNELS], ["t", *CHANNELS, "temperature"])
        assert {str(column.type) for column in table.schema} == {"double"}
        assert {"source", "units", "sha256"} <= set(json.loads(table.schema.metadata[b"imuloop"]))
        assert bool(quality["reasons"]) == (quality["status"] == "rejected")
        if quality["status"] == "rejected":
            assert len(table) == 0
            continue
        t, seconds = table["t"].to_numpy(), quality["duration_s"]
        assert len(t) == quality["rows"] and t[0] == 0 and (np.diff(t) > 0).all()
        assert t[-1] == pytest.approx(seconds)
        expected = (len(t) - 1) / quality["rate_hz"] + quality["gaps"]["total_s"]
        assert seconds == pytest.approx(expected, rel=0.02)


def test_segments_cover_the_log_and_hold_its_statistics(folder, kinds):
    for session in kinds:
        samples = pd.read_parquet(folder / session / "samples.parquet")
        table = pd.read_parquet(folder / session / "segments.parquet")
        assert len(table) or not len(samples)
        assert set(table["kind"]) <= {"static", "motion", "disturbed", "gap"}
        start, end = table["start_s"].to_numpy(), table["end_s"].to_numpy()
        assert (start < end).all() and (start[1:] == end[:-1]).all()
        for row in table[table["kind"] == "static"].to_dict("records"):
            inside = samples[(samples["t"] >= row["start_s"]) & (samples["t"] < row["end_s"])]
            for name in samples.columns[1:]:
                assert row[f"{name}_mean"] == pytest.approx(inside[name].mean(), rel=1e-9)
                assert row[f"{name}_std"] == pytest.approx(inside[name].std(ddof=0), rel=1e-6)


@pytest.mark.parametrize("name", ["six_position", "multi_position", "calibration"])
def test_a_calibration_is_the_model_that_its_file_holds(folder, kinds, name):
    content = read(folder / f"{name}.json")
    logs = [pd.read_parquet(folder / session / "samples.parquet") for session in kinds]
    samples = max(logs, key=len)
    calibrated = Calibration.from_json(folder / f"{name}.json").apply(samples, nominal=True)
    for sensor, channels in (("accelerometer", CHANNELS[:3]), ("gyroscope", CHANNELS[3:])):
        one = content[sensor]
        T, K, b = (np.array(one[key]) for key in "TKb")
        assert sensor == "gyroscope" or not np.tril(T, -1).any()
        assert {effect["name"] for effect in one["effects"]} <= effects(sensor)
        if not one["effects"]:
            raw = samples[list(channels)].to_numpy() / one["raw_scale"] + one["raw_offset"]
            expected = (T @ np.diag(K) @ (raw - b).T).T
            np.testing.assert_allclose(calibrated[list(channels)], expected, atol=1e-9)


def test_the_diagnosis_names_residuals_effects_and_candidates(folder):
    for sensor, data in read(folder / "diagnosis.json")["sensors"].items():
        for kind, block in data.items():
            if block["verdict"] == "not_testable":
                assert block["why"]
                continue
            units = {key: r["unit"] for key, r in block["residuals"].items()}
            assert units == RESIDUALS[sensor, kind]
            for effect in block["effects"]:
                assert effect["heldout_after"] < effect["heldout_before"]
                low, high = effect["ratio_ci95"]
                assert low <= effect["heldout_after"] / effect["heldout_before"] <= high
            candidates = {c["name"]: c for c in block["candidates"]}
            assert set(candidates) <= effects(sensor)
            for candidate in candidates.values():
                assert candidate["why"]
                if candidate["status"] in ("added", "rejected"):
                    assert candidate["detection_limit"]
            added = {name for name, c in candidates.items() if c["status"] == "added"}
            assert added == {effect["name"] for effect in block["effects"]}


def test_poses_and_moves_have_the_errors_that_the_diagnosis_sums_up(folder, kinds):
    sensors = read(folder / "diagnosis.json")["sensors"]
    residuals = {
        k: r
        for sensor in sensors.values()
        for record in ("poses", "motion")
        for k, r in sensor[record]["residuals"].items()
    }
    tables = {name: pd.read_parquet(folder / f"{name}.parquet") for name in ROWS}
    for name, rows in tables.items():
        residual_parts, measured = ROWS[name]
        errors = [
            column
            for kind, parts in residual_parts.items()
            for column in (
                *(f"{kind}_{e}{p}" for e in ERRORS for p in ("", *(f"_{p}" for p in parts))),
                f"{kind}_floor",
            )
        ]
        place = ["session", "pose", "start_s", "end_s"]
        assert [c for c in rows if c != "knock_m_s"] == [*place, *measured, *errors]
        posed = rows[rows["session"].map(kinds) == "multi_position"]
        for kind in residual_parts:
            for when in (*ERRORS, "floor"):
                error = posed[f"{kind}_{when}"].dropna()
                # a move with a knock has no velocity
                assert len(error) == (residuals[kind]["n"] if kind in residuals else 0)
                if len(error):
                    root_mean_square = np.sqrt((error**2).mean())
                    assert root_mean_square == pytest.approx(residuals[kind][when], rel=1e-9)
    poses, moves = tables.values()
    for session, kind in kinds.items():
        segments = pd.read_parquet(folder / session / "segments.parquet")
        rests = segments[segments["pose"] >= 0].groupby("pose")
        rests_of = poses[poses["session"] == session].reset_index()
        assert list(rests_of["pose"]) == list(range(len(rests) if kind != "static" else 0))
        # a move lies between its pose and the next
        for move in moves[moves["session"] == session].itertuples():
            assert rests_of["end_s"][move.pose] == pytest.approx(move.start_s, abs=0.1)
            assert rests_of["start_s"][move.pose + 1] == pytest.approx(move.end_s, abs=0.1)


def test_the_attitude_has_a_series_of_each_model(folder):
    content = read(folder / "attitude.json")
    series = pd.read_parquet(folder / "attitude.parquet")
    assert {"session", "method", "model", "t_s", "at", "error_deg"} <= set(series)
    assert bool(content.get("why")) == (content["status"] == "not_testable") == (not len(series))
    for method in content.get("methods", {}).values():
        assert set(method["models"]) == {"raw", "base", "final"} == set(series["model"])
        assert method["ratio_ci95"][0] <= method["base_over_final"] <= method["ratio_ci95"][1]
