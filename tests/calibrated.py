"""A simulated device with logs and a calibration."""

from calibrate.devices import calibrate_recording, known_noise, plan_session, recording
from imuloop import Calibration
from imuloop.core.files import write_json
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth


def calibrated_device(folder, poses, rest, *seeds):
    """Write noise.json and a log of poses for each seed; return the calibration by the first."""
    truth = plan_session(example_truth(rate=50.0), poses=poses, initial_rest_s=rest)
    for seed in seeds:
        simulate_session(truth, "multi_position", seed).to_csv(folder / f"{seed}.csv", index=False)
    noise = known_noise(truth)
    write_json(folder / "noise.json", noise.to_dict())
    sensors = calibrate_recording(recording(truth, seeds[0]), noise, truth.gravity)
    return Calibration("d", truth.gravity, *sensors)
