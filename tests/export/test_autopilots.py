"""Parameters of PX4 and ArduPilot, read as their tools do and applied by their formulas."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from export.devices import (
    ARDUPILOT,
    COLD,
    PX4,
    WARM,
    calibration_with,
    device,
    fitted,
    narrow_device,
    warm_device,
    warm_samples,
)
from imuloop.core.samples import SENSORS
from imuloop.effects.temperature import BiasTemperature
from imuloop.model.sensor_calibration import SensorCalibration
from simulated_reference import Beside, simulate_beside

# float32: half a unit of its last place, relative
HALF = 2.0**-24
BIAS = ("bias_temperature",)
SHORT = {"accelerometer": ("ACC", "A"), "gyroscope": ("GYRO", "G")}


def vector(parameters, form, keys="XYZ"):
    return np.array([parameters[form.format(key)] for key in keys], dtype=float)


class Px4:
    format = PX4

    @staticmethod
    def load(text):
        """Return the parameters as QGroundControl reads them: five fields between tabs."""
        parameters = {}
        for line in text.splitlines():
            if line.startswith("#"):
                continue
            vehicle, component, name, value, kind = line.split("\t")
            assert (vehicle, component) == ("1", "1") and name not in parameters and len(name) <= 16
            parameters[name] = {"9": np.float32, "6": np.int32}[kind](value)
        return parameters

    @staticmethod
    def temperature_span(parameters, sensor):
        letter = SHORT[sensor][1]
        return parameters[f"TC_{letter}0_TMIN"], parameters[f"TC_{letter}0_TMAX"]

    @staticmethod
    def offset_and_scale(parameters, sensor):
        scale = vector(parameters, "CAL_ACC0_{}SCALE") if sensor == "accelerometer" else 1.0
        return vector(parameters, f"CAL_{SHORT[sensor][0]}0_{{}}OFF"), scale

    @classmethod
    def thermal(cls, parameters, sensor, temperature):
        """Return a polynomial of the temperature held inside TMIN and TMAX."""
        tc = f"TC_{SHORT[sensor][1]}0_"
        if f"{tc}TREF" not in parameters:
            return 0.0
        low, high = map(float, cls.temperature_span(parameters, sensor))
        d = np.clip(temperature, low, high) - float(parameters[f"{tc}TREF"])
        return sum(vector(parameters, f"{tc}X{k}_{{}}", "012") * d[:, None] ** k for k in range(4))


class ArduPilot:
    format = ARDUPILOT

    @staticmethod
    def load(text):
        """Return the parameters: NAME,VALUE a line, from # on a comment; kept as float32."""
        parameters = {}
        for line in text.splitlines():
            if content := line.split("#")[0].strip():
                name, value = content.split(",")
                assert name not in parameters and len(name) <= 16
                parameters[name] = np.float32(value)
        return parameters

    @staticmethod
    def temperature_span(parameters, sensor):
        return parameters["INS_TCAL1_TMIN"], parameters["INS_TCAL1_TMAX"]

    @staticmethod
    def offset_and_scale(parameters, sensor):
        scale = vector(parameters, "INS_ACCSCAL_{}") if sensor == "accelerometer" else 1.0
        return vector(parameters, f"INS_{SHORT[sensor][0][:3]}OFFS_{{}}"), scale

    @classmethod
    def thermal(cls, parameters, sensor, temperature):
        """Return P(θ) - P(CALTEMP), a polynomial about 35 degC inside TMIN and TMAX."""
        if "INS_TCAL1_ENABLE" not in parameters:
            return 0.0
        name = SHORT[sensor][0][:3]
        low, high = map(float, cls.temperature_span(parameters, sensor))

        def polynomial(theta):
            d = np.atleast_1d(np.clip(theta, low, high) - 35.0)[:, None]
            c = [vector(parameters, f"INS_TCAL1_{name}{k}_{{}}") for k in (1, 2, 3)]
            return (c[0] + (c[1] + c[2] * d) * d) * d * 1e-6

        return polynomial(temperature) - polynomial(float(parameters[f"INS_{name}1_CALTEMP"]))


@pytest.fixture(params=[Px4, ArduPilot])
def tool(request):
    return request.param


def corrects_as(tool, parameters, board, effects, span=(COLD, WARM), sensors=SENSORS):
    """Compare with the calibration of `board` at temperatures held to a range."""
    table, theta = warm_samples(*span), warm_samples()["temperature"].to_numpy()
    expected = calibration_with(board, effects, aligned=False).apply(table)
    for name in sensors:
        columns, sensor = list(SENSORS[name]), board.sensor(name)
        offset, scale = tool.offset_and_scale(parameters, name)
        x = (table[columns].to_numpy() - tool.thermal(parameters, name, theta) - offset) * scale
        wanted, size = expected[columns], 20.0
        if name == "gyroscope":
            # no scale factor: the output of the nominal one
            wanted, size = wanted * (sensor.raw_unit.scale / sensor.K), 0.1
        np.testing.assert_allclose(x, wanted, rtol=0, atol=4 * HALF * size)


