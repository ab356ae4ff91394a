"""Sound logs to be harmed, honest logs that look as if they were, and logs of motion."""

from functools import cache

import numpy as np
import pandas as pd
from scipy.signal import butter, lfilter
from scipy.spatial.transform import Rotation

from calibrate.devices import plan_session
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TEMPERATURE
from imuloop.core.units import DEGREE
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth

FORCE, RATE, ALL = list(ACCELERATION), list(ANGULAR_RATE), list(CHANNELS)
# least significant bits of a common part: noise of 3 and of 1.5 of them
STEPS = [0.0048] * 3 + [0.00106] * 3

# --- sound logs


def simulated(session, seed=5, truth=None, **changed):
    return simulate_session(
        plan_session(truth or example_truth(), session, **changed), session, seed
    )


@cache
def _stepped(session, seed=5, rate=100.0, **changed):
    log = simulated(session, seed, example_truth(rate=rate), **changed)
    log[ALL] = np.round(log[ALL] / STEPS) * STEPS
    noise = np.random.default_rng(seed).normal(size=len(log))
    log[TEMPERATURE] = np.round(25 + 5 * log.t / log.t.iloc[-1] + 0.02 * noise, 2)
    return log.assign(t=np.arange(len(log)) / rate)


def poses(rate=100.0, seed=5):
    """Eight poses by hand, in steps of an integer's last bit, with a thermometer that warms up."""
    return _stepped("multi_position", seed, rate, poses=8).copy()


def rest():
    """The same device for seventy seconds at rest."""
    return _stepped("static", duration_s=70.0).copy()


def brief(rows=500):
    """5 s at 100 Hz at rest, z up; whole 1e-6, so text keeps it exactly."""
    noise = 0.01 * np.random.default_rng(7).normal(size=(rows, 6))
    mean = np.array([0.1, -0.2, 9.8, 0, 0, 0.01])
    log = pd.DataFrame(np.round(mean + noise, 6), columns=ALL)
    log.insert(0, "t", np.arange(rows) / 100)
    return log


def at_rate(kind, rate):
    """Six poses, or 300 samples at rest, of the same device at another rate."""
    more = {"poses": 6} if kind == "multi_position" else {"duration_s": max(30.0, 300 / rate)}
    log = simulated(kind, 3, example_truth(rate=rate), **more)
    return log.assign(t=np.arange(len(log)) / rate)


def swaying(about=None):
    """200 s, turned to and fro about x and z by the true time, or by the times that are given."""
    t = np.arange(20_000) / 100 if about is None else about
    table = brief(20_000)
    table[RATE] = np.random.default_rng(11).normal(0, 0.005, (20_000, 3))
    for k, name in enumerate(("gx", "gz")):
        table[name] += 2 * np.sin((k + 2) * t)
    return table


# --- honest logs that look like a fault, and motion


def gait():
    """A walk: all power is below 10 Hz, and means of a second are smaller than means of less."""
    rng = np.random.default_rng(12)
    log = pd.DataFrame({"t": np.arange(30_000) / 100})
    swing = 1.5 + np.sin(np.arange(30_000) / 900)
    for name in ALL:
        steps = np.diff(lfilter(*butter(2, 0.1), rng.normal(size=30_001)))
        log[name] = swing * steps * (50 if name[0] == "a" else 10) + 9.8 * (name == "az")
        log[name] += 1e-3 * rng.normal(size=30_000)
    return log


def about_x():
    """A log that is turned about x alone."""
    t = np.arange(6000) / 100
    angle = 1.2 * np.sin(2 * np.pi * t / 6) * (t > 6)
    log = brief(6000).assign(ax=0.0, ay=9.8 * np.sin(angle), az=9.8 * np.cos(angle), gy=0.0, gz=0.0)
    log["gx"] = np.gradient(angle, t)
    log[ALL] += np.random.default_rng(1).normal(size=(6000, 6)) * 0.02
    return log


