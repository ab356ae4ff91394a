"""Real recordings, as config/measured.yaml declares them, against what their publishers say."""

import numpy as np
import pytest
import yaml

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.units import RawUnit


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

    return ingested


def test_each_device_is_read_below(repository):
    devices = yaml.safe_load((repository / "config/measured.yaml").read_text())["devices"]
    boards = {f"mpu9150_{board}" for board in (1, 2, 3)}
    assert set(devices) == {"xsens_mti", *boards, "thermal_chamber", "ferraris"}


def turns_agree_with_gravity(quality):
    ratio = quality["faults"]["rests"]["turn_ratio"]
    return ratio["value"] == pytest.approx(1, abs=0.02) and ratio["moves"] >= 19


def test_xsens(measured):
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
def test_mpu9150(measured, board):
    [path], done = measured(f"mpu9150_{board}")
    np.testing.assert_array_equal(done.samples[[*CHANNELS]], np.loadtxt(path))
    assert done.quality["duration_s"] == pytest.approx(160, abs=1)
    assert board > 1 or done.quality["rows"] == 15969
    assert turns_agree_with_gravity(done.quality)


def test_thermal_chamber(measured):
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


def test_ferraris(measured):
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
