"""Plausible mistakes, in Python and on the command line: one line each, with the cause."""

import inspect
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

import imuloop
from imuloop.__main__ import main
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS

N = 400
T = np.arange(N) / 100
F = np.random.default_rng(0).normal([0, 0, 9.8], 0.01, (N, 3))
W = np.random.default_rng(1).normal(0, 0.001, (N, 3))


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log.csv"
    table = pd.DataFrame(np.column_stack([T, F, W]), columns=["t", *CHANNELS])
    table.to_csv(path, index=False)
    return path


# arguments of imuloop.calibrate, PATH the log, and text of the error
IN_PYTHON = {
    "no gyroscope": ((T, F), {}, "angular_rate: none is given"),
    "no log": ((), {}, "no log is given"),
    "no logs": (([],), {}, "no log is given"),
    "a place without height": ((T, F, W), {"gravity": {"latitude": 45.4}}, "nor a place with"),
    "gravity as a pair": ((T, F, W), {"gravity": (9, 81)}, "gravity: (9, 81) is neither"),
    "a wrong stage": ((T, F, W), {"settings": {"segmnt": {}}}, "did you mean 'segment'"),
    "a unit": ((T, F, W), {"units": {"acceleration": "ms2"}}, "'ms2' is not a unit"),
    "a quantity": (
        (T, F, W),
        {"units": {"accel": "g"}},
        "units.accel: unknown key; use one of",
    ),
    "nominal": ((T, F, W), {"nominal": {"acceleration": {"scle": 1}}}, "; did you mean 'scale'?"),
    "a sensor": ((T, F, W), {"sensor": "icm42688q"}, "; did you mean 'icm42688p'?"),
    "a tolerance in percent": (
        (T, F, W),
        {"nominal": {"acceleration": {"tolerance": {"scale_factor": 3}}}},
        "'scale_factor': …}}}: 3 should be less than or equal to 0.5",
    ),
    "columns": (("PATH",), {"columns": {"acceleration": ["fx", "fy", "fz"]}}, "no column 'fx'"),
    "format": (("PATH",), {"format": "cvs"}, "'cvs' is not a format; did you mean 'csv'"),
    "transposed": ((T, F.T, W.T), {}, "an array of shape (3, 400); as many rows as t has"),
    "a pair of files": ((("a.csv", "b.csv"),), {}, "of two files {'acceleration': path"),
    "temperature": ((T, F, W, np.ones(5)), {}, "temperature: an array of shape (5,)"),
    "one array": (
        (np.arange(100),),
        {},
        "log: ndarray of shape (100,) is not a log; a log is a path",
    ),
    "no time": ((), {"acceleration": F, "angular_rate": W}, "no time column of a usual name"),
    "ragged rows": ((T, [[1, 2, 3], [1]], W), {}, "acceleration: its rows differ in length"),
    "a column twice": (
        (pd.DataFrame(np.ones((9, 3)), columns=["t", "ax", "ax"]),),
        {},
        "two columns are named ax",
    ),
    "temperature of a file": (("PATH",), {"temperature": T}, "log: tuple is not a log"),
    "a name that is a path": (
        (T, F, W),
        {"name": "../a"},
        "name: '../a' should match pattern",
    ),
    "a setting out of its limits": (
        (T, F, W),
        {"settings": {"noise": {"significance": 2}}},
        "settings.noise.significance: 2 should be less than 1",
    ),
    "a file for a folder": ((T, F, W), {"folder": "PATH"}, "log.csv: a file, where a folder"),
}


@pytest.mark.parametrize("mistake", IN_PYTHON)
def test_a_mistake_in_python_is_one_line_with_its_cause(mistake, log, recwarn):
    given, how, cause = IN_PYTHON[mistake]
    given = [log if isinstance(each, str) and each == "PATH" else each for each in given]
    how = {
        key: log if isinstance(each, str) and each == "PATH" else each for key, each in how.items()
    }
    with pytest.raises(ImuloopError) as raised:
        imuloop.calibrate(*given, **how, progress=False)
    line = str(raised.value)
    assert cause in line and "\n" not in line
    # nothing of where a log in memory was put
    assert "/imuloop-" not in line
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]


