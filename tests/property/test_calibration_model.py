"""The model ``x = T (K (raw - b) - e)``: inverted by its formula, and in any unit."""

import numpy as np
import pandas as pd
from hypothesis import given, settings
from hypothesis import strategies as st

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.units import RawUnit
from imuloop.model.calibration import Calibration
from imuloop.model.effect import FittedEffect, find_effect
from imuloop.model.sensor_calibration import SensorCalibration
from property.strategies import misalignments, seeds, vectors

EFFECT = find_effect("g_sensitivity")
units = st.builds(RawUnit, st.just("count"), st.floats(1e-5, 1e3), st.floats(-1e5, 1e5))
gains = st.lists(st.floats(-1e-2, 1e-2), min_size=9, max_size=9)


@st.composite
def sensors(draw, triangular, effects=()):
    unit = draw(units)
    K = draw(vectors(0.8, 1.2)) * unit.scale
    b = draw(vectors(-1, 1)) / unit.scale + unit.offset
    return SensorCalibration(unit, draw(misalignments(triangular)), K, b, effects=effects)


def invert_model(sensor, x, e=0.0):
    """Invert the model: ``raw = K⁻¹ (T⁻¹ x + e) + b``, in SI as logged."""
    raw = (np.linalg.solve(sensor.T, x.T).T + e) / sensor.K + sensor.b
    return (raw - sensor.raw_unit.offset) * sensor.raw_unit.scale


@settings(max_examples=40)
@given(sensors(True), sensors(False), gains, seeds)
def test_applying_undoes_the_inverted_model(accelerometer, gyroscope, gain, seed):
    values = dict(zip(EFFECT.parameters, gain, strict=True))
    gyroscope = SensorCalibration(
        gyroscope.raw_unit,
        gyroscope.T,
        gyroscope.K,
        gyroscope.b,
        effects=(FittedEffect(find_effect("g_sensitivity")(), values, {}),),
    )
    f, w = np.random.default_rng(seed).normal(size=(2, 7, 3)) * [[[10.0]], [[2.0]]]
    samples = np.hstack(
        [invert_model(accelerometer, f), invert_model(gyroscope, w, f @ np.reshape(gain, (3, 3)).T)]
    )
    log = pd.DataFrame(samples, columns=list(CHANNELS)).assign(t=np.arange(7.0))
    applied = Calibration("d", 9.8, accelerometer, gyroscope).apply(log)
    # an offset of 1e5 counts leaves eleven digits of a count
    digits = [1e-10 * max(1.0, s.raw_unit.scale * 1e5) for s in (accelerometer, gyroscope)]
    np.testing.assert_allclose(applied[list(ACCELERATION)], f, atol=digits[0], rtol=1e-10)
    np.testing.assert_allclose(
        applied[list(ANGULAR_RATE)], w, atol=digits[1] + digits[0], rtol=1e-10
    )
