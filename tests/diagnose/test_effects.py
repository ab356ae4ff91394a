"""The library of effects: each against its equation written out, and what its docstring claims."""

import json
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest

import imuloop.effects
from bench.study import physics
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import RawUnit
from imuloop.effects.products import Product
from imuloop.effects.temperature import SMOOTHED
from imuloop.model.calibration import Calibration
from imuloop.model.effect import Channels, Effect, FittedEffect, find_effect
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.simulate.sensor import lagged, output
from imuloop.simulate.truth import example_truth
from property.strategies import G

BOTH = """bias_temperature scale_temperature bias_temperature_rate thermal_hysteresis warm_up
    bias_drift time_offset turn_on_bias steps ramp product"""
CONTRACT = {
    "accelerometer": f"""{BOTH} quadratic cubic asymmetry cross_coupling reorientation
        vibration_rectification lever_arm rate_sensitivity""",
    "gyroscope": f"""{BOTH} g_sensitivity g2_sensitivity scale_nonlinearity scale_asymmetry
        earth_rate gyro_axis_delay anisoinertia""",
}
# effects of the library's folder that a calibration can hold
LIBRARY = {
    name: effect
    for name, effect in Effect.library.items()
    if effect.__module__.startswith(imuloop.effects.__name__)
    and {"poses", "motion"} & set(effect.records)
}


def log(n=400, seed=0, dt=0.05):
    """Return channels of a moving device that warms up and cools down again."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(n)
    tones = t[:, None] * rng.uniform(0.2, 3, 3)
    swing = np.einsum("nk,skj->snj", np.sin(tones), rng.normal(size=(2, 3, 3)))
    f = G * np.array([0.4, -0.5, 0.77]) + 2.0 * swing[0]
    warm = 22 + 9 * np.sin(2 * np.pi * t / t[-1]) + 0.1 * t
    cycle = (3 * np.arange(n)) // n
    return Channels(t, f, swing[1] + [0.2, -0.1, 0.3], warm, power_cycle=cycle)


def variants(name, channels=None):
    return find_effect(name).variants(channels or log())


PRODUCTS = [
    Product(formula, axis, sensor, 29.0) for formula, (sensor, axis, _) in physics.PRODUCTS.items()
]
FOUND = [*(variant for name in LIBRARY for variant in variants(name)), *PRODUCTS]
VARIANTS = [pytest.param(variant, id=str(variant)) for variant in FOUND]


def draw_effect(effect, seed=0, size=1.0):
    values = np.random.default_rng(seed).normal(scale=size, size=len(effect.parameters))
    return FittedEffect(effect, dict(zip(effect.parameters, values.tolist(), strict=True)), {})


@pytest.mark.parametrize("sensor", CONTRACT)
def test_every_name_of_the_contract_is_an_effect_of_its_sensor_and_has_its_words(sensor):
    of_sensor = {name: e for name, e in Effect.library.items() if sensor in e.sensors}
    assert set(CONTRACT[sensor].split()) <= set(of_sensor)
    for effect in (of_sensor[name] for name in of_sensor.keys() & LIBRARY.keys()):
        assert "Leaves" in effect.__doc__ and effect.equation and effect.reference
        units = effect().units(sensor)
        assert list(units) == list(effect().parameters)
        assert not any("output" in unit for unit in units.values())


def written_out(variant, p, channels):
    """Return the values of an effect, by equations apart from the library's."""
    if variant.name == "bias_temperature":
        warm = channels.temperature
        if variant.lag:
            late = lagged(warm, channels.t[1] - channels.t[0], SMOOTHED * variant.lag)
            warm = late + (warm - late) / SMOOTHED
        warmer = warm - variant.reference_temperature
        orders = range(1, variant.order + 1)
        return sum(np.outer(warmer**n, physics.of_axes(p, f"c{n}")) for n in orders)
    if variant.name == "turn_on_bias":
        sizes = [physics.of_axes(p, f"s{cycle}") for cycle in range(2, variant.runs + 1)]
        return np.array([-sum(sizes), *sizes])[channels.power_cycle]
    if variant.name == "product":
        values = physics.PRODUCTS[variant.formula][2](channels)
        return np.outer(p[f"c{variant.axis}"] * values, np.eye(3)["xyz".index(variant.axis)])
    return physics.EFFECTS[variant.name](channels, p, asdict(variant))


