"""Data that contradict each other give no calibration, in the diagnosis neither."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import recording
from diagnose.models import pose_result
from imuloop.simulate.truth import example_truth


@pytest.mark.parametrize(("offset", "refused"), [(0.0, False), (5.0, True)])
def test_poses_on_no_ellipsoid_are_not_handed_out(offset, refused, no_limits):
    truth = example_truth()
    made = recording(truth, 0)
    f = made.poses.f + offset * (np.arange(len(made.poses)) % 2)[:, None]
    found = pose_result(truth, replace(made, poses=replace(made.poses, f=f)), folds=5)
    assert ("accelerometer" not in found.calibrations) == refused
    if refused:
        assert found.contents["accelerometer"]["verdict"] == "not_testable"
