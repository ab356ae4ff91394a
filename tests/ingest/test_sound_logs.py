"""Logs of good sensors, in any motion: no line, no row lost, and turns that agree."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from bench.realistic.device import record
from imuloop.core.samples import CHANNELS
from imuloop.simulate.truth import Disturbance, Vibration, read_truth
from ingest.harm import in_packets, later
from ingest.logs import ALL, poses, rest, simulated

DISTURBANCES = (Disturbance("knock", 50, 4),)
VIBRATION = Vibration(0.5, (0.05, 0.8), (12, 45))
SOUND = [("example", "multi_position", {"poses": 12}), ("iphone_6", "six_position", {}),
         ("iphone_6", "multi_position", {"poses": 12, "vibration": VIBRATION}),
         ("example", "static", {"duration_s": 300.0, "disturbances": DISTURBANCES})]  # fmt: skip


@pytest.mark.parametrize(("truth", "kind", "changed"), SOUND)
def test_a_sound_log_has_no_line(repository, run, truth, kind, changed):
    truth = read_truth(repository / f"data/replicas/{truth}.yaml") if truth != "example" else None
    quality = run(simulated(kind, 900, truth, **changed), kind=kind).quality
    assert (quality["reasons"], quality["warnings"]) == ([], [])


# the ends of a slow turn must not count as bias
@pytest.mark.parametrize(("seed", "case"), [(14, "slow_turns"), (46, "lossy")])
def test_turns_go_as_far_as_the_scale_factor_says(run, seed, case):
    log = record(seed, case)
    ratio = run(pd.DataFrame(log.columns)).quality["faults"]["rests"]["turn_ratio"]
    assert abs(ratio["value"] * log.gyroscope.K.mean() - 1) < 0.02


T = np.arange(7000) / 100


def knocks(samples):
    """Knocks on a table, of any direction: the device rings for some samples, or for one."""
    rng, x = np.random.default_rng(2), np.zeros((7000, 6))
    for row in rng.integers(50, 6950, 50):
        size = rng.normal(size=6) * [20, 20, 20, 0.5, 0.5, 0.5] * 10 ** rng.uniform(-1, 0)
        decay = np.exp(-np.arange(samples) / max(samples / 4, 0.1))
        x[row : row + samples] += np.outer(decay * np.cos(2 * np.arange(samples)), size)
    return x


def vibration(frequency):
    """A motor that starts and stops: above half the rate it is folded, near it, it beats."""
    on = lfilter([0.2], [1, -0.8], (T % 7 > 3.0).astype(float))
    return np.outer(on * np.sin(2 * np.pi * frequency * T), [3, 3, 3, 0.2, 0.2, 0.2])


BODIES = {
    "knocks that ring": knocks(12),
    "knocks of a single sample": knocks(1),
    "set down hard": np.outer(T // 9.97 % 2, [5, 5, 5, 0, 0, 0]),
    **{f"vibration of {f} Hz": vibration(f) for f in (31.0, 50.3)},
    "noise with tails": np.random.default_rng(3).laplace(size=(7000, 6))
    * [*[0.06] * 3, *[3e-3] * 3],
}


@pytest.mark.parametrize("body", BODIES)
def test_what_a_body_makes_is_no_spike(run, body):
    log = rest()
    log[ALL] += BODIES[body]
    assert run(log, kind="static").quality["spiked"] == 0


@pytest.mark.parametrize(("log", "sigmas"), [(rest, 60), (poses, 1000)])
def test_single_values_far_off_are_dropped_and_no_other(run, log, sigmas):
    log, rng = log(), np.random.default_rng(4)
    # the larger of two near to each other must not hide the smaller
    rows = [*range(100, len(log) - 100, 199), 5003, 5007]
    for row in rows:
        name = CHANNELS[rng.integers(6)]
        log.loc[row, name] += sigmas * (0.02 if name[0] == "a" else 0.002) * rng.choice([-1, 1])
    kept = run(log).samples[[*CHANNELS]]
    np.testing.assert_array_equal(kept, log.drop(index=rows)[[*CHANNELS]])


@pytest.mark.parametrize(("end", "rate"), [(True, None), (False, 100)])
def test_packets_are_spread_where_samples_are_lost_or_the_sensor_pauses(run, end, rate):
    log = later(in_packets(poses(), 4, 0.3, 1e-4, end), (4000, 3.0))
    kept = log[np.random.default_rng(1).random(len(log)) > 0.01]
    done = run(kept, rate=rate)
    quality = done.quality
    assert quality["reasons"] == [] and quality["duplicates"] == quality["out_of_order"] == 0
    assert quality["rows"] == len(kept)
    true = (kept.index.to_numpy() + 300 * (kept.index >= 4000)) / 100
    # a packet that lost a row is off by a step
    away = np.abs(done.samples.t - (true - true[0]))
    assert np.quantile(away, 0.97) < 0.002 and away.max() < 0.05


def test_every_row_is_counted_once(run, log):
    log["t"] = np.random.default_rng(1).permutation(log.t)
    log.loc[::7, "ax"] = np.nan
    log.loc[::5, "t"] = np.nan
    quality = run(log, time_range=[0, 3]).quality
    parts = "rows outside_time_range non_finite duplicates out_of_order".split()
    assert sum(quality[part] for part in parts) == quality["rows_read"] == 500
    assert quality["status"] == "rejected"
