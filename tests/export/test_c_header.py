"""The C header: compiled without a warning, it computes what the calibration does."""

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from export.devices import HOSTILE, device, g_sensitivity, unknown
from export.warm_device import SENSORS, carried, narrow_device, warm_device, warm_samples
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


def test_what_was_not_seen_of_one_axis_alone_is_not_held_there():
    board, table = narrow_device(), warm_samples()
    for name, lacking in (("accelerometer", {"c1y", "sTz"}), ("gyroscope", {"c2x", "G12"})):
        sensor = board.sensor(name)
        effects = tuple(
            replace(e, seen={k: ends for k, ends in e.seen.items() if k not in lacking})
            for e in sensor.effects
        )
        sensor = replace(sensor, effects=effects)
        board = replace(board, calibration=replace(board.calibration, **{name: sensor}))
    agrees(read(board, table), board, table)


def test_the_range_of_an_effect_is_not_taken_for_that_of_the_logs():
    text = c_header.text(narrow_device())
    assert "Temperatures of the logs: -5 to 45 degC" in text
    assert "bias_temperature was seen from 10 to 30 degC; held to that" in text
    assert re.search(
        "g_sensitivity was seen with f_x from -4.8.* to 4.8.*, f_z .* m/s.2; held", text
    )
    assert "was seen" not in c_header.text(warm_device())


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
