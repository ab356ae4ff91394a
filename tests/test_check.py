"""``imuloop check``: a drift is named and updated, other parameters do not count as drift."""

import json
import re
import shutil

import numpy as np
import pandas as pd
import pytest

import imuloop
from imuloop import Calibration, chain
from imuloop.__main__ import main
from imuloop.core.samples import ACCELERATION, CHANNELS
from imuloop.core.units import RawUnit
from imuloop.model.sensor_calibration import SensorCalibration
from quick import hurry
from test_command_line import one_line_error


def test_a_device_that_did_not_drift(device, tmp_path, capsys):
    out = tmp_path / "drift.json"
    arguments = ["check", str(device / "calibration.json"), str(device / "2.csv")]
    assert main([*arguments, "--json", str(out)]) == 0
    lines = capsys.readouterr().out
    assert "accelerometer: no drift (9 parameters" in lines
    assert "gyroscope: no drift (12 parameters" in lines
    assert f"noise of {device / 'noise.json'}" in lines
    content = json.loads(out.read_text())
    assert (
        content["format"] == 1
        and content["drifted"] is False
        and content["kind"] == "multi_position"
    )
    assert content["sensors"]["gyroscope"]["dof"] == 12
    assert {"name", "unit", "change", "std", "sigmas", "p_holm", "drifted"} <= set(
        content["sensors"]["gyroscope"]["changes"][0]
    )


def test_a_device_that_drifted_by_its_exit_status(device, tmp_path, capsys):
    log = pd.read_csv(device / "2.csv")
    log["gy"] += 0.05
    log.to_csv(tmp_path / "later.csv", index=False)
    arguments = ["check", str(device / "calibration.json"), str(tmp_path / "later.csv")]
    assert main(arguments) == 3
    lines = capsys.readouterr().out
    assert "gyroscope: DRIFTED" in lines and "accelerometer: no drift" in lines
    assert re.search(r"b1 +moved by 2\.8\d* ± .* °/s .*DRIFTED, above noise", lines)
    assert "Only biases moved" in lines
    assert main([*arguments, "--turn-on", "0.2,0.05"]) == 0


RATES = ["gx", "gy", "gz"]


@pytest.fixture(scope="module")
def calibrated_log(device, tmp_path_factory):
    """A calibration as the stages make it of ``1.csv``, its full scale declared, in rad/s."""
    folder = tmp_path_factory.mktemp("stages")
    full_scale = float(pd.read_csv(device / "2.csv")["gx"].nlargest(12).iloc[-1])
    how = {"full_scale": {"acceleration": 40.0, "angular_rate": full_scale}}
    imu = chain.Device("d", folder, {"poses": "multi_position"}, **how)
    assert not chain.ingest(imu, "poses", {}, [device / "1.csv"])
    for stage in (chain.segment, chain.noise, chain.calibrate):
        assert not stage(imu)
    return imu.file("multi_position.json"), full_scale


@pytest.mark.parametrize("samples", [8, 19])
def test_a_turn_that_reached_the_range_is_left_out(device, tmp_path, samples):
    """Protects K of a log that saturates for a few samples of one turn."""
    log = pd.read_csv(device / "2.csv")
    limit = log["gx"].nlargest(samples).iloc[-1]
    log["gx"] = log["gx"].clip(upper=limit)
    log.to_csv(tmp_path / "later.csv", index=False)
    out = tmp_path / "drift.json"
    arguments = [str(device / "calibration.json"), str(tmp_path / "later.csv"), "--json", str(out)]
    assert main(["check", *arguments]) == 0
    assert json.loads(out.read_text())["rotations"] < 14


def test_the_full_scale_of_the_calibrated_log_holds_for_a_new_one(
    device, calibrated_log, tmp_path, capsys
):
    """Protects K where a filter behind the range leaves no repeated value."""
    path, limit = calibrated_log
    log, rng = pd.read_csv(device / "2.csv"), np.random.default_rng(3)
    over = log[RATES].abs() > limit
    soft = np.sign(log[RATES]) * limit * (1 + 0.002 * rng.random(over.shape))
    log[RATES] = log[RATES].mask(over, soft)
    assert over.sum().sum() > 12
    log.to_csv(tmp_path / "later.csv", index=False)
    assert main(["check", str(path), str(tmp_path / "later.csv")]) == 0
    content = json.loads(path.read_text())
    del content["log"]["full_scale"]
    path.with_name("bare.json").write_text(json.dumps(content))
    assert main(["check", str(path.with_name("bare.json")), str(tmp_path / "later.csv")]) == 3


def test_the_log_of_the_calibration_shows_no_drift_and_is_named(
    device, calibrated_log, tmp_path, capsys
):
    path, _ = calibrated_log
    # the name does not matter
    shutil.copy(device / "1.csv", tmp_path / "other.csv")
    out = tmp_path / "drift.json"
    arguments = ["check", path, tmp_path / "other.csv", "--json", out]
    assert "the calibration is from this log" in one_line_error(arguments, capsys)
    assert not out.exists()
    # an older file does not know its logs
    content = json.loads(path.read_text())
    assert content.pop("sha256")
    path.with_name("older.json").write_text(json.dumps(content))
    assert main(["check", str(path.with_name("older.json")), str(tmp_path / "other.csv")]) == 0


