"""Ferraris session: the six faces are found without the published list of sections.

That each listed face is a pose, and no turn is, tests/segment/test_recordings.py has.
"""

import json
from itertools import product

import numpy as np
import pandas as pd


def test_six_faces_calibrate_the_accelerometer(measured, recordings):
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
    fitted = measured.json("ferraris", "six_position")["accelerometer"]
    assert fitted["method"] == "six_position"
    # tilts of some degrees by hand: 1 - cos of five degrees is 0.4 per cent
    np.testing.assert_allclose(fitted["K"], scale, rtol=4e-3)
    np.testing.assert_allclose(fitted["b"], bias, atol=0.04)
