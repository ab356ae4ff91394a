"""The error of the vertical on the recording of imu_tk, on stretches that no model has seen."""

import numpy as np

from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.gyroscope import gyroscope_model
from imuloop.calibrate.pose_fits import AccelerometerPoses, GyroscopePoses, fitted_calibration
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.validate.attitude_models import blocks

DEVICE = "xsens_mti"


def test_over_a_rotation_it_falls_three_fold(measured):
    found = measured.json(DEVICE, "attitude")
    rotation = found["methods"]["rotation"]
    assert rotation["n"] == 37
    assert all(effects["gyroscope"][:1] == ["g_sensitivity"] for effects in found["effects"])
    assert rotation["base_over_final"] >= 3
    assert rotation["ratio_ci95"][0] > 2.5
    # what is left is little more than the noise
    assert rotation["models"]["final"]["rms_deg"] < 1.5 * rotation["floor_deg"]


def test_the_bias_as_imu_tk_takes_it_is_no_better_than_that_of_the_base_model(measured):
    made, noise, multi = measured.fit_of(DEVICE)
    model = AccelerometerPoses(
        noise, multi.gravity, multi.accelerometer.raw_unit, CalibrateSettings()
    )
    block = blocks(len(made.poses), DiagnoseSettings())
    errors = []
    for k in range(block.max() + 1):
        seen = made.select(block != k)
        calibration = fitted_calibration(model, model.fit(seen))
        # held at the mean of the first rest
        held = seen.poses.w[0], np.zeros(3)
        turn = GyroscopePoses(
            noise, calibration, multi.gyroscope.raw_unit, CalibrateSettings(), held
        )
        fit = turn.fit(seen).fit
        whole = gyroscope_model(made, calibrated_force(calibration, made, noise))
        held = block[made.rotations.first] == k
        errors.append(np.linalg.norm(whole.rotation_errors(fit.x)[0][held], axis=1))
    size = np.degrees(np.sqrt((np.concatenate(errors) ** 2).mean()))
    models = measured.json(DEVICE, "attitude")["methods"]["rotation"]["models"]
    assert models["base"]["rms_deg"] < size < 2 * models["base"]["rms_deg"]
    assert size > 3 * models["final"]["rms_deg"]
