"""True motion: attitude, angular rate and specific force, exact at every sample.

An attitude rotates from body axes to level axes, whose third axis is up. So the specific force at
rest is ``f = Cᵀ (0, 0, g)``, with the attitude C and gravity g. The angular rate is on body axes. A
session is a chain of rests and moves. The attitude of a move is a product of rotations about fixed
axes by given angles, so that its angular rate is exact, without an error of integration.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from imuloop.core.rotation import exponential, matrix, multiply, shortest_turn

# physiological tremor of the hand, Hz
TREMOR = (8.0, 12.0)


@dataclass(frozen=True)
class Motion:
    """True motion of a session at n samples."""

    t: np.ndarray  # (n,): time, s
    # (n, 4): quaternions, scalar first, that rotate from body axes to level axes
    attitude: np.ndarray
    specific_force: np.ndarray  # (n, 3): m/s^2, on body axes
    angular_rate: np.ndarray  # (n, 3): rad/s, on body axes
    # a row per rest: `start_s`, `end_s` (half-open) and `pose`, the number of the pose. Rests that
    # differ only by a turn about the vertical have the same number
    rests: pd.DataFrame


@dataclass(frozen=True)
class Piece:
    """A piece of a session: the true motion in a rest, a move or a knock of n samples.

    Attitudes are quaternions, scalar first. They rotate from the body axes to the body axes at the
    start of the piece.
    """

    attitude: np.ndarray  # (n, 4)
    rate: np.ndarray  # (n, 3): angular rate on body axes, rad/s
    acceleration: np.ndarray  # (n, 3): linear acceleration on level axes, m/s^2
    after: np.ndarray  # (4,): attitude one sample after the last
    pose: int = -1  # number of the pose, -1 for a move


def rest(n, pose, acceleration=None):
    """Return a rest of `n` samples, a Piece: the attitude stays the same.

    `pose` is the number of the pose, the attitude in which the device lies. `acceleration`, (n, 3),
    m/s^2, is the acceleration of a vibration on level axes; by default there is none.
    """
    unchanged = np.array([1.0, 0, 0, 0])
    return Piece(
        attitude=np.broadcast_to(unchanged, (n, 4)),
        rate=np.zeros((n, 3)),
        acceleration=np.zeros((n, 3)) if acceleration is None else acceleration,
        after=unchanged,
        pose=pose,
    )


def move(n, dt, turn, wobble=0.0, tremor=0.0, shake=0.0, rng=None):
    """Return a move of `n` samples from rest to rest, a Piece.

    The attitude, relative to that at the start, is ``C = exp(v s) exp(m φ) exp(p ψ)``. v is the
    turn, with the minimum-jerk course ``s = 10τ³ - 15τ⁴ + 6τ⁵``, where τ is the time and goes from
    0 to 1 during the move. φ is a wobble about a second axis m, and ψ a tremor about a third axis
    p. Each factor ``R = exp(a θ)`` is a rotation by the angle θ about the axis a; it changes the
    angular rate ω to ``Rᵀω + a dθ/dt``. Wobble, tremor and linear acceleration fade in and out as
    ``64 τ³(1-τ)³``. The device is at rest again at the sample after the last one.

    Parameters
    ----------
    n : int
        Number of samples.
    dt : float
        Time between two samples, s.
    turn : array_like, shape (3,)
        The turn v, a rotation vector on body axes at the start, rad.
    wobble, tremor : float
        The largest φ and the largest ψ, rad.
    shake : float
        Size of the linear acceleration: standard deviation of the amplitude of its slow part on
        each level axis, m/s^2.
    rng : Generator, optional
        A numpy Generator, the source of axes, phases and frequencies of wobble, tremor and linear
        acceleration. Without it the move has only the turn.

    References
    ----------
    Flash & Hogan, J. Neurosci. 5 (1985) 1688.
    """
    turn, tau, duration = np.asarray(turn, dtype=float), np.arange(n) / n, n * dt
    rising = tau - tau**2
    course, course_rate = tau**3 * (10 - 15 * tau + 6 * tau**2), 30 * rising**2 / duration
    fade, fade_rate = 64 * rising**3, 192 * rising**2 * (1 - 2 * tau) / duration
    # axis, angle and rate of the angle of each factor; the axis of the turn v has the length of v
    factors, acceleration = [(turn, course, course_rate)], np.zeros((n, 3))
    if rng is not None:
        # the axis of the wobble is perpendicular to the axis of the turn, so that the rotations do
        # not commute; the axis of the tremor is random
        axes = rng.standard_normal((2, 3))
        axes[0] -= axes[0] @ turn * turn / max(turn @ turn, 1e-12)
        wobble_axis, tremor_axis = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        omega, phase = 2 * np.pi * rng.uniform(*TREMOR), rng.uniform(0, 2 * np.pi, 2)
        angle = omega * tau * duration + phase[0]
        wave, wave_rate = np.sin(angle), omega * np.cos(angle)
        trembling = fade_rate * wave + fade * wave_rate
        factors.append((wobble_axis, wobble * fade, wobble * fade_rate))
        factors.append((tremor_axis, tremor * fade * wave, tremor * trembling))
        # the hand starts and stops, so the slow part of its acceleration has zero mean
        slow, fast = rng.standard_normal((2, 3)) * shake
        slow_wave = np.sin(2 * np.pi * tau)
        fast_wave = np.sin(omega * tau * duration + phase[1]) / 3
        acceleration = fade[:, None] * (np.outer(slow_wave, slow) + np.outer(fast_wave, fast))
    attitude, rate = np.array([1.0, 0, 0, 0]), np.zeros((n, 3))
    for axis, angle, angle_rate in factors:
        factor = exponential(np.outer(angle, axis))
        attitude = multiply(attitude, factor)
        rate = np.einsum("nji,nj->ni", matrix(factor), rate) + np.outer(angle_rate, axis)
    return Piece(attitude=attitude, rate=rate, acceleration=acceleration, after=exponential(turn))


def knock(n, dt, size, rng):
    """Return a knock of `n` samples, a Piece: decaying acceleration of 15 Hz and a little rocking.

    `dt` is the time between two samples, s, and `size` the amplitude of the acceleration at its
    start, m/s^2. At the end the attitude is the same as before. `rng` is a numpy Generator, the
    source of the random directions.
    """
    t = dt * np.arange(n)
    burst = np.exp(-t / 0.06) * np.sin(2 * np.pi * 15 * t)
    direction = rng.standard_normal(3)
    rocking = move(n, dt, np.zeros(3), tremor=2e-4 * size, rng=rng)
    acceleration = np.outer(burst, size * direction / np.linalg.norm(direction))
    return replace(rocking, acceleration=acceleration)


def hum(n, dt, rms, frequency, rng):
    """Return the hum, the acceleration by a running motor, (n, 3), m/s^2: a sine on a random axis.

    `dt` is the time between two of the `n` samples, s. `rms` is the root mean square of the
    acceleration, m/s^2, and `frequency` that of the sine, Hz. `rng` is a numpy Generator, the
    source of axis and phase.
    """
    direction = rng.standard_normal(3)
    wave = np.sin(2 * np.pi * (frequency * dt * np.arange(n) + rng.random()))
    return np.outer(np.sqrt(2) * rms * wave, direction / np.linalg.norm(direction))


def chain(pieces, up, gravity, rate):
    """Return the Motion of a session: the chain of its pieces, one after the other.

    `pieces` is a list of Piece. `up`, (3,), is the upward direction on body axes at the start, a
    unit vector. `gravity` is local gravity, m/s^2, and `rate` the sampling rate, Hz.
    """
    attitude = exponential(shortest_turn([0, 0, 1.0], up))
    attitudes, forces, rests, first = [], [], [], 0
    for piece in pieces:
        n = len(piece.rate)
        attitudes.append(multiply(attitude, piece.attitude))
        # specific force is acceleration minus gravity, on level axes, then on body axes
        acceleration = piece.acceleration + np.array([0, 0, gravity])
        forces.append(np.einsum("nji,nj->ni", matrix(attitudes[-1]), acceleration))
        if piece.pose >= 0:
            rests.append((first / rate, (first + n) / rate, piece.pose))
        attitude, first = multiply(attitude, piece.after), first + n
    return Motion(
        t=np.arange(first) / rate,
        attitude=np.concatenate(attitudes),
        specific_force=np.concatenate(forces),
        angular_rate=np.concatenate([piece.rate for piece in pieces]),
        rests=pd.DataFrame(rests, columns=["start_s", "end_s", "pose"]),
    )
