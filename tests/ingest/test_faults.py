"""Faults put into logs of a known good device: each found and named, and none in good logs."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, lfilter

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TEMPERATURE
from imuloop.core.units import DEGREE
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth

KINDS = ("static", "multi_position")
# least significant bits as of a common part: noise of 3 and of 1.5 of them
STEPS = {**dict.fromkeys(ACCELERATION, 0.0048), **dict.fromkeys(ANGULAR_RATE, 0.00106)}


def good_log(kind, seed=5):
    """Seventy seconds at rest, or eight poses; in steps, with a thermometer that warms up."""
    truth = example_truth()
    changed = {"static": {"duration_s": 70.0}, "multi_position": {"poses": 8}}[kind]
    sessions = {kind: replace(truth.sessions[kind], **changed)}
    log = simulate_session(replace(truth, sessions=sessions), kind, seed)
    for name, step in STEPS.items():
        log[name] = np.round(log[name] / step) * step
    noise = np.random.default_rng(seed).normal(size=len(log))
    log[TEMPERATURE] = np.round(25 + 5 * log.t / log.t.iloc[-1] + 0.02 * noise, 2)
    return log


@pytest.fixture(scope="module")
def logs():
    return {kind: good_log(kind) for kind in KINDS}


def fault(function):
    """A change of a log that is made of its parameters."""
    return lambda *given: lambda log: function(log, *given)


def at(log, first, last=None):
    """Rows by share of the log, or a count of rows after the first."""
    start = int(first * len(log))
    return slice(start, start + last - 1 if last else None)


@fault
def put(log, rows, names, value):
    """A fault: columns set to a value, or to what they were at the first row."""

    where = at(log, *rows)
    for name in names:
        log.loc[where, name] = log[name].iloc[where.start] if value is None else value


@fault
def spike(log, size, *names):
    for share in (0.2, 0.5, 0.8):
        # the quietest place nearby
        spread = log[names[0]].rolling(17, center=True).std()
        near = spread.iloc[int(share * len(log)) : int(share * len(log)) + 500]
        for name in names:
            log.loc[near.idxmin(), name] += size


@fault
def clip(log, name, share):
    limit = np.sort(log[name].to_numpy())[int(share * len(log))]
    log[name] = log[name].clip(upper=limit) if share > 0.5 else log[name].clip(lower=limit)


@fault
def held(log, names, n):
    where = np.floor(np.floor(np.arange(len(log)) / n) * n).astype(int)
    for name in names:
        log[name] = log[name].to_numpy()[where]


@fault
def passed(log, names, b, a=1.0):
    for name in names:
        first = log[name].iloc[0]
        log[name] = lfilter(b, a, log[name] - first) + first


@fault
def stretched(log, names, n):
    where = np.arange(len(log))
    for name in names:
        log[name] = np.interp(where, where[::n], log[name][::n])


@fault
def scaled(log, names, factor, offset=0.0):
    log[list(names)] = log[list(names)] * factor + offset


@fault
def moved(log, first, seconds):
    log.loc[at(log, first), "t"] += seconds


@fault
def deadened(log, names, width):
    for name in names:
        log[name] = np.where(np.abs(log[name]) < width, 0.0, log[name])


@fault
def tracked(log, tau, still):
    """Firmware that follows the mean of each rate with a time constant, s, while it is still."""

    spread = sum(log[name].rolling(25, min_periods=1).std() for name in ANGULAR_RATE)
    resting = (spread < still).to_numpy()
    raw = log[list(ANGULAR_RATE)].to_numpy()
    out, mean = raw.copy(), np.zeros(3)
    for i in range(len(log)):
        if resting[i]:
            mean += 0.01 / tau * (raw[i] - mean)
        out[i] -= mean
    log[list(ANGULAR_RATE)] = out


@fault
def coarse(log, name, step):
    log[name] = np.round(log[name] / step) * step


@fault
def copied(log, one, other):
    log[other] = log[one]


DEAD_BAND = {
    "static": "never changing: gx, gy, gz",
    "multi_position": "no noise at rest: gx, gy, gz;",
}
# the samples that the converter drops are no part of this list: each fault leaves its rows alone
KEPT = {
    "zeros amid the log": (
        put((0.4, 200), CHANNELS, 0.0),
        "zero on all axes: acceleration in 200 rows, angular_rate in 200",
    ),
    "one row of zeros": (put((0.3, 1), CHANNELS, 0.0), "zero on all axes: acceleration in 1 row,"),
    "zeros of acceleration": (
        put((0.6, 30), ACCELERATION, 0.0),
        "zero on all axes: acceleration in 30 rows;",
    ),
    "zeros of the gyroscope": (
        put((0.6, 300), ANGULAR_RATE, 0.0),
        "zero on all axes: angular_rate in 300 rows;",
    ),
    "an axis stuck": (put((0.3, 500), ["ay"], None), "stuck at one value: ay 500 samples, 1 time,"),
    "an axis stuck at zero": (put((0.3, 120), ["gz"], 0.0), "stuck at one value: gz 1"),
    "a sensor stuck": (put((0.5, 400), ACCELERATION, None), "az 40"),
    "a gyroscope stuck to the end": (put((0.7,), ANGULAR_RATE, None), "stuck at one value: gx"),
    "spikes": (spike(3.0, "gz"), "spikes of a single sample: gz 3;"),
    "spikes of all axes": (
        spike(-300.0, *CHANNELS),
        "spikes of a single sample: ax 3, ay 3, az 3, gx 3, gy 3, gz 3;",
    ),
    "clipped above": (clip("ax", 0.93), "clipped at a repeated extreme value: ax "),
    "clipped below": (clip("gy", 0.05), "clipped at a repeated extreme value: gy "),
    "every sample twice": (held(CHANNELS, 2), "held: acceleration for 2 rows (50 Hz"),
    "a gyroscope held": (held(ANGULAR_RATE, 4), "a value is held: angular_rate for 4 rows"),
    "40 Hz in 100 Hz": (held(ACCELERATION, 2.5), "a value is held: acceleration for 2.5 rows"),
    "a low pass": (passed(CHANNELS, *butter(2, 0.1)), "power is lacking above 37.5 Hz"),
    "drawn out from 25 Hz": (stretched(["gx", "gy"], 4), "power is lacking above 37.5 Hz"),
    "a copy": (copied("ax", "ay"), "ay is a copy of ax: see columns"),
    "a copy of another sensor": (copied("ax", "gx"), "gx is a copy of ax: see columns"),
    "a dead band": (deadened(ANGULAR_RATE, 0.04), DEAD_BAND),
    "a step too coarse": (
        coarse("gy", 0.02),
        {"static": "never changing: gy", "multi_position": "no noise at rest: gy;"},
    ),
    "bias tracked at rest": (
        tracked(0.3, 0.015),
        "the angular rate at rest has no mean: its means",
    ),
    "a dead axis": (put((0,), ["gx"], 0.25), "never changing: gx"),
    "temperature in counts": (scaled([TEMPERATURE], 340, -12420), "counts, or failed reads"),
    "temperature in K": (scaled([TEMPERATURE], 1, 273.15), "it looks like K"),
    "temperature dead": (put((0,), [TEMPERATURE], 21.0), "temperature is 21 degC throughout"),
    "gravity taken out": (scaled(ACCELERATION, 0.01), "has gravity been taken out"),
    "rate in counts": (scaled(ANGULAR_RATE, 1e4), "too much for a turn by hand"),
    "stamps in ms": (scaled(["t"], 1e3), "0.1 Hz is unusual for an IMU: see units.time"),
    "a gap": (moved(0.5, 0.7), "1 gaps, 0.71 s together"),
}
# fault, and a text in the reasons
REJECTED = {
    "not read": (put((0,), ACCELERATION, 0.5), "the acceleration never changes"),
    "stamps in us": (scaled(["t"], 1e6), "a million times smaller"),
}
# shown by turns alone; at rest, a bias in the wrong unit is as good as another. What is declared,
# the status, and the text in reasons or warnings
TURNS_ALONE = {
    "deg/s that are rad/s": (
        *(scaled(CHANNELS, 1.0), {"units": {"angular_rate": "deg/s"}}),
        *("rejected", "taken as deg/s, it looks like rad/s"),
    ),
    "rad/s that are deg/s": (
        *(scaled(ANGULAR_RATE, 1 / DEGREE), {}),
        *("rejected", "taken as rad/s, it looks like deg/s"),
    ),
    "twice the rate": (
        *(scaled(ANGULAR_RATE, 2), {}),
        *("rejected", "full scale was 1/2 of the one that the logger's scale is for"),
    ),
    "a quarter of the rate": (
        *(scaled(ANGULAR_RATE, 1 / 4), {}),
        *("rejected", "full scale was 4 times the one that the logger's scale is for"),
    ),
    "a rate of stamps that is half": (
        *(scaled(["t"], 2), {}),
        *("rejected", "or the log's rate is off by as much"),
    ),
    "counts at the wrong full scale": (
        scaled(ANGULAR_RATE, 1e3),
        {"units": {"angular_rate": "count"}, "nominal": {"angular_rate": {"scale": 2e-3}}},
        *("rejected", "full scale was 1/2 of the one that nominal.angular_rate.scale is for"),
    ),
    "counts in deg/s": (
        scaled(ANGULAR_RATE, 1e3),
        {"units": {"angular_rate": "count"}, "nominal": {"angular_rate": {"scale": 1e-3 / DEGREE}}},
        *("rejected", "nominal.angular_rate.scale is in rad/s per count, and looks like deg/s"),
    ),
    "a rate that is 14 % too large": (
        *(scaled(ANGULAR_RATE, 1.14), {}),
        *("ok", "times as far as gravity turns in its axes, over 8 moves"),
    ),
    "a rate that is 8 % too large": (scaled(ANGULAR_RATE, 1.08), {}, "ok", None),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", KEPT)
def test_a_fault_is_named_and_its_samples_kept(logs, run, kind, name):
    change, text = KEPT[name]
    log = logs[kind].copy()
    change(log)
    samples, found, *_ = run(log, kind=kind)
    text = text[kind] if isinstance(text, dict) else text
    named = [line for line in found["warnings"] if text in line]
    assert len(named) == 1, found["warnings"]
    np.testing.assert_array_equal(samples[[*CHANNELS, TEMPERATURE]], log[[*CHANNELS, TEMPERATURE]])
    # nothing is read into one fault but itself
    assert len(found["warnings"]) == 1, found["warnings"]


@pytest.mark.parametrize("name", REJECTED)
def test_a_fault_that_leaves_nothing_of_the_log(logs, run, name):
    change, text = REJECTED[name]
    log = logs["static"].copy()
    change(log)
    assert text in run(log, kind="static").quality["reasons"][0]


@pytest.mark.parametrize("name", TURNS_ALONE)
def test_a_fault_that_turns_alone_show(logs, run, name):
    change, declared, status, text = TURNS_ALONE[name]
    log = logs["multi_position"].copy()
    change(log)
    found = run(log, **declared).quality
    assert found["status"] == status
    lines = found["reasons" if status == "rejected" else "warnings"]
    assert len(lines) == (text is not None) and (text or "") in "".join(lines), found


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_log_has_none(run, kind):
    assert run(good_log(kind, 11), kind=kind).quality["warnings"] == []


def test_noise_far_below_the_step_is_not_stuck(run):
    # two levels near the edge of a step, one between: runs of thousands of samples are its nature
    rng = np.random.default_rng(4)
    log = pd.DataFrame({"t": np.arange(30_000) / 100})
    drift = 0.4 * np.sin(np.arange(30_000) / 3000)
    for i, name in enumerate(CHANNELS):
        mean = 9.8 if name == "az" else 0.3 * i
        log[name] = np.round((mean + drift) / 0.15 + 0.1 * rng.normal(size=30_000)) * 0.15
    found = run(log, kind="static").quality["faults"]
    assert not any(f["stretches"] for f in found["stuck"].values())
    assert not any(f["rows"] for f in found["clipped_at"].values())
    assert found["rows_a_value"] == {"acceleration": 1, "angular_rate": 1}
    assert found["copies"] == []
    assert found["silent_at_rest"] == []
