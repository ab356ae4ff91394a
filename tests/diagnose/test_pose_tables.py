"""The tables of poses and moves hold what was measured and the errors of the diagnosis."""

import numpy as np
import pytest

from calibrate.devices import plan_session, recording
from diagnose.models import pose_result
from diagnose.test_search import with_g_sensitivity
from imuloop.core.units import DEGREE
from imuloop.diagnose.tables import moves_table, poses_table
from imuloop.simulate.simulate import true_motion
from imuloop.simulate.truth import example_truth

TRUTH = with_g_sensitivity(plan_session(example_truth(), poses=20), np.eye(3) * 4e-4)


@pytest.fixture(scope="module")
def result():
    """The PoseResult of a device, its recording, and the tables of poses and of moves."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("imuloop.diagnose.content.detection_limits", lambda *a, **k: {"any": 0.0})
        log = recording(TRUTH, 1)
        diagnosed = pose_result(TRUTH, log, folds=3)
    turn, force = diagnosed.calibrations["gyroscope"], log.rotations.f
    tables = (
        poses_table(log.poses, ["s"], diagnosed.residuals),
        moves_table(log, ["s"], turn, force, diagnosed.residuals),
    )
    return diagnosed, log, tables


def test_rows_are_the_true_rests_and_turns(result):
    _, log, (poses, moves) = result
    motion = true_motion(TRUTH, "multi_position", 1)
    for end in ("start_s", "end_s"):
        np.testing.assert_allclose(poses[end], motion.rests[end], atol=0.3)
    assert poses["session"].tolist() == ["s"] * len(log.poses)
    assert poses["pose"].tolist() == [*range(len(log.poses))]
    assert moves["pose"].tolist() == log.rotations.first.tolist()
    still = np.searchsorted(motion.t, motion.rests["start_s"] + 0.5)
    rates = np.linalg.norm(motion.angular_rate, axis=1)
    for k, first in enumerate(moves["pose"]):
        speeds = rates[still[first] : still[first + 1]]
        assert moves["speed_rad_s"][k] == pytest.approx(speeds.max(), abs=DEGREE)
        # a turn about one axis, or with some wobble
        assert moves["angle_rad"][k] <= speeds.sum() / TRUTH.rate + DEGREE
    axes = np.column_stack([moves[f"axis_{x}"] for x in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1)
