"""Coaching while a session is recorded: what it shows so far, and what to do next."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.calibrate.calibrate import calibrate_sensors
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.segments import STATIC
from imuloop.core.sphere import WIDE_HOLE, direction_words, largest_hole
from imuloop.diagnose.records.pose_diagnosis import TESTABLE
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.plan.session import INITIAL_REST_S, REST_S
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings


@dataclass(frozen=True)
class Progress:
    """What a session shows so far.

    Its length, s; the upward direction in each pose on body axes, (n, 3); the standard error of
    each parameter by sensor, in its own unit, and the worst of scale factor, relative, and
    misalignment, rad, infinite while there is none; what to do next, empty where nothing is left;
    whether all are as good as asked for and the poses enough to test for missing effects, though a
    wide hole, in which an effect could hide, may be left.
    """

    duration_s: float
    up: np.ndarray
    std: dict
    worst: dict
    advice: str
    done: bool = False


def progress(samples, gravity, units, noise=None, within=2e-3):
    """Return the Progress of a session.

    Takes its samples so far, SI, a DataFrame; gravity, m/s^2; the RawUnit of both sensors; the
    NoiseModel of `rest_noise`, by default that of the samples of its rests, white; the
    `Progress.worst` that each sensor shall reach.
    """
    t = samples["t"].to_numpy()
    none = dict.fromkeys(SENSORS, np.inf)
    early = Progress(float(np.ptp(t)), np.empty((0, 3)), {}, none, "")
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
    of_sensor = dict(zip(SENSORS, units, strict=True))
    sensors = calibrate_sensors(recording, noise, gravity, of_sensor, settings)
    relative = {name: _relative(sensor) for name, sensor in sensors.items()}
    worst = {name: max(found.values(), default=np.inf) for name, found in relative.items()}
    up = sensors["accelerometer"].aligned(recording.poses.f)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    hole, angle = largest_hole(up)
    covered, enough = np.degrees(angle) < WIDE_HOLE, len(up) >= TESTABLE
    if not covered or not enough or worst["accelerometer"] > within:
        text = f"turn it until {direction_words(hole)} is up, and let go for {REST_S:.0f} s"
    elif worst["gyroscope"] > within:
        of_turn = relative["gyroscope"]
        axis = "xyz"[int(max(of_turn, key=of_turn.get, default="K2")[-1])]
        text = f"turn it by 360° about {axis}, with that axis level, there and back"
    else:
        text = ""
    std = {name: sensor.std for name, sensor in sensors.items() if relative[name]}
    return Progress(
        early.duration_s, up, std, worst, text, enough and max(worst.values()) <= within
    )


def rest_noise(samples):
    """Return the NoiseModel of a session's rests, flicker and walk included; takes seconds."""
    segments, _ = segment_session(samples, "multi_position", SegmentSettings())
    session = RecordedSession("poses", "multi_position", samples, segments)
    return estimate_noise("device", [session], NoiseSettings(), views=False).model


def _relative(sensor):
    """Return standard errors of scale factor, relative, and misalignment, rad, if fitted."""
    if sensor.method != "multi_position":
        return {}
    size = {"T": np.ones(3), "K": sensor.K}
    return {n: s / size[n[0]][int(n[1])] for n, s in sensor.std.items() if n[0] in size}
