"""Detection limits: the power at the limit."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import known_noise, plan_session, recording
from diagnose.models import of_sensor, pair_of, problem_of, variants_of
from diagnose.records import record, root, search
from diagnose.test_search import with_effect
from imuloop.core.noise_model import Coefficient
from imuloop.diagnose.pose_problem import PoseProblem
from imuloop.effects.drifts import BiasDrift, Ramp, WarmUp
from imuloop.effects.temperature import BiasTemperature
from imuloop.estimate.choice import Choices
from imuloop.estimate.limits import detection_limits
from imuloop.simulate.truth import example_truth
from seeds import least_count, seeds

DRIFT = BiasDrift()
DRIFTS = variants_of("accelerometer", DRIFT)
TRUTH = plan_session(example_truth(rate=50.0), poses=30)


@seeds(10, 30)
@pytest.mark.parametrize(
    "effect, name, slow",
    [
        (Ramp(), "dz", 10),
        pytest.param(BiasTemperature(1, 20.0), "c1y", 0, marks=pytest.mark.study),
        pytest.param(WarmUp(1200.0), "Ax", 10, marks=pytest.mark.study),
    ],
)
def test_an_effect_of_its_limit_is_found_nine_times_in_ten(effect, name, slow, seeds):
    rng, n = np.random.default_rng(8), 120
    noise, limits, add = root(n, slow, slow), [], None
    for _ in range(5):
        rec = record(noise @ rng.standard_normal((n, 3)))
        one = search([rec], [effect])
        limits.append(detection_limits(one, (), one.trial((), type(effect)), 0.9)[name])
        add = effect.design(rec.channels)[:, :, list(effect.parameters).index(name)]
    kept = 0
    for _ in range(seeds):
        values = noise @ rng.standard_normal((n, 3)) + np.median(limits) * add
        one = search([record(values)], [effect])
        kept += type(effect) in map(type, Choices(one.problem).choice().effects)
    # each record knows its noise only so well
    assert kept >= least_count(seeds, 0.9, 1e-5)
    assert 0.3 < np.min(limits) / np.max(limits)


def search_drift(size, seed):
    """Return the Choices of a drift on x, by noise of which no walk is known."""
    truth = with_effect("accelerometer", DRIFT, [size, 0.0, 0.0], TRUTH)
    noise, log = known_noise(truth), recording(truth, seed)
    axes = {a: replace(noise.axes[a], K=Coefficient(upper95=1e-3)) for a in ("ax", "ay", "az")}
    pair = pair_of(truth, log, replace(noise, axes=noise.axes | axes))
    return Choices(replace(problem_of(pair, log, DRIFTS), tests=20))


def limit_of(choices):
    (kind,) = DRIFTS
    return detection_limits(choices, (), choices.trial((), kind), 0.9)["dx"]


@seeds(3, 12)
def test_a_drift_of_its_limit_at_the_poses_is_found_though_a_walk_looks_like_it(seeds, monkeypatch):
    limit = np.median([limit_of(search_drift(0.0, seed)) for seed in range(3)])
    added = of_sensor("accelerometer", DRIFT)
    hits = [search_drift(limit, 10 + seed).choice().effects == added for seed in range(seeds)]
    assert sum(hits) >= least_count(seeds, 0.9, 1 / 35)
    monkeypatch.setattr(PoseProblem, "is_like_slow_noise", lambda self, effect: False)
    assert np.median([limit_of(search_drift(0.0, seed)) for seed in range(3)]) < limit / 2
