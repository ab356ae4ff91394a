"""True motion: angular rate against attitude by its own integrator; where poses lie."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from imuloop.core.errors import ImuloopError
from imuloop.simulate.simulate import true_motion
from imuloop.simulate.truth import Disturbance, SessionTruth, example_truth

GRAVITY = 9.80665


def motion_of(session, seed=0):
    return true_motion(example_truth(sessions={"one": session}), "one", seed)


def matrices(motion, samples):
    return Rotation.from_quat(motion.attitude[samples], scalar_first=True).as_matrix()


def moves(motion):
    """First and last sample, both at rest, of every move."""
    rests = motion.rests
    return [
        (round(end * 100) - 1, round(start * 100))
        for end, start in zip(rests["end_s"], rests["start_s"].iloc[1:], strict=False)
    ]


def test_integrated_rate_gives_the_next_pose():
    motion = motion_of(SessionTruth("multi_position", poses=5, turns_about_vertical=1))
    errors = []
    for first, last in moves(motion):
        t, rate = motion.t[first : last + 1], motion.angular_rate[first : last + 1]
        w = CubicSpline(t, rate)
        # the direction of gravity on body axes: du/dt = -w x u
        u0 = motion.specific_force[first] / GRAVITY
        solution = solve_ivp(
            lambda s, u, w=w: -np.cross(w(s), u),
            (t[0], t[-1]),
            u0,
            "DOP853",
            rtol=1e-10,
            atol=1e-12,
        )
        errors.append(np.linalg.norm(solution.y[:, -1] - motion.specific_force[last] / GRAVITY))
    assert len(errors) == 6
    assert max(errors) < 1e-5
    assert np.max(np.abs(motion.angular_rate)) > 1.0


def test_rests_are_still_and_read_gravity():
    motion = motion_of(SessionTruth("multi_position", poses=10, initial_rest_s=50.0))
    assert motion.rests["end_s"][0] == 50.0
    for start, end, _ in motion.rests.itertuples(index=False):
        samples = slice(round(start * 100), round(end * 100))
        assert not np.any(motion.angular_rate[samples])
        force = matrices(motion, samples)[0].T @ [0, 0, GRAVITY]
        np.testing.assert_allclose(motion.specific_force[samples] - force, 0, atol=1e-9)


def test_six_positions_show_each_face_with_the_placement_error():
    motion = motion_of(
        SessionTruth("six_position", repeats=60, placement_deg=0.2, move_s=(0.5, 0.6))
    )
    up = motion.specific_force[(motion.rests["start_s"] * 100).round().astype(int)] / GRAVITY
    axis = np.argmax(np.abs(up), axis=1)
    sign = np.sign(up[np.arange(len(up)), axis])
    faces, counts = np.unique(sign * (axis + 1), return_counts=True)
    assert list(faces) == [-3, -2, -1, 1, 2, 3] and set(counts) == {60}
    level = np.degrees(up[np.arange(3) != axis[:, None]])
    assert level.std() == pytest.approx(0.2, rel=0.1)


def test_disturbances_come_when_and_as_large_as_asked():
    disturbances = (
        Disturbance("knock", 5.0, 2.0, 0.5),
        Disturbance("tilt", 10.0, 0.5, 1.0, (0, 1, 0)),
        Disturbance("handling", 15.0, 20.0, 4.0),
    )
    motion = motion_of(SessionTruth("static", duration_s=25.0, disturbances=disturbances))
    force = motion.specific_force
    quiet = np.linalg.norm(force - [0, 0, GRAVITY], axis=1)
    assert quiet[:500].max() < 1e-9 and 1.0 < quiet[500:550].max() < 2.0
    assert quiet[550:1000].max() < 1e-9
    # up turns about y by half a degree, for good
    tilted = np.degrees(np.arctan2(force[1100:1500, 0], force[1100:1500, 2]))
    np.testing.assert_allclose(np.abs(tilted), 0.5, rtol=1e-9)
    attitude = matrices(motion, slice(1500, 1900))
    angle = Rotation.from_matrix(attitude[0].T @ attitude).magnitude()
    assert np.degrees(angle.max()) == pytest.approx(20.0, rel=0.1)
    np.testing.assert_allclose(force[1900:], force[1100:1500][:600][:1].repeat(600, 0), atol=1e-9)
    assert list(motion.rests["pose"]) == [0, 0, 1, 1]
    tilt = motion.angular_rate[1000:1100].sum(axis=0) * 0.01
    np.testing.assert_allclose(np.degrees(np.abs(tilt)), [0, 0.5, 0], atol=1e-6)


@pytest.mark.parametrize("times", [(5.0, 5.5), (8.0, 2.0), (1.0, 9.5)])
def test_disturbances_must_fit(times):
    disturbances = tuple(Disturbance("knock", t, 1.0) for t in times)
    with pytest.raises(ImuloopError, match="overlap or leave"):
        motion_of(SessionTruth("static", duration_s=10.0, disturbances=disturbances))
