"""What limits a calibration, and the rest or the turn that would improve it most."""

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

# what a first session should hold: seconds at rest before all, poses, seconds of a rest, of a move
# and of a turn of 360 degrees by hand
INITIAL_REST_S, POSES, REST_S, MOVE_S, FULL_TURN_S = 50.0, 40, 4.0, 2.0, 5.0
# rate that errors of the gyroscope's output are weighed at, rad/s; the accelerometer's at 1 g
RATE_IN_USE = 100 * DEGREE
# faces, edges and corners of a box, each of them up
ATTITUDES = np.array([v / np.linalg.norm(v) for v in product((1.0, 0, -1.0), repeat=3) if any(v)])
# angle to the nearest rest from which on an attitude is one more, rad
FAR = 40 * DEGREE
# samples of a turn, as shares of it: enough to follow it
_SHARE = np.linspace(0, 1, 64)[:, None]


@dataclass(frozen=True)
class Step:
    """A rest in another attitude or, with an axis, a turn of 360 degrees about it between rests.

    `up` is the upward direction on body axes, (3,): in the rest, or where a turn begins and ends.
    """

    up: np.ndarray
    axis: str | None = None

    def __str__(self):
        if self.axis:
            return f"turn it by 360° about {self.axis}, with that axis level"
        return f"turn it until {direction_words(self.up)} is up, and let go for {REST_S:.0f} s"

    def turn(self, now):
        """Return the upward direction before its turn, the turn, rad on body axes, and its length.

        The length is in s; `now` is the direction that is up now.
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
        ``gyroscope``, ``K2``.
    error, ratio : float
        Error of a reading by it at 1 g or 100 deg/s, SI, and that over what is good enough.
    std, std_after : float
        Its standard error before and after the step, SI as logged.
    step : Step
        What to do.
    """

    sensor: str
    parameter: str
    error: float
    ratio: float
    std: float
    std_after: float
    step: Step


def next_pose_or_turn(calibration, noise, recording, enough, letters="TKb"):
    """Return the Advice on what to do next.

    After a step the covariance is ``C - C Jᵀ (J C Jᵀ + R)⁻¹ J C``. J are the derivatives of the
    residuals that it adds; R is their covariance by the noise and, where residuals exceed that, so
    many times as much. Takes the Calibration by a Recording of one pose or more, the NoiseModel,
    the errors of the six channels that are good enough, SI, and the letters of what counts.
    """
    needs = set() if recording.poses.temperature is None else {"temperature"}
    effects = [
        SensorEffect(e.effect, sensor)
        for sensor in SENSORS
        for e in getattr(calibration, sensor).effects
        # what any rest or turn shows
        if not (e.effect.timed or e.effect.rate_of_change) and needs.issuperset(e.effect.needs)
    ]
    (state, covariance), limits = state_of(calibration, effects), []
    use = {"accelerometer": calibration.gravity, "gyroscope": RATE_IN_USE}
    for k, (sensor, base) in enumerate(NAMES.items()):
        own = getattr(calibration, sensor)
        # what was not estimated has the prior's
        before = (own.prior or {"std": {}})["std"]
        for name, factor in zip(base, si_factor(base, own.raw_unit), strict=True):
            at = state.names.index(f"{sensor}.{name}")
            covariance[at, at] = covariance[at, at] or (factor * before.get(name, 0.0)) ** 2
            error = np.sqrt(covariance[at, at]) * (1.0 if name[0] == "b" else use[sensor])
            if name[0] in letters:
                limits.append((error / enough[3 * k + int(name[1])], error, at, sensor, name))
    ratio, error, at, sensor, name = max(limits)
    up = upward(calibration, recording.poses)
    steps = candidates(up)
    made = recorded(steps, up[-1], calibration, recording)
    factors = Factors(calibration.gravity)
    new = factors.about(made, state).at(state.x)
    owners = factors.owners(made).tolist()
    size = np.sqrt([getattr(calibration, owner).excess for owner in owners])
    R, after = new.noise.by(noise) * size[:, None] * size, []
    # the second rest of each session: the first is known already
    ends = factors.rows(made)[0].max(axis=1)
    for k in range(len(steps)):
        own = np.flatnonzero(ends == 2 * k + 1)
        J, gain = new.jacobian[own], covariance @ new.jacobian[own].T
        lost = np.linalg.solve(J @ gain + R[np.ix_(own, own)], gain[at])
        after.append(covariance[at, at] - gain[at] @ lost)
    best = int(np.argmin(after))
    sizes = (float(size) for size in (error, ratio, *np.sqrt([covariance[at, at], after[best]])))
    return Advice(sensor, name, *sizes, steps[best])


