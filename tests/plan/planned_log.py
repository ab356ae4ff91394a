"""Logs of a plan, with the noise of a simulated device."""

import numpy as np
import pandas as pd

from imuloop.core.effect import Channels
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.simulate.motion import chain, move, rest
from imuloop.simulate.sensor import logged, output


def simulate_plan(truth, plan, seed, hold_s, move_s):
    rate = truth.rate
    pieces = [rest(round(plan.initial_rest_s * rate), 0)]
    for pose, (turn, seconds) in enumerate(zip(plan.turns, move_s, strict=True)):
        pieces.append(move(round(seconds * rate), 1 / rate, turn))
        pieces.append(rest(round(hold_s * rate), pose + 1))
    motion = chain(pieces, plan.up, truth.gravity, rate)
    log = {TIME: motion.t}
    force, angular = motion.specific_force, motion.angular_rate
    seeds = np.random.SeedSequence([seed, 77]).spawn(2)
    for sensor, x, other, columns, each in (
        (truth.accelerometer, force, angular, ACCELERATION, seeds[0]),
        (truth.gyroscope, angular, force, ANGULAR_RATE, seeds[1]),
    ):
        u = output(sensor, x, lambda u, other=other: Channels(motion.t, u, other))
        log |= dict(zip(columns, logged(sensor, u, sensor.b, 1 / rate, each).T, strict=True))
    return pd.DataFrame(log)
