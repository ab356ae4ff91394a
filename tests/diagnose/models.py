"""How the sensors of a simulated device are fitted at the poses."""

from imuloop.calibrate.pose_fits import AccelerometerPoses, GyroscopePoses, fitted_calibration

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise
from imuloop.calibrate.settings import CalibrateSettings

SETTINGS = CalibrateSettings()


def accelerometer_poses(truth, noise=None):
    noise = noise or known_noise(truth)
    return AccelerometerPoses(noise, truth.gravity, ACCELERATION_UNIT, SETTINGS)


def gyroscope_poses(force, recording, effects=()):
    """Return how the gyroscope is fitted, gravity by the accelerometer's fit to a recording."""
    calibration = fitted_calibration(force, force.fit(recording, effects))
    return GyroscopePoses(force.noise, calibration, RATE_UNIT, force.settings)


def pose_sensors(truth, recording, noise=None):
    force = accelerometer_poses(truth, noise)
    return {"accelerometer": force, "gyroscope": gyroscope_poses(force, recording)}
