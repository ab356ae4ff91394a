"""Detection limits of static records: the power at the limit."""

import numpy as np
import pytest

from diagnose.records import record, root, search
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.limits import detection_limits
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.effects.ramp import Ramp
from imuloop.effects.warm_up import WarmUp


@pytest.mark.parametrize(
    "effect, name", [(Ramp(), "dz"), (BiasTemperature(1, 20.0), "c1y"), (WarmUp(1200.0), "Ax")]
)
@pytest.mark.parametrize("flicker, walk", [(0, 0), (10, 10)])
def test_an_effect_of_its_limit_is_found_nine_times_in_ten(effect, name, flicker, walk):
    rng, n = np.random.default_rng(8), 120
    made, limits, add = root(n, flicker, walk), [], None
    for _ in range(5):
        rec = record(made @ rng.standard_normal((n, 3)))
        one = search([rec], [effect])
        limits.append(detection_limits(one, (), one.trial((), type(effect)), 0.9)[name])
        add = effect.design(rec.channels)[:, :, list(effect.parameters).index(name)]
    passed, kept = 0, 0
    for _ in range(30):
        values = made @ rng.standard_normal((n, 3)) + np.median(limits) * add
        one = search([record(values)], [effect])
        passed += one.trial((), type(effect)).log_p < one.threshold(0)
        kept += effect in Choices(one.problem).choice().base
    # each record knows its noise only so well; below 19 of 30 has a chance of 1e-5 at 90 %
    assert passed >= kept >= 19
    # and half the limit is found far less often than always
    assert 0.3 < np.min(limits) / np.max(limits)


def test_limits_name_every_parameter_that_an_axis_has():
    rec = record(np.random.default_rng(9).normal(size=(100, 3)))
    effect = BiasTemperature(3, 20.0)
    one = search([rec], [effect])
    found = detection_limits(one, (), one.trial((), BiasTemperature), 0.9)
    assert list(found) == list(effect.parameters)
    assert all(v > 0 for v in found.values())
