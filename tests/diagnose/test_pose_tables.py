"""The tables of poses and moves hold what was measured and the errors of the diagnosis."""

import numpy as np
import pytest

from calibrate.devices import plan_session, recording
from diagnose.models import pose_result
from diagnose.test_search import with_g_sensitivity
from imuloop.core.units import DEGREE
from imuloop.diagnose.tables import moves_table, no_tables, poses_table
from imuloop.simulate.simulate import true_motion
from imuloop.simulate.truth import example_truth

TRUTH = with_g_sensitivity(plan_session(example_truth(), poses=20), np.eye(3) * 4e-4)


@pytest.fixture(scope="module")
def result():
    """The PoseResult of a device, its recording, and the tables of poses and of moves."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("imuloop.diagnose.content.detection_limits", lambda *a, **k: {"any": 0.0})
        made = recording(TRUTH, 1)
        found = pose_result(TRUTH, made, folds=3)
    turn, force = found.calibrations["gyroscope"], made.rotations.f
    tables = (
        poses_table(made.poses, ["s"], found.residuals),
        moves_table(made, ["s"], turn, force, found.residuals),
    )
    return found, made, tables


def test_rows_are_the_true_rests_and_turns(result):
    _, made, (poses, moves) = result
    motion = true_motion(TRUTH, "multi_position", 1)
    for end in ("start_s", "end_s"):
        np.testing.assert_allclose(poses[end], motion.rests[end], atol=0.3)
    assert poses["session"].tolist() == ["s"] * len(made.poses)
    assert poses["pose"].tolist() == [*range(len(made.poses))]
    assert moves["pose"].tolist() == made.rotations.first.tolist()
    still = np.searchsorted(motion.t, motion.rests["start_s"] + 0.5)
    rates = np.linalg.norm(motion.angular_rate, axis=1)
    for k, first in enumerate(moves["pose"]):
        speeds = rates[still[first] : still[first + 1]]
        assert moves["speed_rad_s"][k] == pytest.approx(speeds.max(), abs=DEGREE)
        # a turn about one axis, or with some wobble
        assert moves["angle_rad"][k] <= speeds.sum() / TRUTH.rate + DEGREE
    axes = np.column_stack([moves[f"axis_{x}"] for x in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1)


def test_without_a_pose_the_columns_are_the_same(result):
    for full, name in zip(result[2], ("poses", "moves"), strict=True):
        empty = no_tables()[name]
        assert {n: x.dtype for n, x in empty.items()} == {n: x.dtype for n, x in full.items()}
        assert not any(map(len, empty.values()))


def test_the_errors_of_the_tables_are_those_of_the_diagnosis(result):
    found, made, tables = result
    assert [e.name for e in found.solution.effects] == ["g_sensitivity"]
    content = {k: r for own in found.contents.values() for k, r in own["residuals"].items()}
    assert set(content) == {"gravity_norm", "pose_rate", "rotation"}
    for kind, residual in content.items():
        table = tables[kind == "rotation"]
        for when in ("before", "after", "in_sample_before", "in_sample_after", "floor"):
            values = table[f"{kind}_{when}"]
            assert np.sqrt(np.mean(values**2)) == pytest.approx(residual[when], rel=1e-9)
            parts = [table[n] for n in table if n.startswith(f"{kind}_{when}_")]
            if parts:
                np.testing.assert_allclose(np.linalg.norm(parts, axis=0), values)
        assert residual["n"] == len(values)
    # too large a norm is above zero
    calibrated = found.calibrations["accelerometer"].apply(made.poses.f)
    left = np.linalg.norm(calibrated, axis=1) - TRUTH.gravity
    np.testing.assert_allclose(tables[0]["gravity_norm_in_sample_after"], left, atol=1e-9)