def upward(calibration, poses):
    """Return the upward direction on body axes in each of n poses, shape (n, 3)."""
    force = calibration.accelerometer.aligned(poses.f)
    return force / np.linalg.norm(force, axis=1)[:, None]


def candidates(up):
    """Return the Steps to choose from after rests with upward directions, (n, 3).

    Rests come first that are far from all others: where there is none, an effect can hide.
    """
    turns = [Step(np.roll(u, 1), axis) for u, axis in zip(np.eye(3), "xyz", strict=True)]
    far = [ATTITUDES[(ATTITUDES @ made.T).max(axis=1) < np.cos(FAR)] for made in (up, up[-1:])]
    return [Step(u) for u in far[0]] or [*map(Step, far[1]), *turns]


def recorded(steps, now, calibration, recording):
    """Return the Recording of m steps without noise, each a session of two rests and a turn.

    Takes the direction that is up now, the Calibration, and the Recording so far: its median rest
    is one here, and turns are undersampled as its are.
    """
    before, turns, move_s = map(np.array, zip(*(step.turn(now) for step in steps), strict=True))
    turns, m = turns[:, None], len(steps)
    angles = (_SHARE - np.sin(2 * np.pi * _SHARE) / (2 * np.pi)) * turns
    attitude = matrix(exponential(angles.reshape(-1, 3))).reshape(*angles.shape, 3)
    along = calibration.gravity * np.einsum("mkji,mj->mki", attitude, before)
    rates = (1 - np.cos(2 * np.pi * _SHARE)) * turns / move_s[:, None, None]

    def logged(sensor, values):
        own = getattr(calibration, sensor)
        return own.raw_unit.to_si(values @ np.linalg.inv(own.T).T / own.K + own.b)

    poses = recording.poses
    rest = poses.select(np.argsort(poses.duration_s)[[len(poses) // 2] * 2 * m])
    session, nothing, rest_s = np.repeat(np.arange(m), 2), np.zeros((2 * m, 3)), rest.duration_s[0]
    start_s = np.stack([np.zeros(m), rest_s + move_s], axis=1).ravel()
    rest = replace(rest, session=session, start_s=start_s, end_s=start_s + rest_s)
    rest = replace(rest, power_cycle=-1 - session, w=logged("gyroscope", nothing))
    rest = replace(rest, f=logged("accelerometer", along[:, [0, -1]].reshape(-1, 3)))
    rest = replace(rest, tilt=nothing[:, 0], to_start=nothing, to_end=nothing)
    t, lost = rest_s + _SHARE.T * move_s[:, None], recording.rotations.aliased
    warmth = None if rest.temperature is None else np.full(t.shape, rest.temperature[0])
    values = t, logged("gyroscope", rates), logged("accelerometer", along), warmth
    rotations = Rotations(
        *(2 * np.arange(m), t[:, 0], t[:, -1], *values),
        extra_at=np.zeros((m, 1), int),
        time_covariance=np.zeros((m, 1, 3, 3)),
        aliasing_covariance=np.tile(np.eye(3) * (lost.mean() if len(lost) else 0.0), (m, 1, 1, 1)),
    )
    return Recording(rest, rotations)


def next_step(calibration, noise, recording):
    """Return what diagnosis.json holds of the next step; nothing where the noise is not known.

    An error is good enough that is the noise of a mean of one second.
    """
    poses = recording.poses
    enough = np.sqrt(noise.mean_covariance(np.array([[0.0, 1.0]]))[:, 0, 0])
    felt = np.linalg.norm(poses.f, axis=1) > 0
    if not (felt.any() and felt.all() and enough.all()) or poses.unknown_noise(noise, CHANNELS):
        return {}
    found = next_pose_or_turn(calibration, noise, recording, enough)
    return asdict(found) | {"step": str(found.step)}
