"""ArduPilot's parameters, applied by ArduPilot's formula, read also by pymavlink's reader."""

from dataclasses import replace

import numpy as np
import pytest

from export.devices import HOSTILE, device, unknown
from export.warm_device import (
    COLD,
    WARM,
    carried,
    fitted,
    narrow_device,
    warm_device,
    warm_samples,
)
from imuloop.core.errors import Lacking
from imuloop.core.model import SensorCalibration
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.export import ardupilot

# float32: half a unit of its last place, relative
HALF = 2.0**-24


def load(text):
    """Return the parameters: NAME,VALUE a line, from # on a comment; kept as float32."""
    found = {}
    for line in text.splitlines():
        if content := line.split("#")[0].strip():
            name, value = content.split(",")
            assert name not in found
            assert len(name) <= 16
            found[name] = np.float32(value)
    return found


def vector(found, name):
    return np.array([found[f"{name}_{axis}"] for axis in "XYZ"], dtype=float)


def polynomial(found, sensor, temperature):
    """Return the correction about 35 degC, the temperature held inside TMIN and TMAX."""
    low, high = float(found["INS_TCAL1_TMIN"]), float(found["INS_TCAL1_TMAX"])
    d = np.atleast_1d(np.clip(temperature, low, high) - 35.0)[:, None]
    c = [vector(found, f"INS_TCAL1_{sensor}{k}") for k in (1, 2, 3)]
    return (c[0] + (c[1] + c[2] * d) * d) * d * 1e-6


def corrected(found, sensor, values, temperature):
    """Return what ArduPilot makes of values: temperature, offsets, scale."""
    if found.get("INS_TCAL1_ENABLE") == 1:
        at = float(found[f"INS_{sensor}1_CALTEMP"])
        values = values - polynomial(found, sensor, temperature) + polynomial(found, sensor, at)
    values = values - vector(found, f"INS_{sensor}OFFS")
    return values * vector(found, "INS_ACCSCAL") if sensor == "ACC" else values


def check(board, effects, found=None, held=(COLD, WARM)):
    """Compare with the calibration of `board` at temperatures held to a range."""
    table, theta = warm_samples(*held), warm_samples()["temperature"].to_numpy()
    found = found or load(ardupilot.text(board))
    expected = carried(board, effects, aligned=False).apply(table)
    x = corrected(found, "ACC", table[list(ACCELERATION)].to_numpy(), theta)
    np.testing.assert_allclose(x, expected[list(ACCELERATION)], rtol=0, atol=4 * HALF * 20)
    # no scale factor: the output of the nominal one
    sensor = board.sensor("gyroscope")
    nominal = expected[list(ANGULAR_RATE)] * (sensor.raw_unit.scale / sensor.K)
    x = corrected(found, "GYR", table[list(ANGULAR_RATE)].to_numpy(), theta)
    np.testing.assert_allclose(x, nominal, rtol=0, atol=4 * HALF * 0.1)


def test_the_same_calibrated_samples_but_for_what_it_does_not_carry():
    check(warm_device(), ("bias_temperature",))


def test_without_effects():
    board = device()
    check(board, ())
    assert not any("TCAL" in name or "CALTEMP" in name for name in load(ardupilot.text(board)))


def test_a_reference_outside_the_data():
    hot = fitted(BiasTemperature(3, 80.0), (5e-3, 1e-5, 1e-6))
    board = warm_device(accelerometer=(hot,))
    assert load(ardupilot.text(board))["INS_ACC1_CALTEMP"] == WARM
    check(board, ("bias_temperature",))


def test_temperatures_are_held_to_those_at_which_both_effects_were_seen():
    board = narrow_device(accelerometer=(10.0, 30.0), gyroscope=(5.0, 25.0))
    text = ardupilot.text(board)
    found = load(text)
    assert (found["INS_TCAL1_TMIN"], found["INS_TCAL1_TMAX"]) == (10, 25)
    assert "# accelerometer: bias_temperature was seen from 10 to 30 degC" in text
    assert "# gyroscope: bias_temperature was seen from 5 to 25 degC" in text
    check(warm_device(), ("bias_temperature",), found, (10.0, 25.0))


def test_the_range_of_a_sensor_without_the_effect_does_not_count():
    found = load(ardupilot.text(narrow_device(warm_device(gyroscope=()), (12.0, 28.0))))
    assert (found["INS_TCAL1_TMIN"], found["INS_TCAL1_TMAX"]) == (12, 28)


def test_effects_that_were_seen_at_no_common_temperature_are_not_written():
    board = narrow_device(accelerometer=(10.0, 20.0), gyroscope=(25.0, 35.0))
    text = ardupilot.text(board)
    assert not any("TCAL" in name or "CALTEMP" in name for name in load(text))
    assert "Not carried of the gyroscope: bias_temperature" in text
    assert "was seen from 10 to 20 degC" in text
    check(board, (), load(text))


def test_one_warm_sensor_leaves_no_old_coefficients_of_the_other():
    found = load(ardupilot.text(warm_device(gyroscope=())))
    assert not np.any([vector(found, f"INS_TCAL1_GYR{k}") for k in (1, 2, 3)])
    assert (found["INS_TCAL1_TMIN"], found["INS_TCAL1_TMAX"]) == (COLD, WARM)
    assert "INS_GYR1_CALTEMP" not in found


def test_what_it_cannot_carry_is_said():
    text = ardupilot.text(warm_device())
    assert "Not carried of the accelerometer: misalignment T" in text
    assert "Not carried of the accelerometer: scale_temperature" in text
    assert "Not carried of the gyroscope: g_sensitivity" in text
    assert "Not carried of the gyroscope: scale factor K, up to 0.02 from 1" in text
    assert "bias_temperature: e" not in text


def test_a_polynomial_of_unknown_range_is_not_written():
    text = ardupilot.text(replace(warm_device(), temperature_range=None))
    assert not any("TCAL" in name or "CALTEMP" in name for name in load(text))
    assert "Not carried of the accelerometer: bias_temperature" in text


def test_a_sensor_that_was_not_calibrated_keeps_the_vehicles_values():
    board = warm_device()
    sensor = board.sensor("accelerometer")
    nominal = SensorCalibration.nominal(sensor.raw_unit, "too few poses")
    nominal = replace(nominal, effects=sensor.effects)
    board = replace(board, calibration=replace(board.calibration, accelerometer=nominal))
    text = ardupilot.text(board)
    found = load(text)
    assert not any(name.startswith("INS_ACC") for name in found)
    assert vector(found, "INS_TCAL1_ACC1").all()
    assert "too few poses" in text


def test_pymavlinks_reader_reads_the_same(tmp_path):
    mavparm = pytest.importorskip("pymavlink.mavparm")
    path = tmp_path / ardupilot.FILE
    path.write_text(ardupilot.text(warm_device("Board # 1, 2 = 3")), encoding="utf-8")
    parameters = mavparm.MAVParmDict()
    assert parameters.load(str(path))
    assert {k: np.float32(v) for k, v in parameters.items()} == load(path.read_text())


def test_a_label_adds_no_parameter():
    assert load(ardupilot.text(warm_device(HOSTILE))) == load(ardupilot.text(warm_device()))


def test_no_file_of_what_was_not_measured():
    with pytest.raises(Lacking, match="no calibration"):
        ardupilot.text(unknown())
