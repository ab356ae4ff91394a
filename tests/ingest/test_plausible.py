"""What is declared wrongly and shown by gravity, and honest logs, of which nothing is said."""

import numpy as np
import pandas as pd
import pytest

from bench.realistic.device import record
from imuloop.core.units import DEGREE
from imuloop.ingest.axes import Axes
from imuloop.simulate.truth import Disturbance, Vibration, example_truth, read_truth
from ingest import logs
from ingest.harm import in_bursts, turned
from ingest.injections import GOOD
from ingest.logs import ALL, FORCE, RATE, brief, increments, simulated, swinging
from seeds import seeds

SENSORS = ("acceleration", "angular_rate")
COUNTS = dict.fromkeys(SENSORS, "count")


@pytest.fixture
def taken(run):
    return lambda log, **declared: run(log, **declared).quality


# --- sound logs, and sessions of another kind than declared


@seeds(1, 2)
def test_healthy_logs_have_no_line(repository, taken, seeds):
    replica = read_truth(repository / "data/replicas/iphone_6.yaml")
    shaken = {"vibration": Vibration(0.5, (0.05, 0.8), (12, 45)), "turns_about_vertical": 8}
    moved = (Disturbance("knock", 50, 4.0), Disturbance("tilt", 120, 2.0))
    for truth in (example_truth(), replica):
        for seed in range(900, 900 + seeds):
            for kind, changed in (
                ("multi_position", {"poses": 12}),
                ("multi_position", {"poses": 12, **shaken}),
                ("six_position", {}),
                ("static", {"duration_s": 300.0, "disturbances": moved}),
            ):
                found = taken(simulated(kind, seed, truth, **changed), kind=kind)
                assert (found["reasons"], found["warnings"]) == ([], [])


@seeds(1, 3)
def test_a_bias_that_drifts_with_temperature_is_no_motion(taken, seeds):
    for seed in range(seeds):
        found = taken(logs.drifting_with_temperature(seed), kind="static")
        assert (found["reasons"], found["warnings"]) == ([], [])


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (lambda: simulated("multi_position", 1, poses=9), "in 10 attitudes; a static session lies"),
        (logs.flight, "turns to and fro, as in flight"),
        (lambda: logs.tilting(30.0), "gravity turns by up to "),
    ],
    ids=["poses", "flight", "tilt"],
)
def test_what_moves_is_not_static(taken, log, said):
    assert said in taken(log(), kind="static")["reasons"][0]
    # the same log as what it is
    assert taken(log(), kind="multi_position")["reasons"] == []


def test_a_turn_that_begins_and_ends_at_once_is_no_integer_that_wraps_around(taken):
    found = taken(logs.turning_at_once())
    assert found["status"] == "ok" and not any("wraps" in line for line in found["warnings"])


# --- counts and increments that are not declared


@pytest.mark.parametrize("session", ["static", "multi_position"])
@pytest.mark.parametrize("unit", ["m/s^2", "g"])
def test_counts_that_are_not_declared_are_named(taken, session, unit):
    log = simulated(session, **({"duration_s": 60.0} if session == "static" else {"poses": 6}))
    scales = [9.80665 / 16384] * 3 + [DEGREE / 131] * 3
    log[ALL] = (log[ALL] / scales).round()
    found = taken(log, kind=session, units={"acceleration": unit})
    assert found["status"] == "rejected"
    assert any("look like counts; declare units.acceleration: count" in r for r in found["reasons"])
    nominal = {name: {"scale": scale} for name, scale in zip(SENSORS, scales[2:4], strict=True)}
    assert taken(log, kind=session, units=COUNTS, nominal=nominal)["status"] == "ok"


@pytest.mark.parametrize(
    ("kind", "rate"),
    [
        ("rests", 50.0),
        ("swings", 200.0),
        pytest.param("rests", 200.0, marks=pytest.mark.study),
        pytest.param("swings", 50.0, marks=pytest.mark.study),
    ],
)
@pytest.mark.parametrize(
    ("units", "force", "turn", "declare"),
    [
        (("m/s^2", "rad/s"), 1, 1, ("m/s", "rad")),
        (("m/s^2", "rad/s"), 1, 1 / DEGREE, ("m/s", "deg")),
        (("m/s^2", "rad/s"), 1e3, 1e3, ("mm/s", "mrad")),
        (("g", "deg/s"), 1, 1, ("m/s", "rad")),
    ],
)
def test_increments_that_are_not_declared_are_named(taken, kind, rate, units, force, turn, declare):
    """Protects the cause of both sensors being off by the step, at any rate and without rests.

    Such a log passed, with a scale of 1/step in its calibration. As declared by the line it is ok.
    """
    truth = example_truth(rate=rate)
    log = swinging(rate) if kind == "swings" else simulated("multi_position", 7, truth, poses=9)
    log = increments(log, rate, force, turn)
    found = taken(log, units=dict(zip(SENSORS, units, strict=True)))
    assert found["status"] == "rejected" and found["misdeclared"]
    [reason] = found["reasons"]
    assert f"off by the step of {1 / rate:.4g} s, so the log looks like increments of" in reason
    end = f"declare units.acceleration: {declare[0]} and units.angular_rate: {declare[1]}"
    assert reason.endswith(end) and "\n" not in reason
    assert taken(log, units=dict(zip(SENSORS, declare, strict=True)))["reasons"] == []