def test_a_calibration_with_the_biases_of_a_new_log(device, tmp_path, capsys):
    """Protects the file that --update writes, and that nothing is written where it cannot be."""
    log = pd.read_csv(device / "2.csv")
    log["gy"] += 0.05
    log.to_csv(tmp_path / "later.csv", index=False)
    shutil.copy(device / "noise.json", tmp_path)
    old, new, again = device / "calibration.json", tmp_path / "new.json", tmp_path / "again.json"

    def update(calibration, name, target):
        return ["check", str(calibration), str(tmp_path / name), "--update", "-o", str(target)]

    assert main(update(old, "later.csv", new)) == 3
    lines = capsys.readouterr().out
    assert "accelerometer: bias now " in lines and f"wrote {new}" in lines
    before, after = (json.loads(path.read_text()) for path in (old, new))
    assert after.pop("updated") == dict.fromkeys(("accelerometer", "gyroscope"), "later.csv")
    one, other = (content["gyroscope"]["b"][1] for content in (before, after))
    assert other == pytest.approx(one + 0.05, abs=1e-4)
    for content in (before, after):
        for sensor in ("accelerometer", "gyroscope"):
            del content[sensor]["b"], content[sensor]["covariance"]
    assert after == before
    # the new file is the calibration of the device now
    assert main(["check", str(new), str(tmp_path / "later.csv")]) == 0
    assert main(["info", str(new)]) == 0
    assert "bias of a later log: later.csv" in capsys.readouterr().out
    # a rest has no three directions, which is said; an earlier update stays named
    log[log["t"] < 19].to_csv(tmp_path / "rest.csv", index=False)
    assert main(update(new, "rest.csv", again)) == 0
    said = capsys.readouterr().out
    assert "accelerometer: bias left as it was: " in said and "1 rest, 0 turns" in said
    updated = json.loads(again.read_text())["updated"]
    assert updated == {"accelerometer": "later.csv", "gyroscope": "rest.csv"}

    log[:20].to_csv(tmp_path / "short.csv", index=False)
    units = RawUnit("m/s^2", 1.0), RawUnit("rad/s", 1.0)
    nominal = (SensorCalibration.nominal(unit, "no poses") for unit in units)
    Calibration("d", 9.8, *nominal).to_json(tmp_path / "nominal.json")
    target = tmp_path / "none.json"
    for command, words in (
        (update(old, "short.csv", target), "rejected"),
        (update(tmp_path / "nominal.json", "later.csv", target), "estimated nothing"),
        (update(old, "later.csv", old), "would destroy"),
        (update(old, "later.csv", target)[:-2], "--update needs -o"),
        (["check", str(old), str(device / "2.csv"), "-o", str(target)], "-o needs --update"),
    ):
        assert words in one_line_error(command, capsys)
        assert not target.exists()


def test_a_log_laid_out_as_that_of_the_calibration_needs_no_options(device, tmp_path, capsys):
    """Its columns and units, too, are in calibration.json; of one without them as before."""
    names = dict(zip(CHANNELS, ("fx", "fy", "fz", "p", "q", "r"), strict=True)) | {"t": "stamp"}

    def lay_out(log):
        log = log.copy()
        log["t"] *= 1e3
        log[list(ACCELERATION)] /= 9.80665
        # columns that have the usual names
        return log.rename(columns=names).assign(ax=0.0, ay=0.0, az=0.0)

    logs = [pd.read_csv(device / f"{k}.csv") for k in (1, 2)]
    for k, log in enumerate(logs):
        lay_out(log).to_csv(tmp_path / f"{k}.csv", index=False)
    columns = {"time": "stamp", "acceleration": ["fx", "fy", "fz"], "angular_rate": ["p", "q", "r"]}
    units = {"time": "ms", "acceleration": "g", "angular_rate": "rad/s"}
    how = {"columns": columns, "units": units, "folder": tmp_path / "own", "progress": False}
    with hurry("device"):
        result = imuloop.calibrate(tmp_path / "0.csv", **how)
    assert result.calibration.log == {"columns": columns, "units": units}
    path, out = tmp_path / "own/calibration.json", tmp_path / "out.parquet"
    assert main(["apply", str(path), str(tmp_path / "1.csv"), "-o", str(out)]) == 0
    expected = result.calibration.apply(imuloop.read(device / "2.csv"))
    got = pd.read_parquet(out)
    np.testing.assert_allclose(got[["t", *CHANNELS]], expected[["t", *CHANNELS]], atol=1e-9)
    # another layout is read as before, and declarations go first
    (logs[1] / ([1] + 3 * [9.80665] + 3 * [1])).to_csv(tmp_path / "usual.csv", index=False)
    lay_out(logs[1]).rename(columns={"p": "wx"}).to_csv(tmp_path / "said.csv", index=False)
    for name, *more in (["usual.csv"], ["said.csv", "--columns.angular_rate=wx,q,r"]):
        assert main(["apply", str(path), str(tmp_path / name), "-o", str(out), *more]) == 0
        got = pd.read_parquet(out)
        np.testing.assert_allclose(got[list(CHANNELS)], expected[list(CHANNELS)], atol=1e-9)
    assert main(["check", str(path), str(tmp_path / "1.csv")]) == 0
