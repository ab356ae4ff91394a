"""The command apply: a log, calibrated once, by a calibration that is one."""

import gzip
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import imuloop
from imuloop import Calibration
from imuloop.__main__ import main
from imuloop.core.errors import ImuloopError
from imuloop.core.files import write_json
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit
from imuloop.model.sensor_calibration import SensorCalibration
from test_command_line import one_line_error

COUNTS = RawUnit("count", 0.0024, 32768.0)
COUNTED = {"acceleration": "count", "angular_rate": "deg/s"}
NOMINAL = {"acceleration": {"scale": COUNTS.scale, "offset": COUNTS.offset}}
T = np.array([[1, 0.01, 0.02], [0, 1, 0.03], [0, 0, 1]])


def noisy_log(level=0.0):
    """Return 3 s of noise, the force about a level."""
    values = np.random.default_rng(0).normal(size=(300, 6)) + np.repeat([level, 0], 3)
    return pd.DataFrame({"t": np.arange(300) / 100, **dict(zip(CHANNELS, values.T, strict=True))})


@pytest.fixture
def calibration(tmp_path):
    device = Calibration(
        "d",
        9.80665,
        SensorCalibration(COUNTS, T, np.full(3, 0.0025), np.array([32700.0, 32800.0, 33000.0])),
        SensorCalibration(RawUnit("deg/s", np.pi / 180), np.eye(3), np.full(3, 0.018), np.ones(3)),
    )
    device.to_json(tmp_path / "calibration.json")
    return tmp_path / "calibration.json"


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_log_with_names_and_units_of_its_own_is_calibrated_by_the_formula(
    tmp_path, calibration, ending
):
    raw = np.random.default_rng(1).normal(size=(300, 6)) * np.repeat([1, 0.2], 3)
    names = ["stamp", "fx", "fy", "fz", "p", "q", "r", "T"]
    log = np.column_stack([np.arange(300) * 10, raw, np.full(300, 300.0)])
    pd.DataFrame(log, columns=names).to_csv(tmp_path / "log.csv", index=False)
    out = tmp_path / f"out{ending}"
    arguments = ["apply", str(calibration), str(tmp_path / "log.csv"), "-o", str(out)]
    arguments += ["--units.time", "ms", "--units.temperature", "K"]
    arguments += ["--units.acceleration", "g", "--units.angular_rate", "rad/s"]
    arguments += ["--columns.time=stamp", "--columns.acceleration=fx,fy,fz"]
    arguments += ["--columns.angular_rate=p,q,r", "--columns.temperature=T"]
    assert main(arguments) == 0
    got = pd.read_csv(out) if ending == ".csv" else pd.read_parquet(out)
    np.testing.assert_allclose(got["t"], np.arange(300) / 100, atol=1e-12)
    np.testing.assert_allclose(got["temperature"], 300 - 273.15)
    counts = raw[:, :3] * 9.80665 / 0.0024 + 32768
    f = (counts - [32700, 32800, 33000]) * 0.0025 @ T.T
    np.testing.assert_allclose(got[["ax", "ay", "az"]], f, rtol=1e-9, atol=1e-9)
    w = (np.degrees(raw[:, 3:]) - 1) * 0.018
    np.testing.assert_allclose(got[["gx", "gy", "gz"]], w, atol=1e-12)


def test_the_calibration_of_a_rejected_log_is_none_to_use(tmp_path, capsys):
    """From a log that was rejected to its use: every step says that nothing was measured.

    Protects `--nominal`, the only way to apply it, and the exports, none of which holds it.
    """
    rows = "\n".join(f"{k / 100},1,2,3,4,5,6" for k in range(20))
    (tmp_path / "short.csv").write_text(f"t,ax,ay,az,gx,gy,gz\n{rows}\n")
    log = noisy_log()
    log.to_csv(tmp_path / "log.csv", index=False)
    folder, out = tmp_path / "made", tmp_path / "out.csv"
    with pytest.warns(UserWarning, match="rejected"):
        result = imuloop.calibrate(tmp_path / "short.csv", folder=folder, progress=False)
    assert [path.name for path in result.export(folder / "exports")] == ["README.txt"]
    command = ["apply", folder / "calibration.json", tmp_path / "log.csv", "-o", out]
    message = one_line_error(command, capsys)
    assert f"{folder / 'calibration.json'}: the calibration is nominal" in message
    assert "rejected" in message and "--nominal" in message and not out.exists()
    assert main([str(word) for word in (*command, "--nominal")]) == 0
    np.testing.assert_allclose(pd.read_csv(out)[list(CHANNELS)], log[list(CHANNELS)], atol=1e-12)
    said = capsys.readouterr().out
    assert "accelerometer: nominal (" in said and "gyroscope: nominal (" in said