# a test below has vibration rectification, tests/calibrate/test_motion.py those with a derivative
ELSEWHERE = ("vibration_rectification", "lever_arm", "time_offset", "gyro_axis_delay")


@pytest.mark.parametrize("variant", [s for s in VARIANTS if s.values[0].name not in ELSEWHERE])
def test_the_design_is_the_equation(variant):
    channels, effect = log(300), draw_effect(variant, 1)
    expected = written_out(variant, effect.values, channels)
    np.testing.assert_allclose(effect.output(channels), expected, rtol=1e-12, atol=1e-12)


def select_rows(channels, rows):
    values = asdict(channels)
    names = ("t", "output", "other", "temperature", "power_cycle")
    return replace(channels, **{name: values[name][rows] for name in names})


EVERY = [variant for name, e in Effect.library.items() for variant in (e.variants(log()) or (e(),))]
EVERY += PRODUCTS


@pytest.mark.parametrize("variant", EVERY, ids=str)
def test_what_depends_on_other_samples_or_the_time_is_declared_and_needs_them(variant):
    """A part of a log gives the values of the whole log, or it is `timed` or of a `rate_of_change`.

    A single sample gives that too or is refused, and without its time where the time counts.
    """
    whole, effect = log(), draw_effect(variant, 2)
    expected = effect.output(whole)

    def same(channels, rows):
        return np.allclose(effect.output(channels), expected[rows], rtol=1e-9, atol=1e-12)

    part = slice(150, 250)
    declared = bool(variant.timed or variant.rate_of_change)
    assert declared or same(select_rows(whole, part), part)
    assert declared or same(replace(select_rows(whole, part), t=np.zeros(100)), part)
    for k in (150, 399):
        try:
            assert same(select_rows(whole, [k]), [k])
        except ImuloopError as error:
            assert declared and "give the whole log" in str(error)
    if "power_cycle" in variant.needs:
        return
    sensors = [SensorCalibration(RawUnit("SI", 1.0), np.eye(3), np.ones(3), np.zeros(3))] * 2
    of_gyroscope = variant.sensors[0] == "gyroscope"
    sensors[of_gyroscope] = replace(sensors[of_gyroscope], effects=(effect,))
    calibration, f, w = Calibration("d", G, *sensors), whole.output[0], whole.other[0]
    if declared:
        with pytest.raises(ImuloopError, match="t is needed"):
            calibration.apply_arrays(f, w, temperature=[25.0])
    else:
        calibration.apply_arrays(f, w, temperature=[25.0])


# a time is the same whatever moves; of a knock that is cut off a velocity is left
NOT_HELD = ("time_offset", "gyro_axis_delay")


