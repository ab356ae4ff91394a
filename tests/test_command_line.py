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