@pytest.mark.parametrize("rate", [50.0, 400.0])
def test_increments_at_rest_in_one_attitude_are_named(taken, rate):
    """Protects a static log of increments: nothing but gravity and noise shows them."""
    log = simulated("static", 5, example_truth(rate=rate), duration_s=60.0)
    summed = increments(log, rate)
    [reason] = taken(summed, kind="static")["reasons"]
    assert f"rad/s/√Hz: gravity is off by the step of {1 / rate:.4g} s" in reason
    assert reason.endswith("declare units.acceleration: m/s; see units.angular_rate too")
    units = dict(zip(SENSORS, ("m/s", "rad"), strict=True))
    assert taken(summed, kind="static", units=units)["reasons"] == []
    # gravity that was taken out leaves as much by chance; or other values of as little noise
    taken_out = log.assign(**(log[FORCE] + [0, 0, 9.80665 / rate] - log[FORCE].mean()))
    for other in (taken_out, summed.assign(**0.9 * summed[FORCE])):
        found = taken(other, kind="static")
        assert found["reasons"] == [] and "has gravity been taken out" in str(found["warnings"])


def test_increments_in_counts_and_without_turns_are_named(taken):
    """Protects the two logs of increments in which a sensor says less: by its scale, or nothing."""
    log = simulated("multi_position", 7, example_truth(rate=125.0), poses=9)
    log = increments(log, 125.0)
    counts = log.assign(**(log[FORCE] / 1e-7).round(), **(log[RATE] / 1e-9).round())
    nominal = {"acceleration": {"scale": 1e-7}, "angular_rate": {"scale": 1e-9}}
    [reason] = taken(counts, units=COUNTS, nominal=nominal)["reasons"]
    declare = "nominal.acceleration.scale: 1.25e-05 and nominal.angular_rate.scale: 1.25e-07"
    assert reason.endswith(declare)
    # a gyroscope of which nothing is known but its noise
    log[RATE] = 1e-5 * np.random.default_rng(1).normal(size=(len(log), 3))
    [reason] = taken(log)["reasons"]
    assert "attitudes: gravity is off by the step of 0.008 s" in reason
    assert reason.endswith("declare units.acceleration: m/s; see units.angular_rate too")


def test_units_that_are_off_by_the_step_by_chance_are_no_increments(taken):
    """Protects logs of rates: at 1 kHz, g and deg/s look the same."""
    log = simulated("multi_position", 5, example_truth(rate=1000.0), poses=5)
    found = taken(log, units={"acceleration": "g", "angular_rate": "deg/s"})
    assert "taken as g, it looks like m/s^2" in found["reasons"][0]
    assert "taken as deg/s, it looks like rad/s" in found["reasons"][1]


# --- axes of the two sensors that do not fit


def mapping(log, rate=100):
    axes = Axes(rate)
    axes.add({name: log[name].to_numpy() for name in ALL})
    return axes.fit()["mapping"]


@pytest.mark.parametrize(
    ("kind", "plan"),
    [("multi_position", {"poses": 10, "initial_rest_s": 10.0}), ("six_position", {"repeats": 2})],
)
@pytest.mark.parametrize("swapped", [False, True])
def test_bias_scale_lost_rows_and_a_narrow_range_hide_no_swapped_axes(kind, plan, swapped):
    for seed in range(2):
        rng, log = np.random.default_rng(seed), simulated(kind, seed, **plan)
        # 0.3 rad/s of bias, misalignments of 5 degrees, scale errors of 10 %
        mixing = (np.eye(3) + 0.08 * rng.normal(size=(3, 3))) * rng.uniform(0.9, 1.1, 3)
        rates = log[RATE].to_numpy() @ mixing + rng.uniform(-0.3, 0.3, 3)
        limit = 0.6 * np.abs(rates).max()
        log[RATE] = np.clip(rates, -limit, limit)
        if swapped:
            log = turned(GOOD, (1, -3, 2))(log)
        kept = rng.random(len(log)) > 0.03
        kept[2000:2150] = False
        assert mapping(log[kept]) == ([1, 3, -2] if swapped else None)


