"""The motion between the rests of measured recordings: its effects, and where knocks rule."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import cholesky, solve_triangular
from scipy.spatial.transform import Rotation

import imuloop.effects  # noqa: F401  loads the library
from diagnose.models import of_sensor
from imuloop.calibrate.calibrate import start_fit
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, SENSORS
from imuloop.model.calibration import Calibration
from imuloop.model.effect import find_effect
from imuloop.model.state import State
from published.conftest import BOARDS

GRAVITY = 9.81744
FOUND = ("time_offset", "lever_arm", "rate_sensitivity")
# by an independent prototype, with σ: m, s, m/s² per rad/s
PROTOTYPE = {
    "lever_arm": {
        "rxx": (-5.1e-3, 0.6e-3), "rxy": (1.4e-3, 1.0e-3), "rxz": (-5.3e-3, 0.7e-3),
        "ryx": (-4.8e-3, 0.7e-3), "ryy": (0.6e-3, 0.7e-3), "ryz": (-3.6e-3, 0.4e-3),
    },
    "time_offset": {"dt": (-1.00e-3, 0.17e-3)},
    "rate_sensitivity": {"M02": (15.0e-3, 1.5e-3)},
}  # fmt: skip


@pytest.fixture(scope="module")
def xsens(measured_results):
    return measured_results.json("xsens_mti", "diagnosis")["sensors"]["accelerometer"]["motion"]


def test_the_moves_show_three_effects_that_gravity_cannot(xsens):
    residuals = xsens["residuals"]
    assert [e["name"] for e in xsens["effects"]] == [*FOUND]
    vertical = residuals["velocity_vertical"]
    # the choice of effects is nested in the folds
    assert vertical["before"] >= 16e-3 and vertical["after"] <= 8e-3
    both = [np.hypot(*(r[when] for r in residuals.values())) for when in ("before", "after")]
    assert both[1] / both[0] <= 0.75
    assert all(e["ratio_ci95"][1] < 1 for e in xsens["effects"])


def test_their_sizes_are_those_of_a_prototype(xsens):
    for effect in xsens["effects"]:
        for name, (value, std) in PROTOTYPE[effect["name"]].items():
            assert abs(effect["parameters"][name] - value) < 2 * np.hypot(effect["std"][name], std)


@pytest.fixture(scope="module")
def moves(measured_results):
    """The Xsens poses and moves, the fitted pair, and the effects that the poses alone show."""
    recording, noise, base = measured_results.fit_of("xsens_mti")
    units = {s: getattr(base, s).raw_unit for s in SENSORS}
    pair, reasons = start_fit(recording, noise, base.gravity, units)
    assert reasons == {}
    known = of_sensor("gyroscope", find_effect("g_sensitivity")())
    return recording, with_velocities(pair, recording, known), known


def with_velocities(pair, recording, known, moves=slice(None)):
    """Return a JointFit with the velocities of some moves."""
    state = State(pair.start).with_effects(known)
    quiet = np.zeros(len(recording.rotations), dtype=bool)
    quiet[moves] = True
    factors = replace(pair.factors, quiet=quiet).without_rotation(recording, state, pair.noise)
    return replace(pair, factors=factors)


def in_motion():
    effects = [find_effect(name)() for name in FOUND]
    return [own for effect in effects for own in of_sensor(effect.sensors[0], effect)]


def test_two_halves_of_the_moves_say_the_same(moves):
    recording, pair, known = moves
    effects = (*known, *in_motion())
    count, found = sum(len(e.parameters) for e in effects[1:]), []
    for parity in range(2):
        half = with_velocities(pair, recording, known, slice(parity, None, 2))
        fit = half.fit(recording, effects)
        found.append((fit.x[-count:], np.diag(fit.scaled_covariance)[-count:]))
    (first, var_first), (second, var_second) = found
    assert np.all(np.abs(first - second) < 3 * np.sqrt(var_first + var_second))


def test_effects_of_other_moves_do_not_explain_the_velocity(moves):
    recording, pair, known = moves
    start = pair.fit(recording, known)
    at, count = pair.linearise(start, recording), len(start.x)
    values, jacobian = at.residual, np.hstack([at.jacobian, at.columns(in_motion())])
    root = cholesky(at.noise.by(pair.noise), lower=True)
    kinds, m = pair.rows(recording)[1], len(recording.rotations)
    vertical, horizontal = (
        np.flatnonzero(kinds == f"velocity_{k}") for k in ("vertical", "horizontal")
    )

    def square(design):
        """Return χ² less that without the effects."""
        white = solve_triangular(root, np.column_stack([values, design]), lower=True)
        left = white[:, 0] - white[:, 1:] @ np.linalg.lstsq(white[:, 1:], white[:, 0])[0]
        return left @ left

    def fall(shift):
        moved, order = jacobian.copy(), np.roll(np.arange(m), shift)
        for rows, width in ((vertical, 1), (horizontal, 2)):
            own = moved[rows, count:].reshape(m, width, -1)
            moved[rows, count:] = own[order].reshape(m * width, -1)
        return square(jacobian[:, :count]) - square(moved)

    placebo = [fall(shift) for shift in range(1, m)]
    # one of 37 by chance
    assert fall(0) > 1.5 * max(placebo)


def vertical_velocity(samples, recording):
    """Return the vertical velocity that calibrated samples leave of each move, m/s."""
    poses, rotations, found = recording.poses, recording.rotations, []
    t, f, w = (np.array(samples[list(c)]) for c in (("t",), ACCELERATION, ANGULAR_RATE))
    t = t[:, 0]
    for first, start, end in zip(rotations.first, rotations.start_s, rotations.end_s, strict=True):
        still = slice(*np.searchsorted(t, [poses.start_s[first], poses.end_s[first]]))
        own = slice(np.searchsorted(t, start), np.searchsorted(t, end) + 1)
        dt = np.diff(t[own])
        attitude, pushed = Rotation.identity(), [f[own][0]]
        for step, rate, force in zip(dt, (w[own][1:] + w[own][:-1]) / 2, f[own][1:], strict=True):
            attitude = attitude * Rotation.from_rotvec(rate * step)
            pushed.append(attitude.apply(force))
        up = f[still].mean(axis=0) / np.linalg.norm(f[still].mean(axis=0))
        found.append(trapezoid(np.array(pushed) @ up - GRAVITY, t[own]))
    return np.array(found)


def test_a_corrected_file_leaves_less_velocity(measured_results, moves, tmp_path):
    folder, recording = measured_results.of("xsens_mti"), moves[0]
    log, left = folder / "poses" / "samples.parquet", {}
    for name in ("multi_position", "calibration"):
        calibration = Calibration.from_json(folder / f"{name}.json")
        calibration.apply_file(log, tmp_path / f"{name}.parquet")
        pieces = pd.read_parquet(tmp_path / f"{name}.parquet")
        left[name] = np.sqrt((vertical_velocity(pieces, recording) ** 2).mean())
    assert left["multi_position"] > 15e-3 and left["calibration"] < 6e-3


@pytest.mark.parametrize("board", BOARDS)
def test_where_knocks_rule_nothing_is_said_of_motion(measured_results, board):
    for sensor in SENSORS:
        found = measured_results.json(f"mpu9150_{board}", "diagnosis")["sensors"][sensor]["motion"]
        assert found["verdict"] == "not_testable" and "knock" in found["why"]