def between_two_levels():
    """Noise far below the step: stretches of thousands of samples at one value are its nature."""
    rng = np.random.default_rng(4)
    log = pd.DataFrame({"t": np.arange(30_000) / 100})
    drift = 0.4 * np.sin(np.arange(30_000) / 3000)
    for i, name in enumerate(ALL):
        mean = 9.8 if name == "az" else 0.3 * i
        log[name] = np.round((mean + drift) / 0.15 + 0.1 * rng.normal(size=30_000)) * 0.15
    return log


def flight(rate=200.0, tilt=4.0):
    """A drone in hover: thrust along z whatever its attitude, which sways by some degrees."""
    rng, n = np.random.default_rng(1), round(120 * rate)
    slow = lfilter(*butter(2, [0.1 / rate, 2 / rate], "band"), rng.normal(size=(n, 3)), axis=0)
    angle = slow / slow.std() * tilt * DEGREE
    shake = lfilter(*butter(2, 0.3, "high"), rng.normal(size=(n, 6)), axis=0)
    log = pd.DataFrame({"t": np.arange(n) / rate})
    log[FORCE] = [0, 0, 9.8] + 0.8 * shake[:, :3] + 0.2 * angle
    log[RATE] = np.gradient(angle, 1 / rate, axis=0) + 0.05 * shake[:, 3:]
    return log


def tilting(degrees, seed=1, seconds=1200.0, rate=20.0, over=600.0):
    """A device at rest on something that tilts slowly, with a fair gyroscope."""
    t = np.arange(round(seconds * rate)) / rate
    angle = degrees * DEGREE * np.clip((t - (seconds - over) / 2) / over, 0, 1)
    log = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, 0.0)})
    log["ay"], log["az"] = 9.8 * np.sin(angle), 9.8 * np.cos(angle)
    log["gx"] = np.gradient(angle, 1 / rate)
    noise = np.random.default_rng(seed).normal(size=(len(t), 6))
    log[ALL] += noise * ([5e-3] * 3 + [1e-3] * 3)
    return log


def swinging(rate, seconds=60.0):
    """A log that never rests: swings about two axes, gravity alone as its force."""
    t = np.arange(round(seconds * rate)) / rate
    angles = np.column_stack([0.9 * np.sin(1.1 * t), 0.8 * np.sin(1.7 * t + 1)])
    body = Rotation.from_euler("xy", angles)
    log = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, 0.0)})
    log[FORCE] = body.inv().apply([0, 0, 9.8])
    log.loc[1:, RATE] = (body[:-1].inv() * body[1:]).as_rotvec() * rate
    log[ALL] += np.random.default_rng(4).normal(size=(len(t), 6)) * ([2e-2] * 3 + [2e-3] * 3)
    return log


def turning_at_once():
    """Turns about z that begin and end within a sample."""
    t = np.arange(12_000) / 200
    log = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, 0.0)})
    log["ax"], log["ay"], log["az"] = 0.05, 0.02, 9.81
    log["gz"] = np.where(t % 10 < 2, np.pi / 4, 0.0)
    log[ALL] += np.random.default_rng(5).normal(0, [1e-2] * 3 + [1e-3] * 3, (len(t), 6))
    return log


def drifting_with_temperature(seed):
    """60 mg and 0.1 deg/s over a ramp, on axes at random."""
    log, rng = tilting(0.0, seed), np.random.default_rng(seed)
    course = np.sin(np.pi * np.linspace(0, 1, len(log)))[:, None]
    log[FORCE] += course * rng.normal(size=3) * 0.6
    log[RATE] += course * rng.normal(size=3) * 0.1 * DEGREE
    return log


def increments(log, rate, force=1.0, turn=1.0):
    """Increments of velocity and angle per sample, in units of 1/force and 1/turn of SI."""
    return log.assign(**(log[FORCE] * force / rate), **(log[RATE] * turn / rate))
