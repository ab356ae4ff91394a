"""Diagnose a device: is anything missing in its model, what is it, and what remains with it."""

from dataclasses import replace

# the library of effects joins by being loaded
import imuloop.diagnose.effects  # noqa: F401
from imuloop.calibrate.calibrate import best, read_recording
from imuloop.core.files import write_json
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import CHANNELS, TIME, read_samples
from imuloop.core.segments import read_segments
from imuloop.diagnose.pose_diagnosis import diagnose_poses, pose_candidates
from imuloop.diagnose.pose_models import AccelerometerPoses, GyroscopePoses
from imuloop.diagnose.static_record import diagnose_static, window_means

# version of the JSON file
FORMAT = 1


def diagnose_device(
    *,
    device,
    gravity,
    sessions,
    noise,
    six_position,
    multi_position,
    calibrate_settings,
    settings,
    diagnosis_path,
    calibration_path,
):
    """Diagnose a device and write the diagnosis and the final calibration.

    Parameters
    ----------
    device : str
        Name of the device.
    gravity : float
        Local gravity, m/s^2.
    sessions : dict of str to dict
        ``kind``, ``samples`` and ``segments`` (paths) of each session.
    noise, six_position, multi_position : path-like
        Results of the stages before.
    calibrate_settings : CalibrateSettings
        Settings of the calibration that is repeated with effects.
    settings : DiagnoseSettings
        Settings.
    diagnosis_path, calibration_path : path-like
        Where to write.

    Returns
    -------
    dict, Calibration
        The diagnosis, and the calibration with the effects that were added.
    """
    model = NoiseModel.from_json(noise)
    six, multi = Calibration.from_json(six_position), Calibration.from_json(multi_position)
    recording = read_recording(sessions, calibrate_settings.longest_rotation)
    base = replace(
        multi,
        accelerometer=best(multi.accelerometer, six.accelerometer),
        gyroscope=best(multi.gyroscope, six.gyroscope),
    )
    force_model = AccelerometerPoses(
        model, gravity, multi.accelerometer.raw_unit, calibrate_settings
    )
    tests = settings.family * sum(
        len(pose_candidates(sensor, recording)[0]) for sensor in ("accelerometer", "gyroscope")
    )
    force, force_solution = diagnose_poses(force_model, recording, settings, tests)
    force_effects = force_solution.effects if force_solution else ()
    turn_model = GyroscopePoses(
        force_model,
        None if force_solution else base.accelerometer,
        force_effects,
        multi.gyroscope.raw_unit,
    )
    turn, turn_solution = diagnose_poses(turn_model, recording, settings, tests)
    # a calibration that the diagnosis did not change stays the one of its stage, to the last bit
    final = replace(
        base,
        accelerometer=force_solution.calibration if force_effects else base.accelerometer,
        gyroscope=(
            turn_solution.calibration if turn_solution and turn_solution.effects else base.gyroscope
        ),
    )
    records = {
        name: window_means(
            read_samples(s["samples"], (TIME, *CHANNELS)),
            read_segments(s["segments"]),
            settings.mean_time,
        )
        for name, s in sessions.items()
        if s["kind"] == "static"
    }
    still = {
        sensor: diagnose_static(records, model, axes, unit, sensor, settings)
        for sensor, axes, unit in (
            ("accelerometer", slice(0, 3), "m/s^2"),
            ("gyroscope", slice(3, 6), "rad/s"),
        )
    }
    diagnosis = {
        "format": FORMAT,
        "device": device,
        "sensors": {
            "accelerometer": {"poses": force, "static_record": still["accelerometer"]},
            "gyroscope": {"poses": turn, "static_record": still["gyroscope"]},
        },
    }
    write_json(diagnosis_path, diagnosis)
    final.to_json(calibration_path)
    return diagnosis, final
