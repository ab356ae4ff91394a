"""The parameter that limits a calibration, and the rest or turn that lowers its error most.

Nominal SI values are raw readings minus the offset, times the scale of the data sheet.
"""

from dataclasses import asdict, dataclass, replace
from itertools import product

import numpy as np

from imuloop.calibrate.recording import Recording
from imuloop.calibrate.rotations import Rotations
from imuloop.core.rotation import exponential, matrix, shortest_turn
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.units import DEGREE
from imuloop.factors.factors import Factors
from imuloop.model.effects import SensorEffect
from imuloop.model.raw_units import si_factor, state_of
from imuloop.model.state import NAMES
from imuloop.plan.directions import direction_words

# contents of a first session: seconds at rest at the start, number of poses, seconds of a rest, of
# a move, and of a turn of 360 degrees by hand
INITIAL_REST_S, POSES, REST_S, MOVE_S, FULL_TURN_S = 50.0, 40, 4.0, 2.0, 5.0
# angular rate at which errors of the gyroscope's output are compared, rad/s; errors of the
# accelerometer's output are compared at 1 g
RATE_IN_USE = 100 * DEGREE
# directions that are up, on body axes, (26, 3), if a face, an edge or a corner of a box is up
ATTITUDES = np.array([v / np.linalg.norm(v) for v in product((1.0, 0, -1.0), repeat=3) if any(v)])
# least angle between a new attitude and all earlier rests, rad
FAR = 40 * DEGREE
# times of the samples of a turn, as shares of the length of the turn
_SHARE = np.linspace(0, 1, 64)[:, None]


@dataclass(frozen=True)
class Step:
    """A step of a session: a rest in another attitude, or a turn of 360° between two rests.

    `up` is the upward direction on body axes during the rest, or before and after the turn, a unit
    vector, (3,). `axis` is the body axis of the turn, ``x``, ``y`` or ``z``; None for a rest.
    """

    up: np.ndarray
    axis: str | None = None

    def __str__(self):
        """Return the instruction for the user, a sentence."""
        if self.axis:
            return f"turn it by 360° about {self.axis}, with that axis level"
        return f"turn it until {direction_words(self.up)} is up, and let go for {REST_S:.0f} s"

    def turn(self, now):
        """Return the rotation that the device makes in this step, with its start and duration.

        For a rest in another attitude it is the shortest turn that leads there.

        Parameters
        ----------
        now : ndarray, shape (3,)
            Present upward direction on body axes.

        Returns
        -------
        ndarray, shape (3,)
            Upward direction on body axes before the turn.
        ndarray, shape (3,)
            Rotation vector of the turn on body axes, rad.
        float
            Usual duration of the turn, s.
        """
        if self.axis:
            return self.up, 2 * np.pi * np.eye(3)["xyz".index(self.axis)], FULL_TURN_S
        return now, shortest_turn(now, self.up), MOVE_S


@dataclass(frozen=True)
class Advice:
    """The parameter that limits a calibration, and the Step that lowers its standard error most.

    Attributes
    ----------
    sensor, parameter : str
        Name of the sensor and of the parameter, such as ``gyroscope`` and ``K2``.
    error, ratio : float
        `error` is the standard error of a reading of 1 g or 100 deg/s that this parameter causes,
        SI. `ratio` is `error` over the error that is good enough; above one, the parameter needs
        more data.
    std, std_after : float
        Standard error of the parameter before and after the step, nominal SI.
    step : Step
        The rest or turn to make next.
    """

    sensor: str
    parameter: str
    error: float
    ratio: float
    std: float
    std_after: float
    step: Step