@pytest.mark.parametrize("variant", VARIANTS)
def test_an_effect_is_held_to_what_its_data_showed(variant):
    whole = log()
    some = Channels(
        whole.t[100:150],
        *(0.3 * v[100:150] for v in (whole.output, whole.other)),
        whole.temperature[100:150],
        power_cycle=whole.power_cycle[100:150],
    )
    free = replace(draw_effect(variant, 6), std=dict.fromkeys(variant.parameters, 0.5))
    limited = free.with_ranges([some])
    # in the data nothing changes, and elsewhere no parameter adds more than it did there
    np.testing.assert_array_equal(limited.output(some), free.output(some))
    if variant.name in NOT_HELD:
        np.testing.assert_array_equal(limited.output(whole), free.output(whole))
    else:
        most = np.abs(variant.design(some)).max(axis=0) @ np.abs(list(free.values.values()))
        assert np.all(np.abs(limited.output(whole)) <= most.max() * (1 + 1e-12))
    # a file gives it back
    assert FittedEffect.from_dict(json.loads(json.dumps(limited.to_dict()))) == limited
    assert limited.to_dict()["constants"] == asdict(variant)
    # data of more than one kind widen the range
    wider = limited.with_ranges([whole])
    np.testing.assert_allclose(wider.output(whole), free.output(whole), atol=1e-12)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_calibration_undoes_what_the_simulator_adds(variant):
    if "power_cycle" in variant.needs:
        # of a power cycle that it does not know a calibration knows nothing
        assert not draw_effect(variant, 4).output(replace(log(), power_cycle=None)).any()
        return
    truth, channels = example_truth(), log(600, 3)
    # each parameter adds some hundredths of its unit
    effect = draw_effect(variant, 4, 0.02 / np.abs(variant.design(channels)).max())
    f, w = channels.output, channels.other
    calibrations, logged = {}, {}
    for sensor, x, other in (("accelerometer", f, w), ("gyroscope", w, f)):
        plain = getattr(truth, sensor)
        effects = (effect,) if sensor in variant.sensors else ()
        plain = replace(plain, effects=effects)
        u = output(plain, x, lambda u, o=other: replace(channels, output=u, other=o))
        logged[sensor] = u / plain.K + plain.b
        calibrations[sensor] = SensorCalibration(
            RawUnit(plain.raw_unit, 1.0), plain.T, plain.K, plain.b, effects=effects
        )
        if effects:
            assert np.abs(u - x @ np.linalg.inv(plain.T).T).max() > 1e-6
    columns = list(ACCELERATION + ANGULAR_RATE)
    samples = pd.DataFrame(np.hstack(list(logged.values())), columns=columns)
    samples = samples.assign(t=channels.t, temperature=channels.temperature)
    applied = Calibration("d", G, **calibrations).apply(samples)[columns].to_numpy()
    np.testing.assert_allclose(applied, np.hstack([f, w]), atol=1e-9)


@pytest.mark.parametrize("name", [n for n, e in LIBRARY.items() if "temperature" in e.needs])
def test_temperatures_that_lack_are_filled(name):
    channels = log(241)
    # one reading in 20 samples, on a straight line: nothing is lost
    line = 20 + 0.5 * channels.t
    slow = np.where(np.arange(241) % 20 == 0, line, np.nan)
    for variant in variants(name):
        np.testing.assert_allclose(
            variant.design(replace(channels, temperature=slow)),
            variant.design(replace(channels, temperature=line)),
            atol=1e-9,
        )
    for nothing in (None, np.full(241, np.nan)):
        without = replace(channels, temperature=nothing)
        with pytest.raises(ImuloopError, match="needs a temperature"):
            find_effect(name).variants(without)[0].design(without)


@pytest.mark.parametrize(("span", "orders"), [(4.9, [1]), (5.1, [1, 2]), (60.0, [1, 2, 3])])
def test_the_span_of_temperature_bounds_the_order(span, orders):
    channels = replace(log(), temperature=31.2 + span * np.linspace(-0.5, 0.5, 400))
    effects = variants("bias_temperature", channels)
    assert [variant.order for variant in effects if not variant.lag] == orders
    assert {variant.order for variant in effects if variant.lag} == set(orders)
    assert {variant.reference_temperature for variant in effects} == {31.0}


def test_vibration_is_counted_and_the_turn_beside_it_is_not():
    rng = np.random.default_rng(2)
    t = 0.01 * np.arange(4000)
    y = np.zeros((4000, 3))
    angle = np.clip((t - 19) / 2, 0, 1) * np.pi
    y[:, 2] = G * np.cos(angle - np.sin(2 * angle) / 2)
    turning = (t > 19) & (t < 21)
    y[turning] += rng.normal(scale=1.0, size=(turning.sum(), 3))
    y[:, 0] += np.where(t > 21, np.sqrt(2) * 0.5 * np.sin(2 * np.pi * 17.3 * t), 0)
    y += 0.01 * rng.normal(size=y.shape)
    design = find_effect("vibration_rectification")().design(Channels(t, y, y))
    # all but the tenth of a second next to the turn
    still = (t < 18.9) | (t > 21.1)
    assert design[still, 2, 2].mean() == pytest.approx(1e-4, rel=0.25)
    assert design[still, 2, 2].max() < 2e-4
    np.testing.assert_allclose(design[t > 22, 0, 0], 0.25, rtol=0.06)
