"""The C header: compiled without a warning, it computes what the calibration does."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from export.devices import (
    C_HEADER,
    HOSTILE,
    calibration_with,
    device,
    g_sensitivity,
    narrow_device,
    turning_device,
    warm_device,
    warm_samples,
    with_sensor,
)
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.effects.products import Product
from imuloop.export.c_code import CARRIED, needs_rate
from imuloop.model.effect import Channels, FittedEffect, find_effect

# reads raw values of both sensors and the temperature, writes calibrated ones, as doubles
PROGRAM = """
#include <stdio.h>
#include "imu_calibration.h"
#include "imu_calibration.h"
int main(void)
{
    /* raw of both sensors, temperature, rate and its change */
    double in[13], out[6];
    while (fread(in, sizeof in, 1, stdin) == 1) {
        NAME_accelerometer(in, in[6], RATES out);
        NAME_gyroscope(in + 3, in[6], out, out + 3);
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2")


@pytest.fixture
def calibrated(tmp_path):
    """Return a function: what the compiled header of a device makes of samples, shape (n, 6)."""
    compiler = shutil.which("cc") or pytest.skip("no C compiler `cc` on this machine")

    def run(board, table):
        (tmp_path / C_HEADER.file).write_text(C_HEADER.text(board), encoding="utf-8")
        turning = needs_rate(
            {"name": "accelerometer", "effects": board.calibration.accelerometer.effects}
        )
        program = PROGRAM.replace("RATES", "in + 7, in + 10," if turning else "")
        (tmp_path / "main.c").write_text(program.replace("NAME", board.device.replace("-", "_")))
        command = [compiler, *FLAGS, "main.c", "-o", "main"]
        compiled = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert compiled.returncode == 0, compiled.stderr
        raw = [
            board.sensor(name).raw_unit.from_si(table[list(columns)])
            for name, columns in SENSORS.items()
        ]
        temperature = table.get("temperature", np.full(len(table), np.nan))
        rate = board.sensor("gyroscope").aligned(table[list(SENSORS["gyroscope"])].to_numpy())
        change = np.gradient(rate, table["t"], axis=0)
        values = np.ascontiguousarray(np.column_stack([*raw, temperature, rate, change])).tobytes()
        done = subprocess.run([tmp_path / "main"], input=values, capture_output=True, check=True)
        return np.frombuffer(done.stdout).reshape(-1, 6)

    return run


def without_a_range_of_some(board):
    for name, lacking in (("accelerometer", {"c1y", "sTz"}), ("gyroscope", {"c2x", "G12"})):
        effects = tuple(
            replace(e, ranges={k: ends for k, ends in e.ranges.items() if k not in lacking})
            for e in board.sensor(name).effects
        )
        board = with_sensor(board, name, effects=effects)
    return board


def held_arms():
    t, w = np.arange(200) / 200, np.random.default_rng(1).uniform(-1.7, 1.7, (200, 3))
    board, seen = turning_device(), [Channels(t, w, w)]
    effects = tuple(e.with_ranges(seen) for e in board.sensor("accelerometer").effects)
    return turning_device(board, effects)


def products(formula="f_y² f_z"):
    """Return a device each of whose sensors has products, one of them held to a range."""
    board = warm_device()
    for name, formulas in (
        ("accelerometer", ((formula, "x"), ("θ f_x", "y"))),
        ("gyroscope", (("w_x f_y", "z"), ("θ w_x w_z", "x"), ("f_z³", "y"))),
    ):
        effects = [
            FittedEffect(Product(*one, name, 21.0), {f"c{one[1]}": 2e-5 * (k + 1)}, {})
            for k, one in enumerate(formulas)
        ]
        effects[0] = replace(effects[0], ranges={f"c{formulas[0][1]}": (-40.0, 60.0)})
        board = with_sensor(board, name, effects=(*board.sensor(name).effects, *effects))
    return board


BOARDS = {
    "products": products(), "of the rate": products("f_x w_y w_z"), "no temperature": device(),
    "held": narrow_device(), "held in part": without_a_range_of_some(narrow_device()),
    "turning": turning_device(), "turning, held": held_arms(),
}  # fmt: skip


@pytest.mark.parametrize("board", BOARDS.values(), ids=BOARDS)
def test_it_computes_what_the_calibration_does(board, calibrated):
    table = (
        warm_samples() if board.temperature_range else warm_samples().drop(columns="temperature")
    )
    expected = board.calibration.apply(table)[list(CHANNELS)].to_numpy()
    # relative to the largest of a sensor: sums of terms cancel
    size = np.repeat([np.abs(expected[:, :3]).max(), np.abs(expected[:, 3:]).max()], 3)
    assert (np.abs(calibrated(board, table) - expected) <= 1e-14 * size).all()


def test_effects_with_a_memory_are_left_out_and_said(calibrated):
    variant = find_effect("bias_temperature_rate")(tau=30.0)
    lag = FittedEffect(variant, dict.fromkeys(variant.parameters, 0.1), {})
    board, table = warm_device(gyroscope=(g_sensitivity(), lag)), warm_samples()
    applied = calibration_with(board, CARRIED).apply(table)[list(CHANNELS)]
    np.testing.assert_allclose(calibrated(board, table), applied, rtol=0, atol=1e-14 * 40)
    assert "Not carried of the gyroscope: bias_temperature_rate" in C_HEADER.text(board)


@pytest.mark.parametrize("label", [HOSTILE, "*/ int x; /*", "*??/"])
def test_a_label_stays_a_comment(label, calibrated):
    table = warm_samples()
    same = calibrated(replace(device(), device="board-2"), table)
    np.testing.assert_array_equal(calibrated(device(label), table), same)
