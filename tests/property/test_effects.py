"""A term more never fits the same data worse."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import imuloop.effects  # noqa: F401  the library of effects
from calibrate.devices import planned, recording
from diagnose.models import of_sensor, pair_of
from imuloop.core.effect import Channels, Effect
from imuloop.estimate.least_squares import fit
from imuloop.factors.gravity_norm import gravity_norm
from imuloop.model.sensor import Sensor
from imuloop.model.state import ENTRIES
from imuloop.simulate.truth import example_truth
from property.strategies import G, directions, seeds, vectors


@settings(max_examples=30)
@given(vectors(-0.5, 0.5), vectors(0.95, 1.05), st.integers(1, 4), seeds)
def test_any_term_of_the_accelerometer_lowers_chi_square(bias, scale, terms, seed):
    rng = np.random.default_rng(seed)
    y = G * directions(25, seed) / scale + bias + rng.normal(scale=5e-3, size=(25, 3))
    root = rng.normal(size=(25, 25)) * 1e-3
    covariance = root @ root.T + 1e-5 * np.eye(25)
    design = rng.normal(size=(25, 3, terms))

    def linearise(x):
        T = np.eye(3)
        T[ENTRIES["accelerometer"]] = x[:3]
        sensor = Sensor(ENTRIES["accelerometer"], T, *np.split(x[3:], [3, 6]))
        rows = gravity_norm(sensor, y, G, design[:, :, : len(x) - 9])
        return SimpleNamespace(residual=rows.residual[:, 0], jacobian=rows.jacobian[:, 0])

    start = np.repeat([0.0, 1.0, 0.0], [3, 3, 3 + terms])
    found = [fit(linearise, start[: 9 + p], covariance).chi2 for p in range(terms + 1)]
    assert np.all(np.diff(found) <= 1e-7 * found[0]), found


def of_two_power_cycles(recording):
    """Return a recording whose second half counts as a power cycle of its own."""
    n = len(recording.poses)
    return replace(recording, poses=replace(recording.poses, power_cycle=2 * np.arange(n) // n))


@pytest.fixture(scope="module")
def made():
    """Two recordings that warm up, their pairs of sensors, fits, and the noise of these."""
    truth, found = planned(example_truth(), temperature=((0, 18), (150, 33), (500, 21))), []
    for seed in (1, 2):
        one = of_two_power_cycles(recording(truth, seed))
        pair = pair_of(truth, one)
        x = pair.fit(one).x
        found.append((one, pair, x, pair.measured(x, one).at(x).noise.by(pair.noise)))
    return found


@pytest.mark.parametrize("effect", Effect.library.values(), ids=Effect.library.keys())
def test_any_effect_of_the_library_lowers_chi_square(made, effect):
    if "poses" not in effect.records:
        # what is not looked for in poses says so, and that is all it does
        # and of axes that sit apart `lever_arm` says it
        assert effect.unobservable or effect.records in ((), ("static_record",), ("reference",))
        return
    for sensor in effect.sensors:
        for one, pair, x, covariance in made:
            t = one.poses.mid_s
            own, other = (one.poses.f, one.poses.w)[:: 1 if sensor == "accelerometer" else -1]
            channels = Channels(
                t, own, other, one.poses.temperature, power_cycle=one.poses.power_cycle
            )
            # a scan finds the time of a step
            shapes = effect.shapes(channels) or (effect(times=(float(t.mean()),)),)
            wide = of_sensor(sensor, shapes[-1])
            count = len(wide[0].parameters)
            # by the same noise: weights follow what is fitted
            plain, wider = (
                fit(pair.measured(start, one, effects).at, start, covariance)
                for effects, start in (((), x), (wide, np.append(x, np.zeros(count))))
            )
            assert wider.chi2 <= plain.chi2 * (1 + 1e-9)
            assert wider.dof == plain.dof - count
