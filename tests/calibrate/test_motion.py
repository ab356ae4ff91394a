"""The motion between the rests: known effects come back."""

import numpy as np
import pytest

from bench.study import physics
from bench.study.devices import Injected, with_effects
from calibrate.devices import plan_session, recording, true_fit, without_noise
from imuloop.model.effect import find_effect
from imuloop.model.effects import SensorEffect
from imuloop.simulate.truth import example_truth

NAMES = ("lever_arm", "time_offset", "rate_sensitivity", "gyro_axis_delay", "anisoinertia")
# of the size of their detection limits, SI
SIZE = dict(zip(NAMES, (1e-3, 3e-4, 5e-3, 5e-4, 2e-3), strict=True))


def short_moves(rate=200.0, poses=20):
    """Return a device whose moves last 1 to 2 s."""
    plan = {"poses": poses, "move_s": (1.0, 2.0), "turns_about_vertical": 0, "temperature": None}
    return plan_session(example_truth(rate=rate), **plan)


def values(name, seed=0):
    effect = find_effect(name)()
    drawn = SIZE[name] * np.random.default_rng(seed).uniform(0.5, 1.5, len(effect.parameters))
    return effect, dict(zip(effect.parameters, drawn.tolist(), strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_what_was_put_in_comes_back(name):
    effect, true = values(name)
    truth = inject_effect(name, true, without_noise(short_moves(poses=30)))
    one = recording(truth, 2)
    effect = SensorEffect(effect, effect.sensors[0])
    fitted = true_fit(truth, one)[0].fit(one, (effect,)).x[-len(true) :]
    np.testing.assert_allclose(fitted, [*true.values()], rtol=0.02, atol=0.01 * SIZE[name])


def inject_effect(name, true, truth):
    extra = lambda now: physics.EFFECTS[name](now, true, {})  # noqa: E731
    return with_effects(truth, [Injected(find_effect(name).sensors[0], name, true, extra=extra)])
