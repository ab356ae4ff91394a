"""Real recordings, as config/measured.yaml declares them, against what their publishers say."""

import numpy as np
import pytest
import yaml

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.units import RawUnit

COUNTS = {"acceleration": "count", "angular_rate": "count"}


@pytest.fixture
def measured(repository, recordings, run):
    """Ingest the session of a device, in which nothing is wrong; give the files and the results."""
    devices = yaml.safe_load((repository / "config/measured.yaml").read_text())["devices"]

    def ingested(device, **changed):
        (session,) = devices[device]["sessions"].values()
        declared = {**session, "nominal": devices[device].get("nominal"), **changed}
        file = declared.pop("file")
        sources = [file] if "url" in file else file.values()
        paths = [recordings(source["url"].rsplit("/", 1)[1]) for source in sources]
        done = run(*paths, **declared)
        if not changed:
            quality = done.quality
            assert (quality["status"], quality["reasons"], quality["warnings"]) == ("ok", [], [])
        return paths, done

    ingested.devices = devices
    return ingested


def test_each_device_is_read_below(measured):
    boards = {f"mpu9150_{board}" for board in (1, 2, 3)}
    assert {*measured.devices} == {"xsens_mti", *boards, "thermal_chamber", "ferraris"}


def turns_agree_with_gravity(quality):
    ratio = quality["faults"]["rests"]["turn_ratio"]
    return ratio["value"] == pytest.approx(1, abs=0.02) and ratio["moves"] >= 19


def test_the_counts_of_an_xsens_come_back(measured):
    paths, done = measured("xsens_mti")
    assert done.quality["rows"] == 51175
    assert done.quality["rate_hz"] == pytest.approx(100, rel=2e-4)
    assert done.quality["duration_s"] == pytest.approx(512, abs=0.5)
    assert done.quality["mean_specific_force"] == pytest.approx(9.81, rel=0.05)
    assert turns_agree_with_gravity(done.quality)
    # the raw counts come back, each one
    axes = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}
    for path, (quantity, names) in zip(paths, axes.items(), strict=True):
        raw, unit = np.loadtxt(path), RawUnit(**done.metadata["raw_units"][quantity])
        np.testing.assert_array_equal(np.round(unit.from_si(done.samples[[*names]])), raw[:, 1:])
        np.testing.assert_array_equal(done.samples.t, raw[:, 0] - raw[0, 0])
    assert done.quality["quantisation_step"]["ax"] == pytest.approx(0.00240964)


@pytest.mark.parametrize("board", [1, 2, 3])
def test_boards_of_an_mpu9150_come_back(measured, board):
    [path], done = measured(f"mpu9150_{board}")
    np.testing.assert_array_equal(done.samples[[*CHANNELS]], np.loadtxt(path))
    assert done.quality["duration_s"] == pytest.approx(160, abs=1)
    assert board > 1 or done.quality["rows"] == 15969
    assert turns_agree_with_gravity(done.quality)


def test_a_recording_in_a_thermal_chamber_is_no_motion(measured):
    # over 92 K the bias drifts by 21 mg, and the norm by 6 %: no motion
    [path], done = measured("thermal_chamber")
    assert done.quality["rows"] == 8400
    assert done.quality["duration_s"] / 60 == pytest.approx(70.7, abs=0.05)
    assert done.quality["rate_hz"] == pytest.approx(1.98, abs=0.005)
    assert done.quality["temperature_range"] == pytest.approx([-17.6, 74.0], abs=0.05)
    raw = np.loadtxt(path, delimiter="\t", skiprows=1, usecols=0, dtype=np.int64)
    np.testing.assert_array_equal(done.samples.t, (raw - raw[0]) * 1e-6)
    # in seconds it would be a log of 135 years
    _, done = measured("thermal_chamber", units={"time": "s"}, columns=None)
    assert done.quality["status"] == "rejected"


def test_turns_about_each_axis_show_a_rate_that_is_twice_the_true_one(measured):
    [path], done = measured("ferraris")
    raw = np.loadtxt(path, delimiter=",", skiprows=1)
    assert done.quality["rows"] == len(raw) == 10376
    np.testing.assert_array_equal(done.samples[[*ACCELERATION]], raw[:, 4:7])
    turned = np.deg2rad(raw[:, 1:4])
    np.testing.assert_allclose(done.samples[[*ANGULAR_RATE]], turned, rtol=1e-15)
    # the published rate is twice that of the turns
    _, done = measured("ferraris", rate=204.8, columns=None)
    assert done.quality["status"] == "rejected"
    assert "the log's rate is off by as much" in done.quality["reasons"][0]


# --- recordings of others, sound and harmed


@pytest.mark.parametrize(
    ("i", "chips"), [(1, 2), *(pytest.param(i, 8, marks=pytest.mark.study) for i in (1, 5))]
)
def test_measured_turns_agree_with_gravity(recordings, run, i, chips):
    declared = {
        "units": {"time": "us", **COUNTS},
        "nominal": {"acceleration": {"scale": 0.0047884}, "angular_rate": {"scale": 0.001064225}},
    }
    for chip in range(1, chips + 1):
        columns = {"time": "t_us", "acceleration": [f"a{x}{chip}" for x in "xyz"]}
        columns["angular_rate"] = [f"g{x}{chip}" for x in "xyz"]
        found = run(recordings(f"exp_{i}.parquet"), columns=columns, **declared).quality
        assert found["status"] == "ok" and turns_agree_with_gravity(found)
        # over rests, so none is reported of the shaking that follows
        assert not any("specific force" in line for line in found["warnings"])


def test_measured_motion_is_not_static(recordings, run):
    columns = {"acceleration": [0, 1, 2], "angular_rate": [3, 4, 5]}
    found = run(recordings("imu1.log"), kind="static", columns=columns, rate=100).quality
    assert "in 22 attitudes" in found["reasons"][0]
    columns = {"acceleration": "imu_acc", "angular_rate": "imu_gyr"}
    for name in ("03_undisturbed_slow_rotation_C", "07_undisturbed_fast_rotation_B"):
        path = recordings(f"{name}.mat")
        found = run(path, kind="static", columns=columns, rate=285.714).quality
        assert "; a static session lies still" in found["reasons"][0]


@pytest.mark.parametrize("i", [1, pytest.param(2, marks=pytest.mark.study)])
def test_measured_rest_is_static(recordings, run, i):
    path, units = recordings(f"adis_16405_imu{i}.parquet"), ("g", "deg/s")
    units = dict(zip(COUNTS, units, strict=True))
    found = run(path, kind="static", units=units, rate=100).quality
    assert (found["reasons"], found["warnings"]) == ([], [])
    assert found["faults"]["rests"]["share"] > 0.999


def test_a_recording_of_increments_is_rejected_with_the_cause(recordings, run):
    """Protects a whole file as a logger writes it: no header, no units, three columns of angles."""
    path = recordings("unlabelled_increments_100Hz.txt.gz")
    columns = {"time": 0, "angular_rate": [1, 2, 3], "acceleration": [4, 5, 6]}
    [reason] = run(path, columns=columns).quality["reasons"]
    assert reason.endswith("declare units.acceleration: m/s and units.angular_rate: rad")
    units = {"acceleration": "m/s", "angular_rate": "rad"}
    assert run(path, columns=columns, units=units).quality["status"] == "ok"