def test_apply_says_of_a_sensor_what_its_calibration_lacks(tmp_path, calibration, capsys):
    """Protects a line each for a sensor that is nominal, and one with an unexplained residual."""
    device = Calibration.from_json(calibration)
    log = noisy_log()
    log.to_csv(tmp_path / "log.csv", index=False)
    command = ["apply", str(calibration), str(tmp_path / "log.csv"), "-o", str(tmp_path / "o.csv")]
    assert main(command) == 0 and capsys.readouterr().out == ""
    nominal = SensorCalibration.nominal(COUNTS, "no poses")
    doubted = replace(device.gyroscope, verdict="unexplained")
    replace(device, accelerometer=nominal, gyroscope=doubted).to_json(calibration)
    assert main(command) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == "accelerometer: nominal (no poses)"
    assert second.startswith("gyroscope: unexplained (") and "diagnosis.json" in second


def rename_to(ending):
    return lambda path: path.rename(path.with_name(f"other{ending}"))


def pack(path):
    other = path.with_name("packed.csv.gz")
    other.write_bytes(gzip.compress(path.read_bytes()))
    return other


def by_pandas(ending, cut=None):
    """Return a function that reads a table with pandas, leaves out rows and writes it again."""

    def written(path):
        read = pd.read_csv if path.suffix == ".csv" else pd.read_parquet
        table, other = read(path)[cut or slice(None)], path.with_name(f"pandas{ending}")
        write = table.to_csv if ending == ".csv" else table.to_parquet
        write(other, index=False)
        return other

    return written


@pytest.mark.parametrize(
    ("ending", "treated"),
    [
        *((".csv", rename_to(ending)) for ending in (".dat", "")),
        *((".parquet", rename_to(ending)) for ending in (".csv", "")),
        (".csv", pack),
        (".csv", by_pandas(".csv", slice(50, 250))),
        (".csv", by_pandas(".parquet")),
        (".parquet", by_pandas(".parquet", slice(50, 250))),
    ],
)
def test_a_log_is_calibrated_once(tmp_path, calibration, capsys, ending, treated):
    """A log that `apply` wrote is refused, by every way in, by any name and in both formats.

    Protects the mark in the written log and each reader's look at it: without them a second run
    corrects the bias again, with exit status 0.
    """
    noisy_log(35125.0).to_csv(tmp_path / "log.csv", index=False)
    once, twice = tmp_path / f"once{ending}", tmp_path / "twice.csv"
    assert main(["apply", str(calibration), str(tmp_path / "log.csv"), "-o", str(once)]) == 0
    # other tools have the columns of the docs, and numbers alone
    table = pd.read_csv(once) if ending == ".csv" else pd.read_parquet(once)
    assert list(table)[:7] == ["t", *CHANNELS] and np.isfinite(table.to_numpy(float)).all()
    path = treated(once)
    declared = ["--format", "csv" if ending == ".csv" else "parquet"] if not path.suffix else []
    for command in (["apply", calibration, path, "-o", twice], ["check", calibration, path]):
        message = one_line_error([*command, *declared], capsys)
        assert path.name in message and "calibrated already" in message and "raw log" in message
    assert not twice.exists()
    format_of = {"format": declared[1]} if declared else {}
    with pytest.raises(ImuloopError, match="calibrated already"):
        imuloop.read(path, **format_of)
    device = Calibration.from_json(calibration)
    with pytest.raises(ImuloopError, match="calibrated already"):
        device.apply(table)
    if path.suffix == ".parquet":
        with pytest.raises(ImuloopError, match="calibrated already"):
            device.apply_file(path, twice)
    # and what Python calibrated in memory
    samples = device.apply(imuloop.read(tmp_path / "log.csv", units=COUNTED, nominal=NOMINAL))
    for again in (device.apply, imuloop.read):
        with pytest.raises(ImuloopError, match="calibrated already"):
            again(samples)


def test_an_offset_in_time_is_said_and_added_where_asked(tmp_path, calibration, capsys):
    log = noisy_log(35125.0)
    log.to_csv(tmp_path / "log.csv", index=False)
    out = tmp_path / "out.csv"
    command = ["apply", str(calibration), str(tmp_path / "log.csv"), "-o", str(out)]
    assert "no time offset" in one_line_error([*command, "--shift"], capsys)
    effect = {"name": "time_offset", "parameters": {"dt": -0.004}}
    sensors = {"gyroscope": {"reference": {"effects": [effect]}}}
    write_json(tmp_path / "diagnosis.json", {"sensors": sensors})
    for more, words, shift in (
        ([], "the gyroscope's stamps are -4 ms", 0.0),
        (["--shift"], "stamps were moved by -4 ms", -0.004),
    ):
        assert main(command + more) == 0
        assert words in capsys.readouterr().out
        np.testing.assert_allclose(pd.read_csv(out)["t"], log["t"] + shift, atol=1e-12)
    # of a reference whose clock began apart it says nothing of the next log
    (tmp_path / "hand").mkdir()
    write_json(tmp_path / "hand/quality.json", {"reference": {"clock": {"own": True}}})
    assert "no time offset" in one_line_error([*command, "--shift"], capsys)
