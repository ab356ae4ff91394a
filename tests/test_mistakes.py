"""Plausible mistakes: one line each, with the cause, named as the user wrote it."""

import inspect
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import imuloop
from imuloop import chain
from imuloop.__main__ import main
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.core.samples import CHANNELS
from ingest.harm import harmed
from ingest.logs import brief

MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))
LOG = brief(400)
T, F, W = LOG.t.to_numpy(), LOG[[*CHANNELS[:3]]].to_numpy(), LOG[[*CHANNELS[3:]]].to_numpy()


@pytest.fixture
def log(tmp_path):
    LOG.to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv"


@pytest.mark.filterwarnings("ignore:.*too much for a turn by hand")
@pytest.mark.parametrize("mistake", MISTAKES["python"].values(), ids=MISTAKES["python"])
def test_a_mistake_in_python_is_one_line_with_its_cause(mistake, log, recwarn):
    half = log.with_name("half.csv")
    LOG.rename(columns={"gx": "u", "gy": "v", "gz": "w"}).to_csv(half, index=False)
    twice = pd.DataFrame(np.ones((9, 3)), columns=["t", "ax", "ax"])
    names = {"T": T, "F": F, "W": W, "F.T": F.T, "W.T": W.T, "FEW": np.ones(5), "PATH": log}
    names |= {"HALF": half, "TWICE": twice, "PAIR": ("a.csv", "b.csv")}

    def named(value):
        return names.get(value, value) if isinstance(value, str) else value

    logs = map(named, mistake.get("given", ["T", "F", "W"]))
    how = {key: named(value) for key, value in mistake.get("how", {}).items()}
    with pytest.raises(ImuloopError) as raised:
        imuloop.calibrate(*logs, **how, progress=False)
    line = str(raised.value)
    assert mistake["says"] in line and "\n" not in line
    # nothing of where a log in memory was put
    assert "/imuloop-" not in line
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]


ALLAN = {"text": ("x", 1), "no rate": (F, 0), "three dimensions": (np.ones((9, 9, 9)), 1)}


@pytest.mark.parametrize("name", ALLAN)
def test_what_has_no_allan_deviation(name):
    with pytest.raises(ImuloopError, match=r"^(values|rate): "):
        imuloop.allan(*ALLAN[name])


def test_what_is_read_and_applied_by_mistake(log):
    with pytest.raises(ImuloopError, match="tuple is not a log"):
        imuloop.read(("a.csv", "b.csv", "x"))
    with pytest.raises(ImuloopError, match="same length"):
        imuloop.read({"t": T, "ax": T[1:]})
    with pytest.raises(ImuloopError, match="unit: unknown key; did you mean 'units'"):
        imuloop.read(log, unit={"acceleration": "g"})
    nominal = imuloop.model.sensor_calibration.SensorCalibration.nominal
    raw = imuloop.core.units.RawUnit
    sensors = [nominal(raw(unit, 1.0), "no log") for unit in ("m/s^2", "rad/s")]
    with pytest.raises(ImuloopError, match=r"not ndarray: imuloop\.read"):
        imuloop.Calibration("d", 9.8, *sensors).apply(F)
    with pytest.raises(ImuloopError, match=r"none\.parquet: there is no such file"):
        imuloop.Calibration("d", 9.8, *sensors).apply_file("none.parquet", log, nominal=True)


@pytest.mark.parametrize(("command", "cause"), MISTAKES["command"].items())
def test_a_mistake_on_the_command_line_is_one_line(command, cause, log, tmp_path, capsys):
    (tmp_path / "calibration.json").write_text("{}")
    names = {"LOG": log, "CALIBRATION": tmp_path / "calibration.json", "OUT": tmp_path / "out"}
    for name, path in names.items():
        command = re.sub(rf"\b{name}\b", str(path), command)
        cause = re.sub(rf"\b{name}\b", str(path), cause)
    try:
        status = main(command.split())
    except SystemExit as stopped:
        status = stopped.code
    assert status in (1, 2)
    printed = capsys.readouterr()
    [line] = printed.err.splitlines()
    assert cause in line and not printed.out


# --- the same mistake, named for each place


@pytest.fixture(params=MISTAKES["places"].values(), ids=MISTAKES["places"])
def mistake(request, tmp_path):
    harmed(brief(), request.param.get("harm", {})).to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv", request.param.get("declared", {}), request.param


def test_in_the_workflow_it_is_a_key(mistake, tmp_path):
    path, declared, names = mistake
    device = chain.Device("board", tmp_path, {"poses": "multi_position"})
    chain.ingest(device, "poses", declared, [path], reject=True)
    quality = read_json(device.sessions["poses"]["quality"])
    assert names["key"] in " ".join([*quality["reasons"], *quality["warnings"]])


def test_on_the_command_line_it_is_an_option(mistake, capsys):
    path, declared, names = mistake
    options = [f"--units.{q}={unit}" for q, unit in declared.get("units", {}).items()]
    with suppress(SystemExit):
        main(["info", str(path), *options])
    printed = "".join(capsys.readouterr())
    assert names["option"] in printed
    assert not re.search(r"[^-](columns|units|nominal)\.\w|log/log", printed)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_in_python_it_is_an_argument(mistake):
    path, declared, names = mistake
    try:
        result = imuloop.calibrate(path, **declared, progress=False)
        text = " ".join([*result.failures, *result.notes])
    except ImuloopError as error:
        text = str(error)
    assert names["argument"] in text and not re.search(r"(columns|units|nominal)\.\w", text)


def test_the_call_is_documented_as_its_function():
    from imuloop.calibrate_logs import calibrate

    assert inspect.signature(imuloop.calibrate) == inspect.signature(calibrate)
    assert "gravity : float or mapping" in inspect.getdoc(imuloop.calibrate)


def test_importing_the_package_loads_no_array_library():
    code = "import sys, imuloop; print({'numpy', 'pandas', 'scipy', 'pyarrow'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