ALLAN = {"text": ("x", 1), "no rate": (F, 0), "three dimensions": (np.ones((9, 9, 9)), 1)}


@pytest.mark.parametrize("given", ALLAN)
def test_what_has_no_allan_deviation(given):
    with pytest.raises(ImuloopError, match=r"^(values|rate): "):
        imuloop.allan(*ALLAN[given])


def test_what_is_read_and_applied_by_mistake(log):
    with pytest.raises(ImuloopError, match="'unit' cannot be declared of a log; did you mean 'u"):
        imuloop.read(log, unit={"acceleration": "g"})
    nominal = imuloop.model.sensor_calibration.SensorCalibration.nominal
    raw = imuloop.core.units.RawUnit
    sensors = [nominal(raw(unit, 1.0), "no log") for unit in ("m/s^2", "rad/s")]
    with pytest.raises(ImuloopError, match=r"not ndarray: imuloop\.read"):
        imuloop.Calibration("d", 9.8, *sensors).apply(F)
    with pytest.raises(ImuloopError, match=r"none\.parquet: there is no such file"):
        imuloop.Calibration("d", 9.8, *sensors).apply_file("none.parquet", log, nominal=True)


ON_THE_COMMAND_LINE = {
    "check LOG CALIBRATION": "LOG: no calibration.json: it comes first, then the log",
    "calibrate LOG --gravity 45.4 -o OUT": "45.4 is neither 0.1 to 25 m/s^2 nor a place",
    "calibrate LOG --gravity 9,81 -o OUT": "gravity: [9, 81] is neither 0.1 to 25 m/s^2",
    "coach LOG --gravity.latitude 45": "{'latitude': 45} is neither",
    "calibrate LOG --gravity 9.8 --gravity.height 12 -o OUT": "above it, --gravity, is given",
    "calibrate LOG --units.acceleration ms2 -o OUT": "'ms2' is not a unit; did you mean",
    "calibrate LOG": "the following arguments are required: -o/--output",
    "calibrate LOG --columns.speed v -o OUT": "unrecognized arguments: --columns.speed v",
    "calibrate LOG --rate -5 -o OUT": "--rate: -5 should be greater than 0",
    "calibrate LOG --sensor mpu9999 -o OUT": "--sensor: 'mpu9999' is not a sensor",
    "calibrate LOG --nominal.acceleration.scale x -o OUT": "scale: 'x' should be a valid number",
    "calibrate LOG --units.time sec -o OUT": "--units.time: 'sec' is not a unit",
    "noise CALIBRATION": "calibration.json: not a log; imuloop info describes results",
    "calibrat LOG": "invalid choice: 'calibrat'",
}


@pytest.mark.parametrize("command", ON_THE_COMMAND_LINE)
def test_a_mistake_on_the_command_line_is_one_line_with_its_cause(command, log, tmp_path, capsys):
    (tmp_path / "calibration.json").write_text("{}")
    names = {"LOG": log, "CALIBRATION": tmp_path / "calibration.json", "OUT": tmp_path / "out"}
    arguments = [str(names.get(word, word)) for word in command.split()]
    try:
        status = main(arguments)
    except SystemExit as stopped:
        status = stopped.code
    assert status in (1, 2)
    printed = capsys.readouterr()
    [line] = printed.err.splitlines()
    assert ON_THE_COMMAND_LINE[command].replace("LOG:", f"{log}:") in line and not printed.out


def test_the_call_is_documented_as_its_function():
    from imuloop.calibrate_logs import calibrate

    assert inspect.signature(imuloop.calibrate) == inspect.signature(calibrate)
    assert "gravity : float or mapping" in inspect.getdoc(imuloop.calibrate)
    assert inspect.getdoc(imuloop.calibrate).startswith("calibrate(t: ")


def test_importing_the_package_loads_no_array_library():
    code = "import sys, imuloop; print({'numpy', 'pandas', 'scipy', 'pyarrow'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
