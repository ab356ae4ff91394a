"""Static records of simulated truth: what fits to them say, the right name, and no name."""

import numpy as np
import pytest

from diagnose.records import LENGTH, record, root, search
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.static import search_records
from imuloop.diagnose.static_problem import cut_at_tilts, fitted_effects
from imuloop.effects.drifts import Ramp
from imuloop.effects.steps import Steps
from imuloop.effects.temperature import BiasTemperature
from imuloop.model.effect import find_effect
from seeds import seeds

N, TESTS = 120, 26
WARM = BiasTemperature(2, 20.0)


def noise(seed, flicker=2.0, walk=5.0, n=N):
    return root(n, flicker, walk) @ np.random.default_rng(seed).standard_normal((n, 3))


def find_effects(values):
    """Return the effects found in values (n, 3), or in values of several sessions by name."""
    values = values if isinstance(values, dict) else {"s": values}
    records = [record(v, session) for session, v in values.items()]
    return search_records("accelerometer", records, DiagnoseSettings(), TESTS)


def names(finding):
    return [e.name for e in finding.effects]


def pattern(name, n=N):
    """Return an effect's values with a parameter of 1 on each axis, (n, 3), and its variant."""
    rec = record(np.zeros((n, 3)))
    fixed = {"ramp": Ramp(), "steps": Steps((70 * LENGTH,), ("s",))}
    variant = fixed.get(name) or find_effect(name).variants(rec.channels)[0]
    at = variant.in_session(rec.channels, "s", rec.windows)
    return at[:, range(3), range(3)], variant


# the others are found by their names in other tests, too
OFTEN = ("bias_temperature", "steps")


@pytest.mark.parametrize(
    "name",
    [
        *("bias_temperature_rate", "thermal_hysteresis", "warm_up", "ramp"),
        *(pytest.param(name, marks=pytest.mark.study) for name in OFTEN),
    ],
)
def test_each_effect_is_found_by_its_name(name):
    add, variant = pattern(name)
    # white noise of a mean is 1/sqrt(60)
    add = add / np.abs(add - add.mean(axis=0)).max() * {"ramp": 6.0}.get(name, 3.0)
    # a warm-up is over after the first block of time: two starts to foresee one, and without it
    sessions = "stu" if name == "warm_up" else "s"
    finding = find_effects({s: noise(k) + add for k, s in enumerate(sessions)})
    assert name in names(finding)
    at = names(finding).index(name)
    assert finding.choices.choice().added[at].change.certain
    assert np.mean(finding.errors[1] ** 2) < 0.5 * np.mean(finding.errors[0] ** 2)
    if name == "steps":
        assert abs(finding.effects[at].effect.times[0] - variant.times[0]) <= LENGTH


@pytest.mark.parametrize("flicker, walk", [(0, 300), (20, 30)])
def test_slow_noise_is_not_taken_for_a_smooth_effect(flicker, walk):
    rng, noise_root, effects = np.random.default_rng(3), root(N, flicker, walk), [Ramp(), WARM]
    p_values = []
    for _ in range(25):
        one = search([record(noise_root @ rng.standard_normal((N, 3)))], effects)
        p_values += [one.test((), effect).p_value for effect in effects]
    # 50 tests of three axes each; at 1 % half a one is expected, five would be one in 1e3 runs
    assert np.sum(np.array(p_values) < 0.01) <= 4
    assert np.sum(np.array(p_values) < 1e-3) <= 1


def test_devices_without_an_effect_have_none():
    kinds = ((0, 0), (5, 0), (0, 5), (3, 3))
    alarms = [names(find_effects(noise(20 + k, *kinds[k % 4]))) for k in range(8)]
    # 2 % of searches of one sensor; two or more of 8 happen in 1 % of such sets
    assert sum(map(bool, alarms)) <= 1


def test_several_steps_are_found():
    values = noise(4)
    for place, height in ((30, 3.0), (80, -4.0)):
        values[place:] += height
    finding = find_effects(values)
    assert names(finding) == ["steps"]
    times = sorted(finding.effects[0].effect.times)
    np.testing.assert_allclose(times, [30 * LENGTH, 80 * LENGTH], atol=LENGTH)


@seeds(10, 40)
def test_estimates_and_their_errors_hold_in_slow_noise(seeds):
    rng, true = np.random.default_rng(4), 0.4
    noise_root, effect = root(N, 10, 20), BiasTemperature(1, 20.0)
    off = []
    for _ in range(seeds):
        rec = record(noise_root @ rng.standard_normal((N, 3)))
        rec.values[:] += true * (rec.channels.temperature - 20)[:, None]
        (one,) = fitted_effects(search([rec], [effect]), (effect,))
        off += [(one.values[name] - true) / one.std[name] for name in ("c1x", "c1y", "c1z")]
    # estimates in units of their standard error: three of each record
    n = len(off)
    assert abs(np.mean(off)) < 3.3 / np.sqrt(n)
    assert -3.9 < (np.std(off) - 1) * np.sqrt(2 * n) < 3.1
    assert np.mean(np.abs(off) < 3) > 0.97


@pytest.mark.parametrize(
    ("start", "change", "lengths"),
    [
        (70, np.zeros(3), [N]),
        (70, [0.0, 0.04, 0.0], [70, 50]),
        # larger gravity afterwards is not a tilt: the bias jumped; a large tilt lowers it
        (70, [0.0, 0.0, 0.04], [N]),
        (70, [0.0, 9.8 * np.sin(0.1), 9.8 * (np.cos(0.1) - 1)], [70, 50]),
        # the remainder of a part that is too short for blocks is left out
        (110, [0.0, 0.04, 0.0], [110]),
        # a drift that goes on through a disturbance is not a move
        (70, "drift", [N]),
    ],
)
def test_the_level_after_a_move_is_another_record(start, change, lengths):
    stretch = (np.arange(N) >= start).astype(int)
    added = (
        np.linspace(0, 0.3, N)[:, None] if isinstance(change, str) else np.outer(stretch, change)
    )
    values = 0.01 * noise(5) + [0.0, 0.0, 9.8] + added
    parts = cut_at_tilts([record(values, stretch=stretch)], 16)
    assert [len(p.windows) for p in parts] == lengths
    np.testing.assert_array_equal(parts[0].values, values[: lengths[0]])
