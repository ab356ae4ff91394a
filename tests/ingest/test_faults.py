"""Faults put into logs of a known good device: each found and named, and none in good logs."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, lfilter

from calibrate.devices import planned
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TEMPERATURE
from imuloop.core.units import DEGREE
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth

KINDS = ("static", "multi_position")
# least significant bits as of a common part: noise of 3 and of 1.5 of them
STEPS = {**dict.fromkeys(ACCELERATION, 0.0048), **dict.fromkeys(ANGULAR_RATE, 0.00106)}


def good_log(kind, seed=5):
    """Seventy seconds at rest, or eight poses; in steps, with a thermometer that warms up."""
    changed = {"static": {"duration_s": 70.0}, "multi_position": {"poses": 8}}[kind]
    log = simulate_session(planned(example_truth(), kind, **changed), kind, seed)
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


# a fault, and the text of its line, where it differs by kind. The samples that the converter drops
# are no part of this list: each fault leaves its rows alone
NEVER = {"static": "never changing: gx, gy, gz", "multi_position": "no noise at rest: gx, gy, gz;"}
COARSE = {"static": "never changing: gy", "multi_position": "no noise at rest: gy;"}
TOO_SMALL = {"static": "has gravity been taken out", "multi_position": "gravity is in it, in 9 "}
ALL_ZERO = "zero on all axes: acceleration in 200 rows, angular_rate in 200"
ALL_SPIKES = "spikes of a single sample: ax 3, ay 3, az 3, gx 3, gy 3, gz 3;"
KEPT = [
    (
        put((0.4, 200), CHANNELS, 0.0),
        "zero on all axes: acceleration in 200 rows, angular_rate in 2",
    ),
    (put((0.3, 1), CHANNELS, 0.0), "zero on all axes: acceleration in 1 row,"),
    (put((0.6, 30), ACCELERATION, 0.0), "zero on all axes: acceleration in 30 rows;"),
    (put((0.6, 300), ANGULAR_RATE, 0.0), "zero on all axes: angular_rate in 300 rows;"),
    (put((0.3, 500), ["ay"], None), "stuck at one value: ay 500 samples, 1 time,"),
    (put((0.3, 120), ["gz"], 0.0), "stuck at one value: gz 1"),
    (put((0.5, 400), ACCELERATION, None), "az 40"),
    (put((0.7,), ANGULAR_RATE, None), "stuck at one value: gx"),
    (spike(-300.0, *CHANNELS), ALL_SPIKES),
    (clip("ax", 0.93), "clipped at a repeated extreme value: ax "),
    (clip("gy", 0.05), "clipped at a repeated extreme value: gy "),
    (held(CHANNELS, 2), "held: acceleration for 2 rows (50 Hz"),
    (held(ANGULAR_RATE, 4), "a value is held: angular_rate for 4 rows"),
    (held(ACCELERATION, 2.5), "a value is held: acceleration for 2.5 rows"),
    (copied("ax", "ay"), "ay is a copy of ax: see columns"),
    (copied("ax", "gx"), "gx is a copy of ax: see columns"),
    (deadened(ANGULAR_RATE, 0.04), NEVER),
    (coarse("gy", 0.02), COARSE),
    (tracked(0.3, 0.015), "the angular rate at rest has no mean: its means"),
    (put((0,), ["gx"], 0.25), "never changing: gx"),
    (scaled([TEMPERATURE], 340, -12420), "counts, or failed reads"),
    (scaled([TEMPERATURE], 1, 273.15), "it looks like K"),
    (put((0,), [TEMPERATURE], 21.0), "temperature is 21 degC throughout"),
    (scaled(ACCELERATION, 0.01), TOO_SMALL),
    (scaled(ANGULAR_RATE, 1e4), "too much for a turn by hand"),
    (scaled(["t"], 1e3), "0.1 Hz is unusual for an IMU: see units.time"),
    (moved(0.5, 0.7), "1 gap, 0.71 s together"),
]


def counts(scale):
    return {"units": {"angular_rate": "count"}, "nominal": {"angular_rate": {"scale": scale}}}


# shown by turns alone; at rest, a bias in the wrong unit is as good as another. A fault, what is
# declared, and the reason
DEG_S, FULL_SCALE = {"units": {"angular_rate": "deg/s"}}, "full scale was {} the one that {} is for"
TURNS_ALONE = [
    (scaled(CHANNELS, 1.0), DEG_S, "taken as deg/s, it looks like rad/s"),
    (scaled(ANGULAR_RATE, 1 / DEGREE), {}, "taken as rad/s, it looks like deg/s"),
    (scaled(ANGULAR_RATE, 2), {}, FULL_SCALE.format("1/2 of", "the logger's scale")),
    (scaled(ANGULAR_RATE, 1 / 4), {}, FULL_SCALE.format("4 times", "the logger's scale")),
    (scaled(["t"], 2), {}, "or the log's rate is off by as much"),
    (
        *(scaled(ANGULAR_RATE, 1e3), counts(2e-3)),
        FULL_SCALE.format("1/2 of", "nominal.angular_rate.scale"),
    ),
    (
        *(scaled(ANGULAR_RATE, 1e3), counts(1e-3 / DEGREE)),
        "nominal.angular_rate.scale is in rad/s per count, and looks like deg/s",
    ),
]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("change", "text"), KEPT)
def test_a_fault_is_named_and_its_samples_kept(logs, run, kind, change, text):
    log = logs[kind].copy()
    change(log)
    samples, found, *_ = run(log, kind=kind)
    text = text[kind] if isinstance(text, dict) else text
    # nothing is read into one fault but itself
    assert len(found["warnings"]) == 1 and text in found["warnings"][0], found["warnings"]
    np.testing.assert_array_equal(samples[[*CHANNELS, TEMPERATURE]], log[[*CHANNELS, TEMPERATURE]])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (put((0,), ACCELERATION, 0.5), "the acceleration never changes"),
        (scaled(["t"], 1e6), "the stamps look like us; see units.time"),
    ],
)
def test_a_fault_that_leaves_nothing_of_the_log(logs, run, change, text):
    log = logs["static"].copy()
    change(log)
    found = run(log, kind="static").quality
    assert text in found["reasons"][0]
    # nor are there lines of what follows from it
    assert len(found["reasons"]) == 1


@pytest.mark.parametrize(("change", "declared", "text"), TURNS_ALONE)
def test_a_fault_that_turns_alone_show(logs, run, change, declared, text):
    log = logs["multi_position"].copy()
    change(log)
    found = run(log, **declared).quality
    assert found["status"] == "rejected"
    assert len(found["reasons"]) == 1 and text in found["reasons"][0]


def test_an_end_of_the_range_that_axes_reach_for_a_few_samples_each_is_found(logs, run):
    # too few on any axis alone: fast turns reach the end of a range at their peaks only
    log, limit = logs["multi_position"].copy(), 5.0
    reached = {}
    for name, share in zip(ANGULAR_RATE, (1, -1, 1), strict=True):
        rows = log[name].mul(share).nlargest(9).index
        log[name] = log[name].clip(-0.99 * limit, 0.99 * limit)
        log.loc[rows, name], reached[name] = share * limit, share * limit
    found = run(log).quality
    clipped = found["faults"]["clipped_at"]
    assert {n: f["values"] for n, f in clipped.items() if f["rows"]} == {
        name: [value] for name, value in reached.items()
    }
    ends = {n: [None, v] if v > 0 else [v, None] for n, v in reached.items()}
    assert found["rails"] == ends == run(log).metadata["rails"]


def test_the_declared_full_scale_is_an_end_of_the_range(logs, run):
    log = logs["multi_position"].copy()
    most = log["gy"].abs().max()
    found = run(log, full_scale={"angular_rate": most / 0.99}).quality
    assert found["rails"]["gy"] == pytest.approx([-0.98 / 0.99 * most, 0.98 / 0.99 * most])
    assert not {"ax", "ay", "az"} & set(found["rails"])


@pytest.mark.parametrize(("factor", "lines"), [(1.14, 1), (1.08, 0)])
def test_a_rate_that_is_somewhat_too_large(logs, run, factor, lines):
    log = logs["multi_position"].copy()
    log[list(ANGULAR_RATE)] *= factor
    found = run(log).quality
    assert (found["status"], len(found["warnings"])) == ("ok", lines)
    said = "times as far as gravity turns in its axes, over 8 moves"
    assert all(said in line for line in found["warnings"])


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_log_has_none(run, kind):
    assert run(good_log(kind, 11), kind=kind).quality["warnings"] == []


def test_of_a_log_that_never_rests_nothing_is_told_about_its_noise(run):
    # a gait: all power is below 10 Hz, and the mean of a second is less than that of its parts
    rng = np.random.default_rng(12)
    gait, n = butter(2, 0.1), 30_000
    log = pd.DataFrame({"t": np.arange(n) / 100})
    swing = 1.5 + np.sin(np.arange(n) / 900)
    for name in CHANNELS:
        moved = np.diff(lfilter(*gait, rng.normal(size=n + 1))) * (50 if name[0] == "a" else 10)
        log[name] = swing * moved + 1e-3 * rng.normal(size=n) + 9.8 * (name == "az")
    found = run(log).quality
    assert found["faults"]["rests"]["share"] < 0.1
    assert found["faults"]["mean_at_rest"] is None
    assert not any("at rest" in w for w in found["warnings"])


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
