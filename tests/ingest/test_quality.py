"""Quality figures against logs with faults of known size."""

from functools import partialmethod

import numpy as np
import pytest

from imuloop.core.samples import Samples


@pytest.fixture
def measured(log, run):
    def call(**declared):
        return run(log, **declared).quality

    return call


def test_a_good_log(measured):
    found = measured()
    assert (found["status"], found["reasons"], found["warnings"]) == ("ok", [], [])
    assert (found["rows"], found["gaps"]["count"]) == (500, 0)
    assert found["duration_s"] == pytest.approx(4.99)
    assert found["rate_hz"] == pytest.approx(100)
    assert found["jitter"]["max_s"] < 1e-12
    assert found["constant"] == []
    assert found["mean_specific_force"] == pytest.approx(9.8025, abs=2e-3)


def test_gaps_and_rate_beside_them(log, measured):
    log.loc[100:, "t"] += 0.5
    log.loc[300:, "t"] += 0.01
    found = measured()
    assert found["rate_hz"] == pytest.approx(100)
    assert found["gaps"]["count"] == 2
    assert found["gaps"]["total_s"] == pytest.approx(0.53)
    assert found["gaps"]["list"][0]["start_s"] == pytest.approx(0.99)
    assert found["gaps"]["list"][0]["duration_s"] == pytest.approx(0.51)
    assert found["gaps"]["list"][1]["duration_s"] == pytest.approx(0.02)
    assert found["warnings"] == ["2 gaps, 0.53 s together"]


def test_figures_over_pieces_are_those_of_one(log, measured, monkeypatch):
    log.loc[100:, "t"] += 0.5
    whole = measured()
    monkeypatch.setattr(Samples, "pieces", partialmethod(Samples.pieces, rows=64))
    monkeypatch.setattr("imuloop.ingest.faults.ROWS", 64)
    parts = measured()
    assert parts["gaps"]["list"] == whole["gaps"]["list"]
    assert parts["gaps"]["count"] == whole["gaps"]["count"] == 1
    assert parts["rate_hz"] == pytest.approx(whole["rate_hz"], rel=1e-12)
    assert parts["mean_specific_force"] == pytest.approx(whole["mean_specific_force"], rel=1e-12)
    assert parts["duration_s"] == pytest.approx(whole["duration_s"], rel=1e-12)


def test_clipping(log, measured):
    log.loc[5:8, "ax"] = [16.0, -15.9, 15.68, 15.6]
    found = measured(full_scale={"acceleration": 16.0})
    assert found["clipped"]["ax"] == 3
    assert found["clipped"]["ay"] == 0
    # undeclared is unknown, not none
    assert found["clipped"]["gx"] is None
    (line,) = found["warnings"]
    assert line.startswith(
        "samples at the end of the full scale: ax 3; rests, turns and moves with them"
    )


def test_quantisation_step(log, measured):
    log["gx"] = np.round(log.gx / 0.00106) * 0.00106
    log["ax"] = np.random.default_rng(2).normal(size=500)
    found = measured()["quantisation_step"]
    assert found["gx"] == pytest.approx(0.00106)
    assert found["ax"] is None


@pytest.mark.parametrize(
    ("unit", "factor", "status", "hint"),
    [
        ("m/s^2", 1 / 9.80665, "rejected", "taken as m/s^2, it looks like g"),
        ("m/s^2", 1e3 / 9.80665, "rejected", "taken as m/s^2, it looks like mg"),
        ("g", 1, "rejected", "taken as g, it looks like m/s^2"),
        ("m/s^2", 2, "rejected", "full scale was 1/2 of the one that the logger's scale is for"),
        ("m/s^2", 1 / 4, "rejected", "full scale was 4 times the one"),
        ("m/s^2", 400, "ok", "see units.acceleration"),
        ("m/s^2", 1.4, "ok", "see units.acceleration"),
        ("m/s^2", 0.01, "ok", "has gravity been taken out"),
    ],
)
def test_the_wrong_unit_of_acceleration_is_reported(log, measured, unit, factor, status, hint):
    log[["ax", "ay", "az"]] *= factor
    found = measured(units={"acceleration": unit}, gravity=9.818)
    assert found["status"] == status
    assert hint in found["reasons" if status == "rejected" else "warnings"][0]
    assert "gravity 9.818" in (found["reasons"] + found["warnings"])[0]