def test_the_same_calibrated_samples_but_for_what_it_does_not_carry(tool):
    # a reference outside the data too
    hot = fitted(BiasTemperature(3, 80.0), (5e-3, 1e-5, 1e-6))
    warm = warm_device(), warm_device(accelerometer=(hot,))
    for board, effects in ((warm[0], BIAS), (warm[1], BIAS), (device(), ())):
        parameters = tool.load(tool.format.text(board))
        corrects_as(tool, parameters, board, effects)


def test_temperatures_are_held_to_those_at_which_the_effect_was_seen(tool):
    ends = {"accelerometer": (10.0, 30.0), "gyroscope": (5.0, 25.0)}
    parameters = tool.load(tool.format.text(narrow_device(**ends)))
    for name in SENSORS:
        # ArduPilot has one pair for both
        span = ends[name] if tool is Px4 else (10.0, 25.0)
        assert tool.temperature_span(parameters, name) == span
        corrects_as(tool, parameters, warm_device(), BIAS, span, [name])


def test_px4_has_the_device_ids_of_the_log_and_their_slots():
    line = fitted(BiasTemperature(1, 18.0), (5e-3,))
    board = warm_device(accelerometer=(line,), gyroscope=(line,))
    plain = Px4.load(PX4.text(board))
    assert not [name for name in plain if name.endswith("_ID")]
    ids = {"accelerometer": {"id": 1310988, "slot": 2}, "gyroscope": {"id": 1311244, "slot": 0}}
    calibration = replace(board.calibration, log={"sensor_ids": ids})
    parameters = Px4.load(PX4.text(replace(board, calibration=calibration)))
    assert (parameters.pop("CAL_ACC2_ID"), parameters.pop("TC_A2_ID")) == (1310988, 1310988)
    assert (parameters.pop("CAL_GYRO0_ID"), parameters.pop("TC_G0_ID")) == (1311244, 1311244)
    # nothing else changes but the accelerometer's slot
    moved = {name.replace("ACC0", "ACC2").replace("TC_A0", "TC_A2"): v for name, v in plain.items()}
    assert parameters == moved


def test_px4_finds_the_imu_of_a_simulated_reference_by_its_own_formulas():
    late, arm = 0.012, (0.05, -0.02, 0.08)
    dt = dict.fromkeys(SENSORS, late)
    clean = {"attitude_noise": 0.0, "place_noise": 0.0, "lost": 0.0, "swapped": 0.0}
    log, seen = simulate_beside(Beside(duration_s=40.0, dt=dt, arm=arm, **clean), 12180)
    board = beside(late, arm)
    parameters = Px4.load(PX4.text(board))
    t, p = seen["t"], np.column_stack([seen[f"p{k}"] for k in "xyz"])
    R = Rotation.from_quat(np.column_stack([seen[f"q{k}"] for k in "xyzw"]))
    rate = RotationSpline(t, R)(t, 1)

    def errors(delay, place):
        """Return what is left of the log at `t - delay`, the IMU at `p - R place`."""
        w, f = (
            np.column_stack([np.interp(t - delay, log["t"], log[f"{s}{k}"]) for k in "xyz"])
            for s in "ga"
        )
        force = R.apply(f) - CubicSpline(t, p - R.apply(place))(t, 2)
        return [np.std((x - x.mean(axis=0))[50:-50]) for x in (w - rate, force)]

    delay, place = parameters["EKF2_EV_DELAY"] / 1e3, vector(parameters, "EKF2_EV_POS_{}")
    right = errors(delay, place)
    for wrong in (errors(-delay, place), errors(0, place)):
        assert right[0] < wrong[0] / 5
    for wrong in (errors(delay, -place), errors(delay, 0 * place)):
        assert right[1] < wrong[1] / 5


def beside(dt, arm):
    """Return a device with what was found beside a reference."""
    place = dict(zip(("rx", "ry", "rz"), arm, strict=True))
    reference = {("gyroscope", "time_offset"): {"dt": dt}, ("accelerometer", "lever_arm"): place}
    return replace(device(), reference=reference)


def test_ardupilots_one_range_is_what_both_effects_have_in_common():
    load, text = ArduPilot.load, ARDUPILOT.text
    one = load(text(narrow_device(warm_device(gyroscope=()), (12.0, 28.0))))
    assert ArduPilot.temperature_span(one, "accelerometer") == (12, 28)
    # no old coefficients of the other are left
    assert not vector(one, "INS_TCAL1_GYR1_{}").any() and "INS_GYR1_CALTEMP" not in one
    board = narrow_device(accelerometer=(10.0, 20.0), gyroscope=(25.0, 35.0))
    assert not any("TCAL" in name or "CALTEMP" in name for name in load(text(board)))
    assert "Not carried of the gyroscope: bias_temperature" in text(board)
    corrects_as(ArduPilot, load(text(board)), board, ())


def test_a_sensor_that_was_not_calibrated_keeps_the_vehicles_values(tool):
    board = warm_device()
    sensor = board.sensor("accelerometer")
    nominal = SensorCalibration.nominal(sensor.raw_unit, "too few poses")
    nominal = replace(nominal, effects=sensor.effects)
    board = replace(board, calibration=replace(board.calibration, accelerometer=nominal))
    text = tool.format.text(board)
    parameters = tool.load(text)
    assert not any("ACC0" in name or name.startswith("INS_ACC") for name in parameters)
    assert "TC_A0_X1_0" in parameters or "INS_TCAL1_ACC1_X" in parameters
    assert "too few poses" in text
