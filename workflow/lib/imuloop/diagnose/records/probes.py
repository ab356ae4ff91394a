"""What a residual may go with, by kind of record: no effects, but signposts for a person."""

import numpy as np
from scipy.special import sph_harm_y

from imuloop.calibrate.sensor_pair import OF_SENSOR, VELOCITY
from imuloop.core.memory import in_pieces
from imuloop.effects.axes import on_each_axis

# attitude patterns below degree 3 are those of bias, scale factor and misalignment
DEGREES = (3, 4, 5)


def of_poses(problem, sensor):
    """Return name, kind and columns of what residuals of a sensor at the poses may go with."""
    recording, own = problem.recording, slice(0, 3) if sensor == "accelerometer" else slice(3, 6)
    poses, rotations = recording.poses, recording.rotations
    time = (poses.mid_s / np.ptp(poses.mid_s))[:, None] ** [1, 2]
    previous = np.vstack([np.zeros((1, 3)), poses.f[:-1]])
    previous[np.diff(poses.session, prepend=-1) != 0] = 0
    at_pose = {f"harmonics_{d}": harmonics(poses.f, d) for d in DEGREES}
    at_pose |= {"time": time, "pose_variance": poses.variance[:, own], "previous_pose": previous}
    # the mean rate over a rotation, with its sign
    speed = _turned(rotations) / (rotations.end_s - rotations.start_s)[:, None]
    in_turn = {"time": time[rotations.first], "previous_pose": poses.f[rotations.first]}
    in_turn["rotation_speed"] = speed
    if poses.temperature is not None:
        rate = np.gradient(poses.temperature, poses.mid_s) if len(poses) > 1 else time[:, 0]
        for name, values in (("temperature", poses.temperature), ("temperature_rate", rate)):
            at_pose[name] = values[:, None]
            in_turn[name] = values[rotations.first, None]
    return [
        (name, kind, problem.probe(kind, values))
        for kind in OF_SENSOR[sensor]
        for name, values in (in_turn if kind == "rotation" else at_pose).items()
    ]


def of_moves(problem, knock):
    """Return the same of the velocity after moves; `knock`, m/s, (m,), as of `motion.knocks`."""
    recording, quiet = problem.recording, problem.sensor.quiet
    rotations = recording.rotations
    turned, seconds = _turned(rotations), rotations.steps.sum(axis=1)[:, None]
    values = {
        "time": (rotations.start_s + rotations.end_s)[:, None] / 2,
        "duration": seconds,
        "rotation_angle": turned,
        "rotation_speed": turned / seconds,
        "previous_pose": recording.poses.f[rotations.first],
        "knock": knock[:, None],
    }
    return [
        (name, kind, problem.probe(kind, each[quiet]))
        for kind in VELOCITY
        for name, each in values.items()
    ]


def of_means(problem):
    """Return the same of means at rest."""
    records = [r.channels for r in problem.merged]
    span = max(np.ptp(r.t) for r in records)
    found = {"time": [on_each_axis(r.t / span, (r.t / span) ** 2) for r in records]}
    moments = (np.split(r.remembered(_moments), 2, axis=1) for r in records)
    found["pose_variance"] = [on_each_axis(square - mean**2) for mean, square in moments]
    if all(r.temperature is not None for r in records):
        found["temperature"] = [on_each_axis(r.temperature, r.temperature**2) for r in records]
        rates = (np.gradient(r.temperature, r.t) for r in records)
        found["temperature_rate"] = [on_each_axis(rate) for rate in rates]
    return [(name, "bias", np.concatenate(parts)) for name, parts in found.items()]


def harmonics(directions, degree):
    """Return the real spherical harmonics of one degree, shape (n, 2 degree + 1)."""
    x, y, z = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).T
    theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    values = [sph_harm_y(degree, m, theta, phi) for m in range(degree + 1)]
    return np.column_stack([v.real for v in values] + [v.imag for v in values[1:]])


def _turned(rotations):
    """Return the integral of the angular rate over each rotation, rad, (m, 3)."""
    return np.einsum("mki,mk->mi", rotations.w[:, 1:], rotations.steps)


@in_pieces
def _moments(channels):
    """Return the output of each axis and its square, shape (n, 6)."""
    values = channels.output
    # about a mean, so that the difference of squares keeps its digits
    centre = {} if channels.past is None else channels.past
    values = values - centre.setdefault("mean", values.mean(axis=0))
    return np.hstack([values, values**2])
