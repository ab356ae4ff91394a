"""Logs of planned rests and turns, with the noise of a simulated device."""

from itertools import pairwise

import numpy as np
import pandas as pd

from imuloop.core.rotation import shortest_turn
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.model.effect import Channels
from imuloop.simulate.motion import chain, move, rest
from imuloop.simulate.sensor import logged, output


def turns_between(up):
    """Return the shortest turns, rad, (n - 1, 3), that bring one direction after another up."""
    return np.array([shortest_turn(*pair) for pair in pairwise(up)])


def simulate_plan(truth, up, turns, seed, initial_rest_s=10.0, move_s=2.0):
    """Return the log of rests of 4 s, the first longer, and turns; `up` is up in the first."""
    rate, hold = truth.rate, round(4.0 * truth.rate)
    pieces = [rest(round(initial_rest_s * rate), 0)]
    for pose, (turn, seconds) in enumerate(zip(turns, np.resize(move_s, len(turns)), strict=True)):
        pieces += [move(round(seconds * rate), 1 / rate, turn), rest(hold, pose + 1)]
    motion = chain(pieces, up, truth.gravity, rate)
    log = {TIME: motion.t}
    force, angular = motion.specific_force, motion.angular_rate
    seeds = np.random.SeedSequence([seed, 77]).spawn(2)
    for sensor, x, other, columns, noise_seed in (
        (truth.accelerometer, force, angular, ACCELERATION, seeds[0]),
        (truth.gyroscope, angular, force, ANGULAR_RATE, seeds[1]),
    ):
        u = output(sensor, x, lambda u, other=other: Channels(motion.t, u, other))
        log |= dict(zip(columns, logged(sensor, u, sensor.b, 1 / rate, noise_seed).T, strict=True))
    return pd.DataFrame(log)