def test_turns_about_one_axis_tell_that_axis_alone(taken):
    t = np.arange(6000) / 100
    angle = 1.2 * np.sin(2 * np.pi * t / 6) * (t > 6)
    log = brief(6000).assign(ay=9.8 * np.sin(angle), az=9.8 * np.cos(angle), ax=0.0)
    log[RATE] = np.column_stack([np.gradient(angle, t), 0 * t, 0 * t])
    log[ALL] += np.random.default_rng(1).normal(size=(6000, 6)) * 0.02
    # what is never turned may be swapped or not: nobody can tell
    for other in (log, log.assign(gy=log.gz, gz=-log.gy)):
        assert taken(other)["warnings"] == []
    [line] = taken(log.assign(gx=log.gy, gy=-log.gx))["warnings"]
    assert "with x as -gy: swapped or mirrored axes (the turns of this log leave" in line


# --- clocks of a host


def test_the_rate_of_bursts_is_that_of_the_sensor(run):
    log = in_bursts(spacing=1e-4, rate=204.8)(brief(50_000))
    # a stall of the host, and no row lost
    log.loc[20_000:20_400, "t"] = log.t[20_400] + 1e-6 * np.arange(401)
    log.loc[20_401:, "t"] += 4e-4
    found = run(log, rate=205).quality
    assert found["clock"]["rebuilt"]
    assert found["rate_hz"] == pytest.approx(204.8, rel=5e-6)


def held_back(rows):
    """A log whose transfers come after random pauses of some tenths of a second, on no line."""
    rng, log = np.random.default_rng(8), brief(rows)
    first = np.cumsum(np.r_[0, rng.integers(2, 60, rows)])
    number = np.searchsorted(first, np.arange(rows), side="right") - 1
    sent = np.cumsum(rng.exponential(0.31, rows))
    log["t"] = sent[number] + 0.002 * (np.arange(rows) - first[number])
    return log.sort_values("t", ignore_index=True)


def test_bursts_that_cannot_be_rebuilt_are_reported_with_what_to_declare(run):
    found = run(held_back(20_000)).quality
    mean = found["duration_s"] / (found["rows"] - 1)
    assert not found["clock"]["rebuilt"] and found["status"] == "ok"
    [line] = [line for line in found["warnings"] if "bursts" in line]
    assert "columns.time: null" in line and f"about rate: {1 / mean:.4g}" in line
    # of a thousand and more nothing is left to work on
    many = held_back(60_000)
    found = run(many).quality
    assert found["gaps"]["count"] > 1000
    assert (found["status"], found["misdeclared"]) == ("rejected", True)
    assert "columns.time: null" in found["reasons"][0]
    # and what is declared then is taken
    rate = float(found["reasons"][0].split("about rate: ")[1])
    found = run(many, columns={"time": None}, rate=rate).quality
    assert (found["status"], found["gaps"]["count"]) == ("ok", 0)
    assert found["clock"]["drift_ppm"] is None


# what a slow turn does at its ends is no bias
@pytest.mark.parametrize("case", ["clean", "slow_turns", "lossy"])
@pytest.mark.parametrize("seed", [14, 46])
def test_turns_go_as_far_as_the_scale_factor_says(taken, seed, case):
    made = record(seed, case)
    ratio = taken(pd.DataFrame(made.columns))["faults"]["rests"]["turn_ratio"]
    assert abs(ratio["value"] * made.gyroscope.K.mean() - 1) < 0.02


@pytest.mark.parametrize(
    ("samples", "held", "clipped"), [(5, 1, True), (1, 1, False), (5, 3, False)]
)
def test_a_flat_top_of_a_few_samples_is_clipping(run, samples, held, clipped):
    """Protects turns that saturate briefly; values that are held have flat tops everywhere."""
    log = logs.poses()
    log["gx"] = log["gx"].clip(upper=log["gx"].nlargest(samples).iloc[-1])
    log[ALL] = log[ALL].to_numpy()[np.arange(len(log)) // held * held]
    found = run(log).quality["faults"]["clipped_at"]["gx"]
    assert (found["rows"] == samples and len(found["values"]) == 1) == clipped
