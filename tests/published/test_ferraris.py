"""Ferraris session: the six faces of the published section list are found without it."""

import json

import numpy as np
import pandas as pd

FACES = {
    "x_p": (0, 1),
    "x_a": (0, -1),
    "y_p": (1, 1),
    "y_a": (1, -1),
    "z_p": (2, 1),
    "z_a": (2, -1),
}


def test_every_listed_face_is_a_pose_and_turns_are_not(measured, recordings):
    sections = json.loads(recordings("example_ferraris_session_list.json").read_text())
    table = pd.read_parquet(measured.session("ferraris", "faces")["segments"])
    static = table[table["kind"] == "static"]
    for name, section in sections.items():
        start, end = section["start"] / 102.4, section["end"] / 102.4
        overlap = np.minimum(static["end_s"], end) - np.maximum(static["start_s"], start)
        if name.endswith("rot"):
            # the middle third of a turn moves for certain
            middle = (end - start) / 3
            inside = np.minimum(static["end_s"], end - middle) - np.maximum(
                static["start_s"], start + middle
            )
            assert inside.max() <= 0, name
        else:
            assert overlap.max() > 0.5 * (end - start), name


def test_six_faces_calibrate_the_accelerometer(measured, recordings):
    # a second method: the mean of each listed section, its largest component against gravity
    log = pd.read_csv(recordings("example_ferraris_session.csv"))
    sections = json.loads(recordings("example_ferraris_session_list.json").read_text())
    columns = ["acc_x", "acc_y", "acc_z"]
    extremes = np.zeros((3, 2))
    for name, (axis, sign) in FACES.items():
        part = log.iloc[sections[name]["start"] : sections[name]["end"]]
        extremes[axis, (1 - sign) // 2] = part[columns[axis]].mean()
    scale = 2 * 9.80665 / (extremes[:, 0] - extremes[:, 1])
    bias = extremes.mean(axis=1)
    fitted = measured.json("ferraris", "six_position")["accelerometer"]
    assert fitted["method"] == "six_position"
    # tilts of some degrees by hand: 1 - cos of five degrees is 0.4 per cent
    np.testing.assert_allclose(fitted["K"], scale, rtol=4e-3)
    np.testing.assert_allclose(fitted["b"], bias, atol=0.04)
