"""The calibration by a session while it is recorded, and the next rest or turn."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.calibrate.calibrate import calibrate_sensors
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.segments import STATIC
from imuloop.core.sphere import count_attitudes
from imuloop.diagnose.poses import APART, ATTITUDES, TESTABLE
from imuloop.model.calibration import Calibration
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.plan.advice import INITIAL_REST_S, RATE_IN_USE, next_pose_or_turn, upward
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings


@dataclass(frozen=True)
class Progress:
    """How far a session has come: errors of the calibration so far, and the next step."""

    duration_s: float  # length of the session, s
    up: np.ndarray  # (n, 3): upward direction in each pose on body axes
    # for each sensor, the largest of the standard errors of its misalignments, rad, and of its
    # scale factors, relative; infinite before the first estimate
    worst: dict
    advice: str  # the next step, words
    # whether all errors are good enough, and there are enough poses to test for effects
    done: bool = False


def progress(samples, gravity, units, noise=None, within=2e-3):
    """Return the Progress of a session from its samples so far.

    Parameters
    ----------
    samples : DataFrame
        Samples of the session so far, SI.
    gravity : float
        Local gravity, m/s^2.
    units : pair of RawUnit
        Raw unit of the accelerometer and of the gyroscope.
    noise : NoiseModel, optional
        Noise of the device, as `rest_noise` estimates it. By default it is white noise with the
        variance of the samples in the rests.
    within : float
        Standard error of relative scale factors, and of misalignments, rad, up to which the
        calibration is good enough.
    """
    t = samples["t"].to_numpy()
    early = Progress(float(np.ptp(t)), np.empty((0, 3)), dict.fromkeys(SENSORS, np.inf), "")
    segments, _ = segment_session(samples, "multi_position", SegmentSettings())
    rests = segments[segments["kind"] == STATIC]
    if len(rests) < 2:
        wait = INITIAL_REST_S - (rests["end_s"] - rests["start_s"]).sum()
        text = f"leave it at rest, {wait:.0f} s more" if wait > 0 else "turn it to another attitude"
        return replace(early, advice=text)
    settings = CalibrateSettings()
    recording = record([samples], [segments], settings.longest_rotation)
    if noise is None:
        density = np.sqrt(np.median(recording.poses.variance, axis=0) * np.median(np.diff(t)))
        white = (AxisNoise(N=Coefficient(float(n), identifiable=True)) for n in density)
        noise = NoiseModel("device", dict(zip(CHANNELS, white, strict=True)))
    unit_of_sensor = dict(zip(SENSORS, units, strict=True))
    sensors = calibrate_sensors(recording, noise, gravity, unit_of_sensor, settings)
    enough = within * np.repeat([gravity, RATE_IN_USE], 3)
    calibration = Calibration("device", gravity, **sensors)
    advice = next_pose_or_turn(calibration, noise, recording, enough, "TK")
    worst = {}
    for name, sensor in sensors.items():
        size = {"T": np.ones(3), "K": sensor.K}
        errors = [s / size[n[0]][int(n[1])] for n, s in sensor.std.items() if n[0] in size]
        worst[name] = max(errors, default=np.inf)
    up = upward(calibration, recording.poses)
    done = advice.ratio <= 1 and len(up) >= TESTABLE and count_attitudes(up, APART) >= ATTITUDES
    return Progress(early.duration_s, up, worst, str(advice.step), done)


def rest_noise(samples):
    """Return the NoiseModel that the rests of a session show, with flicker and random walk.

    `samples` is the DataFrame of the samples of the session, SI. The estimate takes seconds, too
    long for each call of `progress`.
    """
    segments, _ = segment_session(samples, "multi_position", SegmentSettings())
    session = RecordedSession("poses", "multi_position", samples, segments)
    return estimate_noise("device", [session], NoiseSettings(), views=False).model
