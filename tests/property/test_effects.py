"""A term more never fits the same data worse."""

from dataclasses import replace

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from calibrate.devices import plan_session, recording
from diagnose.models import of_sensor, pair_of
from imuloop.estimate.least_squares import fit
from imuloop.model.effect import Channels, Effect
from imuloop.simulate.truth import example_truth


def of_two_power_cycles(recording):
    """Return a recording whose second half counts as another power cycle."""
    n = len(recording.poses)
    return replace(recording, poses=replace(recording.poses, power_cycle=2 * np.arange(n) // n))


@pytest.fixture(scope="module")
def warm_recordings():
    """Two recordings that warm up, their pairs of sensors, fits, and the noise of these."""
    truth, found = plan_session(example_truth(), temperature=((0, 18), (150, 33), (500, 21))), []
    for seed in (1, 2):
        one = of_two_power_cycles(recording(truth, seed))
        pair = pair_of(truth, one)
        x = pair.fit(one).x
        found.append((one, pair, x, pair.measure(x, one).at(x).noise.by(pair.noise)))
    return found


@pytest.mark.parametrize("effect", Effect.library.values(), ids=Effect.library.keys())
def test_any_effect_of_the_library_lowers_chi_square(warm_recordings, effect):
    if "poses" not in effect.records:
        # an effect that is not searched for in poses says so, and is not tested further
        # and of axes that sit apart `lever_arm` says it
        assert effect.unobservable or effect.records in ((), ("static_record",), ("reference",))
        return
    for sensor in effect.sensors:
        for one, pair, x, covariance in warm_recordings:
            t = one.poses.mid_s
            own, other = (one.poses.f, one.poses.w)[:: 1 if sensor == "accelerometer" else -1]
            channels = Channels(
                t, own, other, one.poses.temperature, power_cycle=one.poses.power_cycle
            )
            # a scan finds the time of a step
            variants = effect.variants(channels) or (effect(times=(float(t.mean()),)),)
            wide = of_sensor(sensor, variants[-1])
            count = len(wide[0].parameters)
            # by the same noise: weights depend on the fit
            plain, wider = (
                fit(pair.measure(start, one, effects).at, start, covariance)
                for effects, start in (((), x), (wide, np.append(x, np.zeros(count))))
            )
            assert wider.chi2 <= plain.chi2 * (1 + 1e-9)
            assert wider.dof == plain.dof - count
