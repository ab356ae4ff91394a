"""The course of a session: the rests and moves that it consists of."""

import numpy as np
from scipy.spatial.transform import Rotation

from imuloop.core.errors import ImuloopError
from imuloop.core.rotation import shortest_turn
from imuloop.core.sphere import fibonacci_lattice
from imuloop.core.units import DEGREE
from imuloop.simulate.motion import hum, knock, move, rest

# upward axes of the six faces, in an order of quarter turns
FACES = np.array([[0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, 1, 0], [0, -1, 0.0]])
# a hand-like move: wobble and tremor in rad, linear acceleration in m/s^2
HAND = {"wobble": 5 * DEGREE, "tremor": 0.15 * DEGREE, "shake": 0.8}


def spread(n, rng):
    """Return `n` unit vectors evenly spread over the sphere, (n, 3), in random order.

    The whole set is rotated at random. `rng` is a numpy Generator, the source of random numbers.
    """
    return rng.permutation(Rotation.random(rng=rng).apply(fibonacci_lattice(n)))


def tilted(directions, degrees, rng):
    """Return n unit vectors, (n, 3), each tilted by a random angle about a random axis.

    `directions`, (n, 3), are the unit vectors before the tilt, and `degrees` is the standard
    deviation of the tilt about each of two axes perpendicular to a vector, degrees. `rng` is a
    numpy Generator, the source of random numbers.
    """
    tilt = rng.standard_normal(directions.shape) * degrees * DEGREE
    vectors = directions + np.cross(tilt, directions)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def poses(session, rate, rng):
    """Return the pieces of a session with many poses, and the upward direction at its start, (3,).

    A pose is an attitude in which the device lies still. The session has six or many positions. The
    pieces are a list of Piece, in which a rest and a move alternate. The upward direction is a unit
    vector on body axes. `session` is a SessionTruth, `rate` the sampling rate, Hz, and `rng` a
    numpy Generator, the source of random numbers.
    """
    if session.kind == "six_position":
        up = tilted(np.tile(FACES, (session.repeats, 1)), session.placement_deg, rng)
    else:
        start = np.divide(session.up, np.linalg.norm(session.up))
        up = np.vstack([start, spread(session.poses, rng)])
    # poses in which the device is turned about the vertical, and poses while the motor runs
    yawed = set(rng.permutation(len(up))[: session.turns_about_vertical])
    shaken, motor = set(), session.vibration
    if motor:
        # the first pose is left out
        shaken = set(1 + rng.permutation(len(up) - 1)[: round(motor.share * (len(up) - 1))])

    def samples(span):
        """Return the number of samples of a random duration, between the two ends of `span`, s."""
        return round(rng.uniform(*span) * rate)

    def random_rest(pose):
        """Return a rest of random duration in a pose, a Piece.

        `pose` is the number of the pose. The rest vibrates if the motor runs during this pose.
        """
        n, vibration = samples(session.rest_s), None
        if pose in shaken:
            rms, frequency = rng.uniform(*motor.rms), rng.uniform(*motor.frequency)
            vibration = hum(n, 1 / rate, rms, frequency, rng)
        return rest(n, pose, vibration)

    pieces = [rest(round(session.initial_rest_s * rate), 0)]
    for pose, new_up in enumerate(up):
        if pose > 0:
            # a turn about the vertical by up to 60°, then the shortest one to the new upward axis
            old_up = up[pose - 1]
            yaw = Rotation.from_rotvec(old_up * rng.uniform(-60, 60) * DEGREE)
            turn = yaw * Rotation.from_rotvec(shortest_turn(old_up, new_up))
            n, vector = samples(session.move_s), turn.as_rotvec()
            pieces.append(move(n, 1 / rate, vector, rng=rng, **HAND))
            pieces.append(random_rest(pose))
        if pose in yawed:
            angle = rng.choice([-1, 1]) * rng.uniform(40, 150) * DEGREE
            pieces.append(move(samples((3.0, 6.0)), 1 / rate, new_up * angle))
            pieces.append(random_rest(pose))
    return pieces, up[0]


def at_rest(session, rate, rng):
    """Return the pieces of a session at rest, and the upward direction at its start, (3,).

    The pieces are a list of Piece, in which a rest and a disturbance alternate. A knock is a short
    burst of acceleration. A tilt is a lasting turn about a horizontal axis. Handling is some
    seconds of wobble, tremor and acceleration, after which the attitude is the same as before. The
    upward direction is a unit vector on body axes.

    `session` is a SessionTruth, `rate` the sampling rate, Hz, and `rng` a numpy Generator, the
    source of random numbers. Raises an ImuloopError if disturbances overlap, are not in order of
    time or do not fit in the session.
    """
    up = start = np.divide(session.up, np.linalg.norm(session.up))
    events = [(d.time_s, d.time_s + d.duration_s) for d in session.disturbances]
    # start of the session, start and end of each disturbance, end of the session
    edges = np.ravel([(0.0, 0.0), *events, (session.duration_s,) * 2])
    if np.any(np.diff(edges) < 0):
        raise ImuloopError(f"disturbances overlap or leave the session: {events} s")
    # `done` is the number of samples so far; a tilt makes a new pose
    pieces, pose, done = [], 0, 0
    for disturbance in session.disturbances:
        first, n = round(disturbance.time_s * rate), round(disturbance.duration_s * rate)
        pieces.append(rest(first - done, pose))
        angle = disturbance.size * DEGREE
        if disturbance.kind == "knock":
            pieces.append(knock(n, 1 / rate, disturbance.size, rng))
        elif disturbance.kind == "handling":
            hand = {"wobble": angle, "tremor": angle / 50, "shake": 0.1 * disturbance.size}
            pieces.append(move(n, 1 / rate, np.zeros(3), rng=rng, **hand))
        else:
            axis = rng.standard_normal(3) if disturbance.axis is None else disturbance.axis
            # the level part of the axis
            axis = axis - np.dot(axis, up) * up
            turn = axis / np.linalg.norm(axis) * angle
            pieces.append(move(n, 1 / rate, turn))
            # the vertical turns the other way on body axes
            up, pose = Rotation.from_rotvec(turn).inv().apply(up), pose + 1
        done = first + n
    pieces.append(rest(round(session.duration_s * rate) - done, pose))
    return [piece for piece in pieces if len(piece.rate)], start
