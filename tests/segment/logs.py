"""Logs for the tests of the segment stage: a small generator with known truth, and recordings."""

import json
from itertools import accumulate

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TIME

G = 9.80665
# standard deviation of one sample of a phone at rest, m/s^2 and rad/s
PHONE = np.array([0.0089, 0.0097, 0.0098, 0.00073, 0.00073, 0.00063])


def frame(t, f, w):
    return pd.DataFrame(np.column_stack([t - t[0], f, w]), columns=[TIME, *CHANNELS])


def static_log(seed, n, rate=100.0):
    x = np.random.default_rng(seed).normal(size=(n, 6)) * PHONE
    x[:, 2] -= G
    return frame(np.arange(n) / rate, x[:, :3], x[:, 3:])


def pose_log(turns, rests, seed=0, rate=100.0, turn_s=2.0, noise=PHONE, bias=(0.01, -0.02, 0.015)):
    """Return a log of rests with turns between, and the true rests.

    Parameters: `turns`, one rotation vector (rad) on body axes for each turn, run through with a
    raised-cosine rate in `turn_s`; `rests`, the length of each rest in s, one more than turns.
    """
    rng = np.random.default_rng(seed)
    m = round(turn_s * rate)
    profile = (1 - np.cos(2 * np.pi * (np.arange(m) + 0.5) / m)) / turn_s
    rates, truth, now = [], [], 0
    for k, rest in enumerate(rests):
        n = round(rest * rate)
        rates.append(np.zeros((n, 3)))
        truth.append((now / rate, (now + n) / rate))
        now += n
        if k < len(turns):
            rates.append(profile[:, None] * np.asarray(turns[k]))
            now += m
    w = np.concatenate(rates)
    steps = Rotation.from_rotvec(w / rate).as_matrix()
    attitudes = np.array(list(accumulate(steps[:-1], np.matmul, initial=np.eye(3))))
    noisy = np.hstack([G * attitudes[:, 2], w + bias]) + rng.normal(size=(len(w), 6)) * noise
    return frame(np.arange(len(w)) / rate, noisy[:, :3], noisy[:, 3:]), np.array(truth)


def rests_of(segments):
    return segments[segments["kind"] == "static"]


def random_turns(n, seed):
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(n, 3))
    return axes / np.linalg.norm(axes, axis=1)[:, None] * rng.uniform(0.7, 2.4, size=(n, 1))


def rotate(samples, rotation):
    out = samples.copy()
    for channels in (ACCELERATION, ANGULAR_RATE):
        out[list(channels)] = samples[list(channels)].to_numpy() @ rotation.as_matrix().T
    return out


def xsens(recordings):
    """Return the Xsens MTi log in nominal SI units (factory scales, offset 32768)."""
    f, w = (np.loadtxt(recordings(f"xsens_{s}.mat")) for s in ("acc", "gyro"))
    return frame(f[:, 0], (f[:, 1:] - 32768) / 415, (w[:, 1:] - 32768) / 4768)


def carlsson_array(recordings, experiment, chip):
    """Return the log of one of eight chips of an array, experiment 1 or 5, by the data sheet."""
    x = pd.read_parquet(recordings(f"exp_{experiment}.parquet"))
    f, w = (x[[f"{s}{axis}{chip}" for axis in "xyz"]].to_numpy() for s in "ag")
    return frame(x["t_us"].to_numpy() * 1e-6, f * 9.818 / 2048, np.deg2rad(w / 16.4))


def mpu9150(recordings, board):
    x = np.loadtxt(recordings(f"imu{board}.log"))
    return frame(np.arange(len(x)) / 100, x[:, :3], x[:, 3:])


def ferraris(recordings):
    x = pd.read_csv(recordings("example_ferraris_session.csv"))
    f = x[["acc_x", "acc_y", "acc_z"]].to_numpy()
    w = np.deg2rad(x[["gyr_x", "gyr_y", "gyr_z"]].to_numpy())
    sections = recordings("example_ferraris_session_list.json").read_text()
    return frame(np.arange(len(x)) / 204.8, f, w), json.loads(sections)


def thermal_chamber(recordings):
    """Return the climate-chamber log; its time column is in microseconds."""
    x = pd.read_csv(recordings("imu_raw_data.csv"), sep="\t")
    f, w = (x[[f"imu.{s}.{axis}" for axis in "xyz"]].to_numpy() for s in ("acc", "gyro"))
    return frame(x["timestamp"].to_numpy() * 1e-6, f, w)


def adis16405(recordings):
    x = pd.read_parquet(recordings("adis_16405_imu1.parquet"))
    f = x[["ax", "ay", "az"]].to_numpy() * G
    return frame(np.arange(len(x)) / 100, f, np.deg2rad(x[["gx", "gy", "gz"]].to_numpy()))
