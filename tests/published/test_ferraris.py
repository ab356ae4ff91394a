"""Ferraris session: the six faces are found without the published list of sections.

That each listed face is a pose, and no turn is, tests/segment/test_recordings.py has.
"""

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