def next_pose_or_turn(calibration, noise, recording, enough, letters="TKb"):
    """Return the Advice: the parameter that limits a calibration, and the next rest or turn.

    The parameter that limits the calibration has the largest ratio of its error in use, at 1 g or
    100 deg/s, to the error that is good enough. The next step is the one of `candidates` after
    which the standard error of this parameter is smallest. A step adds residuals with the Jacobian
    J and the covariance R. The covariance C of the parameters then becomes ``C - C Jᵀ (J C Jᵀ +
    R)⁻¹ J C``. R follows from the noise, times the reduced χ² of the calibration if that is above
    one.

    Parameters
    ----------
    calibration : Calibration
        The calibration that was fitted to `recording`.
    noise : NoiseModel
        Noise of the device.
    recording : Recording
        Poses and rotations so far, at least one pose.
    enough : ndarray, shape (6,)
        Error of each channel, ax … gz, that is good enough, SI.
    letters : str
        First letters of the names of the parameters that may limit the calibration: T for
        misalignments, K for scale factors and b for biases.
    """
    needs = set() if recording.poses.temperature is None else {"temperature"}
    effects = [
        SensorEffect(e.effect, sensor)
        for sensor in SENSORS
        for e in getattr(calibration, sensor).effects
        # only effects that do not depend on time or on a rate of change: any rest or turn shows
        # them
        if not (e.effect.timed or e.effect.rate_of_change) and needs.issuperset(e.effect.needs)
    ]
    (state, covariance), limits = state_of(calibration, effects), []
    size_in_use = {"accelerometer": calibration.gravity, "gyroscope": RATE_IN_USE}
    for k, (sensor, base) in enumerate(NAMES.items()):
        model = getattr(calibration, sensor)
        # a parameter that was not estimated has the standard error of the prior
        prior = (model.prior or {"std": {}})["std"]
        for name, factor in zip(base, si_factor(base, model.raw_unit), strict=True):
            i = state.names.index(f"{sensor}.{name}")
            covariance[i, i] = covariance[i, i] or (factor * prior.get(name, 0.0)) ** 2
            error = np.sqrt(covariance[i, i]) * (1.0 if name[0] == "b" else size_in_use[sensor])
            if name[0] in letters:
                limits.append((error / enough[3 * k + int(name[1])], error, i, sensor, name))
    ratio, error, i, sensor, name = max(limits)
    up = upward(calibration, recording.poses)
    steps, variances, factors = candidates(up), [], Factors(calibration.gravity)
    simulated = simulate_steps(steps, up[-1], calibration, recording)
    linearised = factors.linearised_about(simulated, state).at(state.x)
    owners = factors.owners(simulated).tolist()
    # factor on the standard deviation of each residual, from the reduced χ²
    scale = np.sqrt([getattr(calibration, owner).excess for owner in owners])
    R = linearised.noise.by(noise) * scale[:, None] * scale
    # residuals that end at the second rest of each session; the first rest is known already
    ends = factors.rows(simulated)[0].max(axis=1)
    for k in range(len(steps)):
        rows = np.flatnonzero(ends == 2 * k + 1)
        J, gain = linearised.jacobian[rows], covariance @ linearised.jacobian[rows].T
        change = np.linalg.solve(J @ gain + R[np.ix_(rows, rows)], gain[i])
        variances.append(covariance[i, i] - gain[i] @ change)
    best = int(np.argmin(variances))
    return Advice(
        sensor=sensor,
        parameter=name,
        error=float(error),
        ratio=float(ratio),
        std=float(np.sqrt(covariance[i, i])),
        std_after=float(np.sqrt(variances[best])),
        step=steps[best],
    )


def upward(calibration, poses):
    """Return the upward direction in each of n poses, unit vectors on body axes, (n, 3).

    `calibration` is the Calibration of the device, and `poses` are the Poses.
    """
    force = calibration.accelerometer.aligned(poses.f)
    return force / np.linalg.norm(force, axis=1)[:, None]


def candidates(up):
    """Return the Steps from which the next one is chosen, a list.

    A Step is a rest or a turn. As long as some of the `ATTITUDES` differ from all earlier rests by
    more than the angle `FAR`, the candidates are rests in these attitudes, because an effect can
    hide in an attitude that was never tried. Otherwise they are rests in all `ATTITUDES` that
    differ from the last rest by more than `FAR`, and a turn about each axis. `up` are the upward
    directions of the n earlier rests on body axes, (n, 3).
    """
    turns = [Step(np.roll(u, 1), axis) for u, axis in zip(np.eye(3), "xyz", strict=True)]
    far = [ATTITUDES[(ATTITUDES @ rests.T).max(axis=1) < np.cos(FAR)] for rests in (up, up[-1:])]
    return [Step(u) for u in far[0]] or [*map(Step, far[1]), *turns]


