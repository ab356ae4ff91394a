"""``python -m imuloop apply`` on raw logs and on samples."""

import numpy as np
import pandas as pd
import pytest

from imuloop import Calibration
from imuloop.__main__ import main
from imuloop.core.model import SensorCalibration
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit

COUNTS = RawUnit("count", 0.0024, 32768.0)
T = np.array([[1, 0.01, 0.02], [0, 1, 0.03], [0, 0, 1]])


@pytest.fixture
def calibration(tmp_path):
    made = Calibration(
        "d",
        9.80665,
        SensorCalibration(COUNTS, T, np.full(3, 0.0025), np.array([32700.0, 32800.0, 33000.0])),
        SensorCalibration(RawUnit("deg/s", np.pi / 180), np.eye(3), np.full(3, 0.018), np.ones(3)),
    )
    made.to_json(tmp_path / "calibration.json")
    return tmp_path / "calibration.json"


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_raw_log_is_calibrated_by_the_formula(tmp_path, calibration, ending):
    rng = np.random.default_rng(0)
    raw = np.column_stack(
        [rng.integers(30000, 36000, (300, 3)), rng.normal(scale=20, size=(300, 3))]
    )
    log = pd.DataFrame({"t": np.arange(300) / 100, **dict(zip(CHANNELS, raw.T, strict=True))})
    log.to_csv(tmp_path / "log.csv", index=False)
    out = tmp_path / f"out{ending}"
    assert main(["apply", str(calibration), str(tmp_path / "log.csv"), "-o", str(out)]) == 0
    got = pd.read_csv(out) if ending == ".csv" else pd.read_parquet(out)
    f = (raw[:, :3] - [32700, 32800, 33000]) * 0.0025 @ T.T
    np.testing.assert_allclose(got[["ax", "ay", "az"]], f, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(got[["gx", "gy", "gz"]], (raw[:, 3:] - 1) * 0.018, atol=1e-12)


def test_a_log_with_names_and_units_of_its_own(tmp_path, calibration):
    rng = np.random.default_rng(1)
    raw = np.column_stack([rng.normal(size=(300, 3)), rng.normal(scale=0.2, size=(300, 3))])
    names = ["stamp", "fx", "fy", "fz", "p", "q", "r", "T"]
    log = np.column_stack([np.arange(300) * 10, raw, np.full(300, 300.0)])
    pd.DataFrame(log, columns=names).to_csv(tmp_path / "log.csv", index=False)
    arguments = ["apply", str(calibration), str(tmp_path / "log.csv")]
    arguments += ["-o", str(tmp_path / "out.csv"), "--time-unit", "ms", "--temperature-unit", "K"]
    arguments += ["--acceleration-unit", "g", "--angular-rate-unit", "rad/s", "--columns"]
    arguments += ["time=stamp", "acceleration=fx,fy,fz", "angular_rate=p,q,r", "temperature=T"]
    assert main(arguments) == 0
    got = pd.read_csv(tmp_path / "out.csv")
    np.testing.assert_allclose(got["t"], np.arange(300) / 100, atol=1e-12)
    np.testing.assert_allclose(got["temperature"], 300 - 273.15)
    counts = raw[:, :3] * 9.80665 / 0.0024 + 32768
    f = (counts - [32700, 32800, 33000]) * 0.0025 @ T.T
    np.testing.assert_allclose(got[["ax", "ay", "az"]], f, rtol=1e-9, atol=1e-9)
    w = (np.degrees(raw[:, 3:]) - 1) * 0.018
    np.testing.assert_allclose(got[["gx", "gy", "gz"]], w, atol=1e-12)


def test_a_calibration_that_is_no_json_is_one_line(tmp_path, calibration, capsys):
    calibration.write_text("{")
    assert main(["apply", str(calibration), "log.csv", "-o", str(tmp_path / "out.csv")]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "calibration.json: no JSON" in message


def test_what_is_missing_is_one_line(tmp_path, calibration, capsys):
    out = tmp_path / "out.csv"
    assert main(["apply", str(calibration), str(tmp_path / "no.csv"), "-o", str(out)]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "no.csv" in message
    assert not out.exists()


def test_a_log_that_is_rejected_says_why(tmp_path, calibration, capsys):
    rows = "\n".join(f"{k / 100},1,2,3,4,5,6" for k in range(20))
    (tmp_path / "short.csv").write_text(f"t,ax,ay,az,gx,gy,gz\n{rows}\n")
    out = tmp_path / "out.csv"
    assert main(["apply", str(calibration), str(tmp_path / "short.csv"), "-o", str(out)]) == 1
    message = capsys.readouterr().err
    assert "short.csv: rejected: " in message and "20 usable rows" in message
    assert not out.exists()
