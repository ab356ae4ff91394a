"""Single samples that no body makes are dropped and counted; what a body makes is not touched."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, lfilter

from imuloop.core.samples import CHANNELS
from imuloop.ingest import spikes
from ingest.logs import rest

N, RATE = 10_000, 100.0
T = np.arange(N) / RATE
NO_STEP = np.zeros(6)
NOISE = np.array([[0.02]] * 3 + [[0.001]] * 3)


def noise(seed=1):
    return NOISE * np.random.default_rng(seed).standard_normal((6, N))


def turns(seconds, angle):
    """Turns of minimum jerk about all axes, s and rad each, with rests between, and gravity."""
    # there and back
    u = T % (2 * seconds + 1)
    x = np.clip(np.minimum(u, 2 * seconds + 0.5 - u) / seconds, 0, 1)
    rate = np.where(u < seconds + 0.25, 30, -30) * angle / seconds * x**2 * (1 - x) ** 2
    rate = rate * np.array([[0.8], [-0.5], [0.3]])
    force = 9.8 * np.sin(angle * x**3 * (10 - 15 * x + 6 * x**2) + np.arange(3)[:, None])
    return np.vstack([force, rate])


def knocks(samples):
    """Knocks on a table, of any direction: the device rings for some samples, or for one."""
    rng, x = np.random.default_rng(2), np.zeros((6, N))
    for at in rng.integers(50, N - 50, 50):
        size = rng.normal(size=6) * [20, 20, 20, 0.5, 0.5, 0.5] * 10 ** rng.uniform(-1, 0)
        ringing = np.exp(-np.arange(samples) / max(samples / 4, 0.1)) * np.cos(
            rng.uniform(1, 3) * np.arange(samples)
        )
        x[:, at : at + samples] += size[:, None] * ringing
    return x


def vibration(frequency):
    """A motor that starts and stops: above half the rate it is folded, near it, it beats."""
    on = lfilter([0.2], [1, -0.8], (T % 7 > 3.0).astype(float))
    phase = np.arange(6)[:, None]
    return on * np.array([[3.0]] * 3 + [[0.2]] * 3) * np.sin(2 * np.pi * frequency * T + phase)


def set_down():
    """Set down hard: the force jumps and stays, as a filter of the sensor lets it."""
    x = np.zeros((6, N))
    x[:3] = lfilter(*butter(2, 0.7), 5.0 * (np.arange(N) // 997 % 2))
    return x


BODIES = {
    "rest": 0.0,
    "turns by hand": turns(1.5, 2.0),
    "turns as fast as a hand can, ten samples each": turns(0.1, 2.0),
    "knocks that ring": knocks(12),
    "knocks of a single sample": knocks(1),
    "set down hard": set_down(),
    **{f"vibration of {f} Hz": vibration(f) for f in (7.0, 31.0, 49.0, 50.3, 83.0, 148.0)},
    "noise with tails": 3 * NOISE * np.random.default_rng(3).laplace(size=(6, N)),
}


@pytest.mark.parametrize("body", BODIES)
def test_what_a_body_makes_is_no_spike(body):
    assert spikes.isolated(BODIES[body] + noise(), NO_STEP).sum() == 0


@pytest.mark.parametrize("share", [0.1, 0.3, 1.0, 3.0])
def test_steps_of_resolution_are_no_spikes(share):
    # far above the noise a value changes now and then by a step, alone and back again
    steps = NOISE[:, 0] / share
    x = np.round((turns(4.0, 0.5) + noise()) / steps[:, None]) * steps[:, None]
    assert spikes.isolated(x, steps).sum() == 0


@pytest.mark.parametrize("body", ["rest", "turns by hand"])
@pytest.mark.parametrize("sigmas", [60, 1000])
def test_single_values_far_off_are_found_and_no_other(body, sigmas):
    x, put, rng = BODIES[body] + noise(), np.zeros((6, N), dtype=bool), np.random.default_rng(4)
    at = np.arange(100, N - 100, 199)
    put[rng.integers(6, size=len(at)), at] = True
    # the larger of two near to each other must not hide the smaller
    put[2, 5003], put[4, 5007] = True, True
    x += put * NOISE * sigmas * rng.choice([-1, 1], x.shape)
    np.testing.assert_array_equal(spikes.isolated(x, NO_STEP), put)


@pytest.mark.parametrize(("sigmas", "is_spike"), [(60, False), (2000, True)])
def test_chance_on_another_axis_makes_no_knock_of_a_large_spike(sigmas, is_spike):
    x = noise()
    x[3, 5000] += sigmas * NOISE[3, 0]
    # a fifth of a small spike, less than a hundredth of a large one
    x[0, 4998:5003] = 0.0, 0.0, 12 * NOISE[0, 0], 0.0, 0.0
    assert spikes.isolated(x, NO_STEP)[3, 5000] == is_spike


def test_rows_of_spikes_are_dropped_counted_and_named(run):
    log = rest()[:2000]
    put = {99: "ay", 299: "gz", 1234: "gz", 1400: "gx"}
    for row, name in put.items():
        log.loc[row, name] += 3.0
    samples, found, *_ = run(log, kind="static")
    np.testing.assert_array_equal(samples[[*CHANNELS]], log.drop(index=[*put])[[*CHANNELS]])
    assert found["status"] == "ok" and found["spiked"] == 4 and found["gaps"]["count"] == 0
    assert found["spike_values"] == {**dict.fromkeys(CHANNELS, 0), "ay": 1, "gx": 1, "gz": 2}
    text = "4 rows dropped for a spike that no body makes: ay 1, gx 1, gz 2"
    assert any(line.startswith(text) for line in found["warnings"])
    # what the log kept is as good as if nothing had been there
    assert not any(found["faults"]["spikes"].values())


def test_a_log_with_too_many_spikes_is_rejected(run):
    log = pd.DataFrame({"t": T, **dict(zip(CHANNELS, noise(), strict=True))})
    log["az"] += 9.8
    log.loc[50 : N - 50 : 15, "gx"] += 1.0
    [reason] = run(log, kind="static").quality["reasons"]
    assert "with a spike (gx " in reason
