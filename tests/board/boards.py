"""Simulated boards: three devices at known places, with known axes, in one motion."""

import zlib
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from imuloop import chain
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.simulate.sensor import logged, output
from imuloop.simulate.simulate import true_motion
from imuloop.simulate.truth import example_truth

# m and rad, on the first device's axes: x_first = C x_device
ARMS = np.array([[0, 0, 0], [0.02, -0.015, 0.004], [-0.012, 0.018, -0.006]])
TURNS = Rotation.from_rotvec([[0, 0, 0], [0, np.pi / 2, 0.02], [0.01, -0.015, 3.1]]).as_matrix()
NAMES = ("first", "second", "third")
SESSION = "multi_position"
# samples of the true motion for each that is logged: their differences are as good as its slope
FINE = 20


def true_board(truth, seed):
    """Return time, specific force and angular rate at each place on its axes, (3, n, 3)."""
    motion = true_motion(replace(truth, rate=truth.rate * FINE), SESSION, seed)
    w = motion.angular_rate
    slope = np.gradient(w, motion.t, axis=0)
    forces, rates = [], []
    for arm, turn in zip(ARMS, TURNS, strict=True):
        force = motion.specific_force + np.cross(slope, arm) + np.cross(w, np.cross(w, arm))
        forces.append((force @ turn)[::FINE])
        rates.append((w @ turn)[::FINE])
    return motion.t[::FINE], np.array(forces), np.array(rates)


def slipped(truth, seed, degrees):
    """Return a change of a board: in each move a knock turns it that no gyroscope sees.

    By an angle of normal components, about the axes of the first device.
    """
    rests = true_motion(truth, SESSION, seed).rests
    knocks = (rests["end_s"][:-1].to_numpy() + rests["start_s"][1:].to_numpy()) / 2
    angles = np.random.default_rng(seed).normal(0, np.radians(degrees), (len(knocks), 3))
    slip = Rotation.identity()
    slips = [slip] + [slip := slip * Rotation.from_rotvec(a) for a in angles]

    def change(t, f, w):
        after = np.searchsorted(knocks, t)
        turned = [
            np.einsum("nji,nj->ni", Rotation.concatenate(slips)[after].as_matrix(), own @ turn.T)
            @ turn
            for own, turn in zip(f, TURNS, strict=True)
        ]
        return np.array(turned), w

    return change


def log(truth, t, f, w, *seed):
    columns = {TIME: t}
    for sensor, x, names in (
        (truth.accelerometer, f, ACCELERATION),
        (truth.gyroscope, w, ANGULAR_RATE),
    ):
        chance = np.random.SeedSequence([*seed, zlib.crc32(names[0].encode())])
        raw = logged(sensor, output(sensor, x, None), sensor.b, 1 / truth.rate, chance)
        columns |= dict(zip(names, raw.T, strict=True))
    return pd.DataFrame(columns)


def logs(seed=1, truth=None, changed=lambda t, f, w: (f, w)):
    """Return the raw logs of a board; `changed` changes what is true at its places."""
    truth = truth or example_truth(rate=50.0)
    t, f, w = true_board(truth, seed)
    f, w = changed(t, f, w)
    return [log(truth, t, *own, seed, k) for k, own in enumerate(zip(f, w, strict=True))]


def calibrated(folder, logs, like=()):
    found = []
    for k, (name, each) in enumerate(zip(NAMES, logs, strict=False)):
        device = chain.Device(name, folder / name, {"poses": SESSION})
        device.folder.mkdir()
        each.to_parquet(device.file("log.parquet"))
        assert chain.ingest(device, "poses", {}, [device.file("log.parquet")]) == []
        for stage in (chain.segment, *(() if like else (chain.noise, chain.calibrate))):
            assert stage(device) == []
        source = like[k] if like else device
        for made, file in (("noise", "noise"), ("multi_position", "calibration")):
            device.file(f"{file}.json").write_text(source.file(f"{made}.json").read_text())
        found.append(device)
    return found
