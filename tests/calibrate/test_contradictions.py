"""No turn is judged by what poses and turns do not determine.

Logs of which turns contradict each other, tests/diagnose/test_devices.py has.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import plan_session, record_samples
from imuloop.calibrate.contradictions import odd_turns
from imuloop.simulate.truth import example_truth
from plan.planned_log import simulate_plan, turns_between

TRUTH = plan_session(example_truth(rate=50.0), poses=30)


@pytest.mark.parametrize("tilt", [3e-2, 3e-4])
def test_no_turn_contradicts_where_the_direction_of_gravity_is_not_known(tilt):
    """Faces x and y by turns about z, and z itself at the end: nine parameters are open."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        angle = np.pi / 2 * np.cumsum(rng.choice([1, -1, 2], 20))
        up = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(20)])
        up += rng.normal(0, tilt, (20, 3))
        up[-1] = 0.1, -0.1, 1.0
        up /= np.linalg.norm(up, axis=1)[:, None]
        recording = record_samples(simulate_plan(TRUTH, up[0], turns_between(up), seed))
        for size in (1e-3, 3e-3):
            norm = 1 + rng.normal(0, size, len(recording.poses))
            poses = replace(recording.poses, f=recording.poses.f * norm[:, None])
            assert not odd_turns(replace(recording, poses=poses))[0].any()
