"""The C header: compiled without a warning, it computes what the calibration does."""

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from export.devices import HOSTILE, device, g_sensitivity, unknown
from export.warm_device import SENSORS, carried, warm_device, warm_samples
from imuloop.core.effect import Channels
from imuloop.core.errors import Lacking
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.export import c_header

# reads raw values of both sensors and the temperature, writes calibrated ones, as doubles
PROGRAM = """
#include <stdio.h>
#include "imu_calibration.h"
#include "imu_calibration.h"
int main(void)
{
    double in[7], out[6];
    while (fread(in, sizeof in, 1, stdin) == 1) {
        NAME_accelerometer(in, in[6], out);
        NAME_gyroscope(in + 3, in[6], out, out + 3);
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2")


@pytest.fixture
def compiler():
    """Return the path of a C compiler."""
    found = shutil.which("cc")
    if found is None:
        pytest.skip("no C compiler `cc` on this machine")
    return found


def raw_values(board, table):
    """Return samples in the units as logged: of each sensor, shape (n, 3), and temperatures."""
    raw = [
        board.sensor(name).raw_unit.from_si(table[list(columns)].to_numpy())
        for name, columns in zip(SENSORS, (ACCELERATION, ANGULAR_RATE), strict=True)
    ]
    known = "temperature" in table
    return *raw, table["temperature"].to_numpy() if known else np.full(len(table), np.nan)


def calibrated(compiler, board, table, folder):
    """Return what the compiled header makes of samples, shape (n, 6)."""
    (folder / c_header.FILE).write_text(c_header.text(board), encoding="utf-8")
    name = board.device.replace("-", "_")
    (folder / "main.c").write_text(PROGRAM.replace("NAME", name))
    made = subprocess.run(
        [compiler, *FLAGS, "main.c", "-o", "main"], cwd=folder, capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    given = np.ascontiguousarray(np.column_stack(raw_values(board, table))).tobytes()
    done = subprocess.run([folder / "main"], input=given, capture_output=True, check=True)
    return np.frombuffer(done.stdout).reshape(-1, 6)


def read(board, table):
    """Return what the header's numbers and terms make of samples, its text taken for Python."""
    text = c_header.text(board)
    numbers = {
        name: np.array(eval(values.translate(str.maketrans("{}", "[]"))))
        for name, values in re.findall(r"static const double (\w+)(?:\[3\])+ = (.*);", text)
    }
    terms = re.findall(r"y\[i\] = (output.*);", text)
    *raw, temperature = raw_values(board, table)
    found, f = [], None
    for name, term, values in zip(SENSORS, terms, raw, strict=True):
        T, K, b = (numbers[f"{board.device}_{name}_{symbol}"] for symbol in "TKb")
        output = K * (values - b)
        # an axis at a time, as in the function
        known = {"temperature": temperature, "f": f, c_header.HELD: kept} | numbers
        y = [eval(term, known | {"output": output[:, i], "i": i}) for i in range(3)]
        found.append(np.column_stack(y) @ T.T)
        f = found[0].T
    return np.hstack(found)


def kept(x, low, high):
    return np.where(x == 0, 0.0, np.clip(x, low, high))


def agrees(found, board, table):
    """Check values, shape (n, 6), against the calibration's, to rounding."""
    columns = [*ACCELERATION, *ANGULAR_RATE]
    expected = board.calibration.apply(table)[columns].to_numpy()
    # relative to the largest of a sensor: sums of terms cancel
    size = np.repeat([np.abs(expected[:, :3]).max(), np.abs(expected[:, 3:]).max()], 3)
    assert (np.abs(found - expected) <= 1e-14 * size).all()


def narrow_device():
    """Return the warm device, its effects seen in the middle of the temperatures and in 0.5 g."""
    board, low, high = warm_device(), 10.0, 30.0
    n = 200
    temperature = np.linspace(low, high, n)
    phase = np.linspace(0, 6, n)[:, None] + np.arange(3)
    f = 4.9 * np.sin(phase)
    seen = [Channels(np.zeros(n), f, f, temperature)]
    sensors = {
        name: replace(
            board.sensor(name), effects=tuple(e.held_to(seen) for e in board.sensor(name).effects)
        )
        for name in SENSORS
    }
    return replace(board, calibration=replace(board.calibration, **sensors))


@pytest.mark.parametrize("compiled", [True, False])
def test_effects_are_held_to_what_the_data_showed(compiled, tmp_path, request):
    board, table = narrow_device(), warm_samples()
    free = warm_device().calibration.apply(table)
    assert np.abs(free - board.calibration.apply(table)).max().max() > 1e-3
    if compiled:
        agrees(
            calibrated(request.getfixturevalue("compiler"), board, table, tmp_path), board, table
        )
    else:
        agrees(read(board, table), board, table)


@pytest.mark.parametrize("make", [warm_device, device], ids=["warm", "no temperature"])
def test_it_computes_what_the_calibration_does(make, compiler, tmp_path):
    board, table = make(), warm_samples()
    if make is device:
        del table["temperature"]
    agrees(calibrated(compiler, board, table, tmp_path), board, table)


@pytest.mark.parametrize("make", [warm_device, device], ids=["warm", "no temperature"])
def test_numbers_and_terms_are_those_of_the_calibration(make):
    board, table = make(), warm_samples()
    agrees(read(board, table), board, table)


def test_effects_with_a_memory_are_left_out_and_said(compiler, tmp_path):
    from imuloop.core.effect import FittedEffect, find_effect

    shape = find_effect("bias_temperature_rate")(tau=30.0)
    lag = FittedEffect(shape, dict.fromkeys(shape.parameters, 0.1), {})
    board, table = warm_device(gyroscope=(g_sensitivity(), lag)), warm_samples()
    found = calibrated(compiler, board, table, tmp_path)
    applied = carried(board, tuple(c_header.EFFECTS), aligned=True).apply(table)
    np.testing.assert_allclose(found[:, 3:], applied[list(ANGULAR_RATE)], rtol=0, atol=1e-14 * 4)
    assert "Not carried of the gyroscope: bias_temperature_rate" in c_header.text(board)


@pytest.mark.parametrize("label", [HOSTILE, "*/ int x; /*", "/*/", "**/", "*??/", "a // b \\"])
def test_a_label_stays_a_comment(label, compiler, tmp_path):
    board, table = device(label), warm_samples()
    same = calibrated(compiler, replace(device(), device="board-2"), table, tmp_path)
    np.testing.assert_array_equal(calibrated(compiler, board, table, tmp_path), same)


def test_numbers_read_back_to_the_last_bit():
    board = device()
    text = c_header.text(board)
    for name in SENSORS:
        line = next(x for x in text.splitlines() if f"board_{name}_b[3]" in x)
        found = [float(x) for x in line.split("{")[1].split("}")[0].split(",")]
        assert found == board.sensor(name).b.tolist()


def test_no_file_of_what_was_not_measured():
    with pytest.raises(Lacking, match="no calibration"):
        c_header.text(unknown())
