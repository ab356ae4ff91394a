"""The figures of a device: what they are shown against, and that captions hold the results."""

import numpy as np
import pandas as pd
import pytest

from imuloop.plan.directions import direction_words, largest_hole
from imuloop.report.figures.allan import allan_pictures
from imuloop.report.figures.poses import pose_picture
from imuloop.report.figures.residuals import residual_pictures
from imuloop.report.numbers import number


def block(device, sensor="gyroscope", part="poses"):
    return device.diagnosis["sensors"][sensor][part]


def plain(text):
    return text.replace("\u202f", " ").replace("\u00a0", " ")


def test_the_largest_hole_is_where_a_pose_is_missing_and_is_in_the_caption(devices):
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    hole, angle = largest_hole(faces)
    assert np.degrees(angle) == pytest.approx(np.degrees(np.arccos(3**-0.5)), abs=2)
    hole, angle = largest_hole(faces[:5])
    assert hole == pytest.approx([0, 0, -1], abs=0.06) and direction_words(hole) == "−z"
    assert np.degrees(angle) == pytest.approx(90, abs=3)
    assert "all six faces are covered" in pose_picture(devices["board"]).caption


def test_residual_pictures_hold_before_and_after(devices):
    device = devices["board"]
    pictures = residual_pictures(device, "gyroscope", block(device))
    rate, turn = (plain(p.caption) for p in pictures)
    # 2.4e-3 to 2e-4 rad/s, 9.1e-3 to 2.4e-3 rad
    assert "falls from 0.138 °/s to 0.0115 °/s" in rate and "pose" in rate
    assert "falls from 0.521° to 0.138°" in turn and "turn" in turn
    table = pd.read_csv(device.figures / "gyroscope_pose_rate.csv")
    worst = table.loc[table["after"].abs().idxmax()]
    assert f"pose {worst['pose']:.0f}." in rate
    # poses on six faces are not diagnosed
    assert set(table["session"]) == {"turns"}
    # each mark says what it is
    assert pictures[0].svg.count("<title>") == len(table)


def test_the_allan_curve_has_its_terms(devices):
    device = devices["board"]
    force, turn = allan_pictures(device, device.sessions[0])
    assert ">line</text>" in force.svg
    # with the values of the table
    for key in "NB":
        value = number(device.noise["axes"]["ax"][key]["value"] * 1e6 / 9.80665)
        assert f">{key} {value}</text>" in force.svg
    assert ">GM</text>" in turn.svg
    assert "hump of a line of 0.0800 Hz (z)." in force.caption
    assert "hump of a Gauss–Markov process, T = 30.0 s (x)." in turn.caption