@pytest.mark.parametrize("kind", ["static", "multi_position"])
@pytest.mark.parametrize("factor", [0.85, 0.93, 1.06, 1.15])
def test_a_scale_of_some_per_cent_is_honest(log, measured, kind, factor):
    log[["ax", "ay", "az"]] *= factor
    assert measured(kind=kind)["warnings"] == []


def test_too_short(log, run):
    done = run(log[:99])
    assert done.quality["reasons"] == ["99 usable rows, at least 100 needed"]
    assert len(done.samples) == 0
    done = run(log[:150])
    assert done.quality["reasons"] == ["the log lasts 1.49 s, at least 2 s needed"]


@pytest.mark.parametrize(("bad", "status"), [(25, "ok"), (26, "rejected")])
def test_the_share_that_may_be_lost(log, measured, bad, status):
    log.loc[: bad - 1, "gz"] = np.nan
    found = measured()
    assert found["status"] == status
    assert found["non_finite"] == bad
    if bad == 26:
        assert "26 of 500 rows (5.2%) cannot be used" in found["reasons"][0]


def test_of_stamps_that_never_change_one_row_is_left_which_says_no_more(log, run):
    log["t"] = 0.0
    lost, few = run(log).quality["reasons"]
    assert "499 with a repeated stamp, see columns.time" in lost and few.startswith("1 usable rows")


@pytest.mark.parametrize("step", [5e-324, 1e-12, 1e100])
def test_stamps_of_no_sensor(log, run, step):
    log["t"] = np.arange(500) * step
    [reason] = run(log).quality["reasons"]
    assert "Hz is no rate of an IMU" in reason


def test_missing_temperatures_stay_missing(log, run):
    log["temp"] = np.where(log.index % 10, np.nan, 25.0)
    done = run(log)
    assert done.quality["rows"] == 500
    assert done.quality["missing_values"]["temperature"] == 450
    assert done.samples.temperature.notna().sum() == 50
    assert done.quality["constant"] == ["temperature"]
    assert done.quality["temperature_range"] == [25.0, 25.0]


@pytest.mark.parametrize(("channel", "size"), [("ax", 1e12), ("gy", 1e306)])
def test_a_value_that_no_sensor_gives_is_dropped_and_counted(log, measured, channel, size):
    log.loc[[100, 250], channel] = size
    found = measured()
    assert (found["status"], found["rows"], found["non_finite"]) == ("ok", 498, 2)
    assert found["impossible_values"][channel] == 2
    assert found["missing_values"][channel] == 0
    assert max(map(abs, found["range"][channel])) < 10.0
    [gaps, warning] = found["warnings"]
    assert gaps.startswith("2 gaps")
    assert f"beyond ± 1e+10 in SI, which no sensor gives: {channel} 2;" in warning


@pytest.mark.parametrize("channels", [["ax", "ay", "az"], ["gx", "gy", "gz"], ["gz"]])
def test_changes_that_no_sensor_resolves_are_none(log, run, channels):
    log[channels] *= 1e-200
    done = run(log)
    assert done.quality["status"] == "rejected"
    assert len(done.quality["reasons"]) == len(channels)
    assert "in the whole log, which no sensor resolves" in done.quality["reasons"][0]


def test_a_column_that_holds_no_numbers_is_named(log, run, tmp_path):
    log.assign(ax=[f"12:00:00.0 -> {x}" for x in log["ax"]]).to_csv(tmp_path / "log.csv")
    [first, _] = run(tmp_path / "log.csv").quality["reasons"]
    assert "500 with missing or non-finite values (ax 500);" in first