def simulate_steps(steps, now, calibration, recording):
    """Return a simulated Recording of m steps: two rests and the turn between them for each step.

    Each step is its own session. The values have no noise. All rests have the duration and the
    variance of that rest of `recording` whose duration is the median. All turns have the same
    variance by undersampling, the mean over the rotations of `recording`; they have no lost samples
    and no jitter.

    Parameters
    ----------
    steps : list of Step
        The m steps.
    now : ndarray, shape (3,)
        Present upward direction on body axes.
    calibration : Calibration
        Calibration that converts true values to nominal SI.
    recording : Recording
        Poses and rotations so far.
    """
    before, turns, move_s = map(np.array, zip(*(step.turn(now) for step in steps), strict=True))
    turns, m = turns[:, None], len(steps)
    angles = (_SHARE - np.sin(2 * np.pi * _SHARE) / (2 * np.pi)) * turns
    attitude = matrix(exponential(angles.reshape(-1, 3))).reshape(*angles.shape, 3)
    along = calibration.gravity * np.einsum("mkji,mj->mki", attitude, before)
    rates = (1 - np.cos(2 * np.pi * _SHARE)) * turns / move_s[:, None, None]

    def to_nominal(sensor, values):
        """Return the nominal SI values that the sensor with the name `sensor` logs, (..., 3).

        `values`, (..., 3), are the true values, SI.
        """
        model = getattr(calibration, sensor)
        return model.raw_unit.to_si(values @ np.linalg.inv(model.T).T / model.K + model.b)

    poses = recording.poses
    rest = poses.select(np.argsort(poses.duration_s)[[len(poses) // 2] * 2 * m])
    session, zeros, rest_s = np.repeat(np.arange(m), 2), np.zeros((2 * m, 3)), rest.duration_s[0]
    start_s = np.stack([np.zeros(m), rest_s + move_s], axis=1).ravel()
    rest = replace(rest, session=session, start_s=start_s, end_s=start_s + rest_s)
    rest = replace(rest, power_cycle=-1 - session, w=to_nominal("gyroscope", zeros))
    rest = replace(rest, f=to_nominal("accelerometer", along[:, [0, -1]].reshape(-1, 3)))
    rest = replace(rest, tilt=zeros[:, 0], to_ends_s=zeros[:, :2])
    t, aliased = rest_s + _SHARE.T * move_s[:, None], recording.rotations.aliased
    temperature = None if rest.temperature is None else np.full(t.shape, rest.temperature[0])
    undersampling = aliased.mean() if len(aliased) else 0.0
    rotations = Rotations(
        first=2 * np.arange(m),
        start_s=t[:, 0],
        end_s=t[:, -1],
        t=t,
        w=to_nominal("gyroscope", rates),
        f=to_nominal("accelerometer", along),
        temperature=temperature,
        extra_at=np.zeros((m, 1), int),
        time_covariance=np.zeros((m, 1, 3, 3)),
        aliasing_covariance=np.tile(np.eye(3) * undersampling, (m, 1, 1, 1)),
    )
    return Recording(rest, rotations)


def next_step(calibration, noise, recording):
    """Return the entry of diagnosis.json on the next step, a dict: the parameter and the step.

    It is empty if the noise of a channel is not known, or if a pose has no specific force. An error
    is good enough if it is at most the noise of a mean over one second. `calibration`, `noise` and
    `recording` are the Calibration, NoiseModel and Recording of the device.
    """
    poses = recording.poses
    enough = np.sqrt(noise.mean_covariance(np.array([[0.0, 1.0]]))[:, 0, 0])
    has_force = np.linalg.norm(poses.f, axis=1) > 0
    if not (has_force.any() and has_force.all() and enough.all()) or poses.unknown_noise(
        noise, CHANNELS
    ):
        return {}
    advice = next_pose_or_turn(calibration, noise, recording, enough)
    return asdict(advice) | {"step": str(advice.step)}
