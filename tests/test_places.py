"""A mistake is named as the user wrote it: a config's key, an option or an argument of Python."""

import re
from contextlib import suppress

import pytest

import imuloop
from imuloop import chain
from imuloop.__main__ import main
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from ingest.logs import FORCE, brief


def scale_columns(factor, *columns):
    def harm(log):
        log[list(columns)] *= factor
        return log

    return harm


def rename_columns(**names):
    return lambda log: log.rename(columns=names)


# change of a sound log, declarations, and the name in the message of each place
MISTAKES = {
    "no stamps": (
        *(rename_columns(t="u"), {}),
        ("columns.time, or give rate in Hz", "--columns.time, or give --rate in Hz"),
        "columns={'time': …}, or give rate in Hz",
    ),
    "stamps in ms": (
        *(scale_columns(1e3, "t"), {}),
        ("declare units.time: ms", "declare --units.time ms"),
        "declare units={'time': 'ms'}",
    ),
    "no gyroscope": (
        *(rename_columns(gx="u", gy="v", gz="w"), {}),
        (
            "both files where another holds it, file: {acceleration: FILE, angular_rate: FILE}, "
            "or declare columns.angular_rate: null",
            "both files where another holds it, acceleration=FILE,angular_rate=FILE, "
            "or declare --columns.angular_rate null",
        ),
        "holds it, {'acceleration': FILE, 'angular_rate': FILE}, or declare columns={'angular_rate'"
        ": None}",
    ),
    "a unit that is none": (
        *(brief, {"units": {"time": "sec"}}),
        ("units.time: 'sec' is not a unit", "--units.time: 'sec' is not a unit"),
        "units={'time': …}: 'sec' is not a unit",
    ),
    "g taken as m/s^2": (
        *(scale_columns(1 / 9.80665, *FORCE), {}),
        ("see units.acceleration", "see --units.acceleration"),
        "see units={'acceleration': …}",
    ),
    "counts without a scale": (
        *(brief, {"units": {"acceleration": "count"}}),
        ("needs nominal.acceleration.scale", "needs --nominal.acceleration.scale"),
        "needs nominal={'acceleration': {'scale': …}}",
    ),
}


@pytest.fixture(params=MISTAKES)
def mistake(request, tmp_path):
    harm, declared, shared, in_python = MISTAKES[request.param]
    log = harm(brief()) if harm is not brief else brief()
    log.to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv", declared, (*shared, in_python)


def test_in_the_workflow_it_is_a_key(mistake, tmp_path):
    path, declared, (key, *_) = mistake
    device = chain.Device("board", tmp_path, {"poses": "multi_position"})
    chain.ingest(device, "poses", declared, [path], reject=True)
    quality = read_json(device.sessions["poses"]["quality"])
    assert key in " ".join([*quality["reasons"], *quality["warnings"]])


def test_on_the_command_line_it_is_an_option(mistake, capsys):
    path, declared, (_, option, _) = mistake
    options = [f"--units.{q}={unit}" for q, unit in declared.get("units", {}).items()]
    with suppress(SystemExit):
        main(["info", str(path), *options])
    printed = "".join(capsys.readouterr())
    assert option in printed
    assert not re.search(r"[^-](columns|units|nominal)\.\w|log/log", printed)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_in_python_it_is_an_argument(mistake):
    path, declared, (*_, argument) = mistake
    try:
        result = imuloop.calibrate(path, **declared, progress=False)
        text = " ".join([*result.failures, *result.notes])
    except ImuloopError as error:
        text = str(error)
    assert argument in text and not re.search(r"(columns|units|nominal)\.\w", text)
