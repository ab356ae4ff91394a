"""Ferraris session: faces and turns, compared with the published list and imucal's result.

That each listed face is a pose, and no turn is, tests/segment/test_recordings.py has.
"""

import json
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pandas as pd
import pytest

from calibrate.test_known_rotation import calibrate_device
from imuloop.calibrate.known_rotation import read_turns
from imuloop.model.calibration import Calibration

# scale factors by imucal 2.6.0, FerrarisCalibration of its example session: logged over true
IMUCAL = np.array([1.027924, 0.982428, 0.99831])
RATE = 102.4
# largest error of the prediction of a held-out turn of 360 degrees
ASKED = 0.5


def test_six_faces_calibrate_the_accelerometer(measured_results, recordings):
    # a second method: the mean of each listed section, its largest component against gravity
    log = pd.read_csv(recordings("example_ferraris_session.csv"))
    sections = json.loads(recordings("example_ferraris_session_list.json").read_text())
    columns = ["acc_x", "acc_y", "acc_z"]
    extremes = np.zeros((3, 2))
    # each axis along gravity, x_p, and against it, x_a
    for axis, side in product(range(3), range(2)):
        section = sections[f"{'xyz'[axis]}_{'pa'[side]}"]
        part = log.iloc[section["start"] : section["end"]]
        extremes[axis, side] = part[columns[axis]].mean()
    scale = 2 * 9.80665 / (extremes[:, 0] - extremes[:, 1])
    bias = extremes.mean(axis=1)
    fitted = measured_results.json("ferraris", "six_position")["accelerometer"]
    assert fitted["method"] == "six_position"
    # tilts of some degrees by hand: 1 - cos of five degrees is 0.4 per cent
    np.testing.assert_allclose(fitted["K"], scale, rtol=4e-3)
    np.testing.assert_allclose(fitted["b"], bias, atol=0.04)


@pytest.fixture(scope="module")
def device_with_turns(recordings, tmp_path_factory):
    """What gives the device with the turns about some axes, by numbers, and its other kinds."""
    path = recordings("example_ferraris_session.csv")
    marks = json.loads(recordings("example_ferraris_session_list.json").read_text())
    declared = {
        "columns": {
            "acceleration": ["acc_x", "acc_y", "acc_z"],
            "angular_rate": ["gyr_x", "gyr_y", "gyr_z"],
        },
        "units": {"angular_rate": "deg/s"},
        "rate": RATE,
    }

    @cache
    def device(axes, *others):
        # about each axis backwards
        sections = [
            {"axis": f"-{axis}", "angle": 360}
            | {end: marks[f"{axis}_rot"][end] / RATE for end in ("start", "end")}
            for axis in (f"{'xyz'[k]}" for k in axes)
        ]
        kinds = dict(zip(others, others, strict=True)) | {"turns": "known_rotation"}
        told = declared | {"known_rotation": sections}
        return calibrate_device(
            tmp_path_factory.mktemp("f"), kinds, told, dict.fromkeys(kinds, path)
        )

    return device


def gyroscope(device):
    return Calibration.from_json(device.file("multi_position.json")).gyroscope


def test_turns_have_the_scale_that_imucal_finds(device_with_turns):
    fitted = gyroscope(device_with_turns(range(3), "six_position"))
    assert fitted.method == "known_rotation"
    np.testing.assert_allclose(np.radians(1) / fitted.K, IMUCAL, rtol=3e-4)
    # imucal refers T to the turns as if they were square to each other: to 1 degree they are
    assert np.abs(fitted.T - np.eye(3)).max() < 0.02


@pytest.mark.study
@pytest.mark.parametrize("axis", range(3))
def test_turn_held_out_is_off_by_what_imucal_foresees(device_with_turns, axis):
    device = device_with_turns(range(3), "six_position")
    force = Calibration.from_json(device.file("six_position.json")).accelerometer
    turns = read_turns(device.sessions, force)
    rest = tuple({*range(3)} - {axis})

    def error(calibration):
        """Return the error of a calibration about the turn's own axis, degrees, backwards."""
        return -np.degrees(turns.errors(calibration)[axis, axis])

    # one turn about each axis: without one nothing says its scale factor but the data sheet
    alone = gyroscope(device_with_turns(rest, "six_position"))
    assert alone.method == "nominal"
    error_alone = error(replace(alone, b=alone.raw_unit.from_si(turns.bias)))
    assert error_alone == pytest.approx(360 * (IMUCAL[axis] - 1), abs=0.15)
    assert abs(error_alone) > ASKED
    # the moves between the faces do, as far as gravity's direction by six faces is right
    both = gyroscope(device_with_turns(rest, "six_position", "multi_position"))
    assert both.method == "multi_position"
    foreseen = 360 * (IMUCAL[axis] * both.K[axis] / np.radians(1) - 1)
    assert error(both) == pytest.approx(foreseen, abs=0.15)
    # about y alone within the bound
    assert (abs(error(both)) < ASKED) == (axis == 1)
    assert abs(error(both)) == pytest.approx([0.72, 0.26, 0.81][axis], abs=0.01)
