"""PX4's parameters, read as QGroundControl does and applied by PX4's formula."""

from dataclasses import replace

import numpy as np
import pytest

from export.devices import HOSTILE, device, unknown
from export.warm_device import COLD, WARM, carried, narrow_device, warm_device, warm_samples
from imuloop.core.errors import Lacking
from imuloop.core.model import SensorCalibration
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.export import px4

# float32: half a unit of its last place, relative
HALF = 2.0**-24


def load(text):
    """Return the parameters as QGroundControl reads them: five fields between tabs, or skipped."""
    found = {}
    for line in text.splitlines():
        if line.startswith("#"):
            continue
        vehicle, component, name, value, kind = line.split("\t")
        assert (vehicle, component) == ("1", "1")
        assert name not in found
        assert len(name) <= 16
        found[name] = {"9": np.float32, "6": np.int32}[kind](value)
    return found


def vector(found, form, keys="XYZ"):
    return np.array([found[form.format(key)] for key in keys], dtype=float)


def thermal(found, sensor, temperature):
    """Return the thermal offset: a polynomial of the temperature held inside TMIN and TMAX."""
    low, high, reference = (float(found[f"TC_{sensor}0_T{end}"]) for end in ("MIN", "MAX", "REF"))
    d = np.clip(temperature, low, high) - reference
    return sum(vector(found, f"TC_{sensor}0_X{k}_{{}}", "012") * d[:, None] ** k for k in range(4))


def test_the_same_calibrated_samples_but_for_what_it_does_not_carry():
    board, table = warm_device(), warm_samples()
    found = load(px4.text(board))
    theta = table["temperature"].to_numpy()
    expected = carried(board, ("bias_temperature",), aligned=False).apply(table)
    assert found["TC_A_ENABLE"] == found["TC_G_ENABLE"] == 1

    z = table[list(ACCELERATION)].to_numpy()
    offset, scale = vector(found, "CAL_ACC0_{}OFF"), vector(found, "CAL_ACC0_{}SCALE")
    x = (z - thermal(found, "A", theta) - offset) * scale
    np.testing.assert_allclose(x, expected[list(ACCELERATION)], rtol=0, atol=3 * HALF * 20)

    # no scale factor: the output of the nominal one
    z = table[list(ANGULAR_RATE)].to_numpy()
    sensor = board.sensor("gyroscope")
    x = z - thermal(found, "G", theta) - vector(found, "CAL_GYRO0_{}OFF")
    nominal = expected[list(ANGULAR_RATE)] * (sensor.raw_unit.scale / sensor.K)
    np.testing.assert_allclose(x, nominal, rtol=0, atol=3 * HALF * 0.1)


def test_outside_the_data_the_polynomial_is_held():
    found = load(px4.text(warm_device()))
    ends = thermal(found, "A", np.array([COLD, WARM]))
    assert (thermal(found, "A", np.array([-40.0, 85.0])) == ends).all()
    assert (found["TC_A0_TMIN"], found["TC_G0_TMAX"]) == (COLD, WARM)


def test_each_sensor_is_held_to_the_temperatures_at_which_its_effect_was_seen():
    seen = {"accelerometer": (10.0, 30.0), "gyroscope": (5.0, 25.0)}
    found = load(px4.text(narrow_device(**seen)))
    for name, letter in (("accelerometer", "A"), ("gyroscope", "G")):
        ends = found[f"TC_{letter}0_TMIN"], found[f"TC_{letter}0_TMAX"]
        assert ends == tuple(map(np.float32, seen[name]))
        # the same polynomial as without a range, at temperatures held to it
        free, table = warm_device(), warm_samples(*seen[name])
        sensor, columns = free.sensor(name), {"A": ACCELERATION, "G": ANGULAR_RATE}[letter]
        base, full = (
            carried(free, effects, aligned=False).apply(table)[list(columns)].to_numpy()
            for effects in ((), ("bias_temperature",))
        )
        expected = (base - full) * (sensor.raw_unit.scale / sensor.K)
        offset = thermal(found, letter, warm_samples()["temperature"].to_numpy())
        np.testing.assert_allclose(offset, expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def test_the_range_of_an_effect_needs_no_temperatures_of_the_logs():
    found = load(px4.text(replace(narrow_device(), temperature_range=None)))
    assert (found["TC_A0_TMIN"], found["TC_A0_TMAX"]) == (10, 30)


def test_without_a_range_of_its_own_an_effect_has_that_of_the_logs():
    board = narrow_device()
    sensor = board.sensor("accelerometer")
    effects = tuple(replace(e, seen={"c2x": (0.0, 1.0)}) for e in sensor.effects[:1])
    calibration = replace(board.calibration, accelerometer=replace(sensor, effects=effects))
    found = load(px4.text(replace(board, calibration=calibration)))
    assert (found["TC_A0_TMIN"], found["TC_A0_TMAX"]) == (COLD, WARM)
    assert (found["TC_G0_TMIN"], found["TC_G0_TMAX"]) == (10, 30)


def test_values_are_float32_to_the_last_bit():
    board = device()
    sensor = board.sensor("accelerometer")
    # digits that no shorter text holds
    sensor = replace(sensor, K=sensor.K * np.pi / 3, b=32768 + np.array([11.0, -7.0, 3.0]) / 7)
    board = replace(board, calibration=replace(board.calibration, accelerometer=sensor))
    found = load(px4.text(board))
    offset = (sensor.b - 32768) * 0.0024
    for axis, value, scale in zip("XYZ", offset, sensor.K / 0.0024, strict=True):
        assert found[f"CAL_ACC0_{axis}OFF"] == np.float32(value)
        assert found[f"CAL_ACC0_{axis}SCALE"] == np.float32(scale)


def test_what_it_cannot_carry_is_said():
    text = px4.text(warm_device())
    assert "Not carried of the accelerometer: misalignment T" in text
    assert "Not carried of the accelerometer: scale_temperature" in text
    assert "Not carried of the gyroscope: g_sensitivity" in text
    assert "Not carried of the gyroscope: scale factor K, up to 0.02 from 1" in text
    assert "bias_temperature: e" not in text
    assert "CAL_ACC0_ID" not in load(text)


def test_a_polynomial_of_unknown_range_is_not_written():
    text = px4.text(replace(warm_device(), temperature_range=None))
    assert not any(name.startswith("TC_") for name in load(text))
    assert "Not carried of the accelerometer: bias_temperature" in text


def test_a_sensor_that_was_not_calibrated_keeps_the_vehicles_values():
    board = device()
    nominal = SensorCalibration.nominal(board.sensor("accelerometer").raw_unit, "too few poses")
    board = replace(board, calibration=replace(board.calibration, accelerometer=nominal))
    text = px4.text(board)
    assert {name[:8] for name in load(text)} == {"CAL_GYRO"}
    assert "too few poses" in text


def test_a_label_adds_no_parameter():
    assert load(px4.text(warm_device(HOSTILE))) == load(px4.text(warm_device()))


def test_no_file_of_what_was_not_measured():
    with pytest.raises(Lacking, match="no calibration"):
        px4.text(unknown())
