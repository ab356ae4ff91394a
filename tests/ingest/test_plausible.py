"""What is declared wrongly and shown by gravity, and the honest logs that nothing is said of."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, lfilter
from scipy.spatial.transform import Rotation

from calibrate.devices import planned
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.units import DEGREE
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import Disturbance, Vibration, example_truth, read_truth
from seeds import seeds

COUNTS = {"acceleration": "count", "angular_rate": "count"}
XSENS = {
    "kind": "multi_position",
    "units": COUNTS,
    "nominal": {
        "acceleration": {"scale": 0.00240964, "offset": 32768},
        "angular_rate": {"scale": 0.000209732, "offset": 32768},
    },
}
MPU9150 = {
    "kind": "multi_position",
    "columns": {"acceleration": [0, 1, 2], "angular_rate": [3, 4, 5]},
    "rate": 100,
}
ADIS16405 = {"kind": "static", "units": {"acceleration": "g", "angular_rate": "deg/s"}, "rate": 100}


def array(chip):
    columns = {"time": "t_us", "acceleration": [f"a{x}{chip}" for x in "xyz"]}
    columns["angular_rate"] = [f"g{x}{chip}" for x in "xyz"]
    nominal = {"acceleration": {"scale": 0.0047884}, "angular_rate": {"scale": 0.001064225}}
    units = {"time": "us", **COUNTS}
    return {"kind": "multi_position", "columns": columns, "units": units, "nominal": nominal}


@pytest.fixture
def taken(run):
    return lambda *log, **declared: run(*log, **declared).quality


def simulated(session, seed=5, truth=None, **changed):
    return simulate_session(planned(truth or example_truth(), session, **changed), session, seed)


@pytest.mark.parametrize(
    ("i", "chips"), [(1, 2), *(pytest.param(i, 8, marks=pytest.mark.study) for i in (1, 5))]
)
def test_measured_turns_agree_with_gravity(recordings, taken, i, chips):
    for chip in range(1, chips + 1):
        found = taken(recordings(f"exp_{i}.parquet"), **array(chip))
        ratio = found["faults"]["rests"]["turn_ratio"]
        assert found["status"] == "ok"
        assert ratio["value"] == pytest.approx(1, abs=0.02)
        assert ratio["moves"] >= 19
        # over rests, so none is reported of the shaking that follows
        assert not any("specific force" in line for line in found["warnings"])


@seeds(1, 2)
def test_healthy_logs_have_no_line(repository, taken, seeds):
    replica = read_truth(repository / "data/replicas/iphone_6.yaml")
    shaken = {"vibration": Vibration(0.5, (0.05, 0.8), (12, 45)), "turns_about_vertical": 8}
    moved = (Disturbance("knock", 50, 4.0), Disturbance("tilt", 120, 2.0))
    for truth in (example_truth(), replica):
        for seed in range(seeds):
            for session, kind, changed in (
                ("multi_position", "multi_position", {"poses": 12}),
                ("multi_position", "multi_position", {"poses": 12, **shaken}),
                ("six_position", "six_position", {}),
                ("static", "static", {"duration_s": 300.0, "disturbances": moved}),
            ):
                found = taken(simulated(session, 900 + seed, truth, **changed), kind=kind)
                assert (found["reasons"], found["warnings"]) == ([], [])


def flight(seed, seconds=120, rate=200.0, tilt=4.0):
    """A drone in hover: thrust along z whatever its attitude, which sways by some degrees."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate)
    slow = lfilter(*butter(2, [0.1 / rate, 2 / rate], "band"), rng.normal(size=(n, 3)), axis=0)
    angle = slow / slow.std() * tilt * DEGREE
    log = pd.DataFrame({"t": np.arange(n) / rate})
    shake = lfilter(*butter(2, 0.3, "high"), rng.normal(size=(n, 6)), axis=0)
    log[list(ACCELERATION)] = [0, 0, 9.8] + 0.8 * shake[:, :3] + 0.2 * angle
    log[list(ANGULAR_RATE)] = np.gradient(angle, 1 / rate, axis=0) + 0.05 * shake[:, 3:]
    return log


def tilting(seed, degrees, seconds=1200.0, rate=20.0, over=600.0):
    """A device at rest on something that tilts slowly, with a fair gyroscope."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    start = (seconds - over) / 2
    angle = degrees * DEGREE * np.clip((t - start) / over, 0, 1)
    log = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, 0.0)})
    log["ay"], log["az"] = 9.8 * np.sin(angle), 9.8 * np.cos(angle)
    log["gx"] = np.gradient(angle, 1 / rate)
    log[list(CHANNELS)] += rng.normal(size=(len(t), 6)) * ([5e-3] * 3 + [1e-3] * 3)
    return log


@pytest.mark.parametrize("seed", [1])
def test_what_moves_is_not_static(taken, seed):
    found = taken(simulated("multi_position", seed, poses=9), kind="static")
    assert found["status"] == "rejected"
    assert "of the time, in 10 attitudes; a static session lies still" in found["reasons"][0]
    found = taken(flight(seed), kind="static")
    assert "turns to and fro, as in flight" in found["reasons"][0]
    found = taken(tilting(seed, 30.0), kind="static")
    assert "gravity turns by up to " in found["reasons"][0]
    # the same logs as what they are
    assert taken(flight(seed), kind="multi_position")["reasons"] == []


@pytest.mark.usefixtures("in_process")
def test_measured_motion_is_not_static(recordings, taken):
    found = taken(recordings("imu1.log"), **MPU9150 | {"kind": "static"})
    assert "in 22 attitudes" in found["reasons"][0]
    columns = {"acceleration": "imu_acc", "angular_rate": "imu_gyr"}
    for name in ("03_undisturbed_slow_rotation_C", "07_undisturbed_fast_rotation_B"):
        found = taken(recordings(f"{name}.mat"), kind="static", columns=columns, rate=285.714)
        assert "; a static session lies still" in found["reasons"][0]


@pytest.mark.parametrize("i", [1, pytest.param(2, marks=pytest.mark.study)])
def test_measured_rest_is_static(recordings, taken, i):
    found = taken(recordings(f"adis_16405_imu{i}.parquet"), **ADIS16405)
    assert (found["reasons"], found["warnings"]) == ([], [])
    assert found["faults"]["rests"]["share"] > 0.999


@seeds(1, 3)
def test_a_bias_that_drifts_with_temperature_is_no_motion(taken, seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        log = tilting(seed, 0.0)
        # 60 mg and 0.1 deg/s over a ramp, on axes at random
        course = np.sin(np.pi * np.linspace(0, 1, len(log)))[:, None]
        log[list(ACCELERATION)] += course * rng.normal(size=3) * 0.6
        log[list(ANGULAR_RATE)] += course * rng.normal(size=3) * 0.1 * DEGREE
        found = taken(log, kind="static")
        assert (found["reasons"], found["warnings"]) == ([], [])


@seeds(1, 2)
def test_a_level_that_changes_amid_the_log_is_reported(taken, seeds):
    for seed in range(seeds):
        log = simulated("static", seed, duration_s=300.0)
        half = slice(len(log) // 2, None)
        for factor, bias in ((0.5, 0.0), (1.0, 5.0)):
            other = log.copy()
            other.loc[half, list(ACCELERATION)] *= factor
            other.loc[half, "ax"] += bias
            found = taken(other, kind="static")
            assert found["status"] == "ok"
            line = found["warnings"][0]
            assert "scale or bias changed amid the log" in line
            at = float(line.split(" s ")[0].split()[-1])
            # to the next rest
            assert at == pytest.approx(log.t.iloc[half.start], abs=8.0)


def test_an_integer_that_wraps_around_is_named(recordings, taken, tmp_path):
    log = np.loadtxt(recordings("xsens_acc.mat"))
    per_count = XSENS["nominal"]["acceleration"]["scale"]
    wide = 7.0 / per_count
    wrapped = np.column_stack([log[:, 0], (log[:, 1:] - 32768 + wide) % (2 * wide) - wide + 32768])
    np.savetxt(tmp_path / "wrapped_acc.mat", wrapped, fmt="%.6f")
    found = taken(tmp_path / "wrapped_acc.mat", recordings("xsens_gyro.mat"), **XSENS)
    assert found["status"] == "rejected"
    [reason] = found["reasons"]
    assert "an integer that wraps around" in reason and "ax" in reason


def test_a_turn_that_begins_and_ends_at_once_is_no_integer_that_wraps_around(taken):
    rng, t = np.random.default_rng(5), np.arange(12000) / 200
    turning = np.stack([0 * t, 0 * t, np.where(t % 10 < 2, np.pi / 4, 0.0)], axis=1)
    at_rest = np.tile([0.05, 0.02, 9.81], (len(t), 1))
    noise = rng.normal(0, [[1e-2] * 3 + [1e-3] * 3], (len(t), 6))
    log = pd.DataFrame(np.hstack([at_rest, turning]) + noise, columns=CHANNELS)
    found = taken(log.assign(t=t))
    assert found["status"] == "ok" and not any("wraps around" in w for w in found["warnings"])


@pytest.mark.parametrize("offset", [0, 32768])
def test_a_few_samples_at_the_end_of_sixteen_bits_are_clipped(taken, offset):
    log = simulated("multi_position", 3, poses=6)
    nominal = {"angular_rate": {"scale": 1e-4, "offset": offset}}
    log[list(ANGULAR_RATE)] = (log[list(ANGULAR_RATE)] / 1e-4).round()
    fastest = log.gx.abs().nlargest(18).index
    log.loc[fastest, "gx"] = np.where(log.gx[fastest] > 0, 32767, -32768)
    log[list(ANGULAR_RATE)] += offset
    found = taken(log, units={"angular_rate": "count"}, nominal=nominal)
    [line] = found["warnings"]
    assert line.startswith("clipped at a repeated extreme value: gx 18 samples")
    # the same values in SI: known by the step
    log[list(ANGULAR_RATE)] = (log[list(ANGULAR_RATE)] - offset) * 1e-4
    assert "gx 18 samples" in taken(log)["warnings"][0]


@pytest.mark.parametrize("session", ["static", "multi_position"])
@pytest.mark.parametrize("unit", ["m/s^2", "g"])
def test_counts_that_are_not_declared_are_named(taken, session, unit):
    log = simulated(session, duration_s=60.0) if session == "static" else simulated(session)
    per_g, per_rate = 16384 / 9.80665, 131 / DEGREE
    log[list(ACCELERATION)] = (log[list(ACCELERATION)] * per_g).round()
    log[list(ANGULAR_RATE)] = (log[list(ANGULAR_RATE)] * per_rate).round()
    found = taken(log, kind=session, units={"acceleration": unit})
    assert found["status"] == "rejected"
    assert any("look like counts; declare units.acceleration: count" in r for r in found["reasons"])
    nominal = {"acceleration": {"scale": 1 / per_g}, "angular_rate": {"scale": 1 / per_rate}}
    assert taken(log, kind=session, units=COUNTS, nominal=nominal)["status"] == "ok"


def summed(log, rate, force=1.0, turn=1.0):
    """Return increments of velocity and angle per sample, in units of 1/force and 1/turn of SI."""
    log = log.copy()
    log[list(ACCELERATION)] *= force / rate
    log[list(ANGULAR_RATE)] *= turn / rate
    return log


def swinging(rate, seconds=60.0):
    """Return a log that never rests: swings about two axes, gravity alone as its force."""
    t = np.arange(round(seconds * rate)) / rate
    angles = np.column_stack([0.9 * np.sin(1.1 * t), 0.8 * np.sin(1.7 * t + 1)])
    body = Rotation.from_euler("xy", angles)
    log = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, 0.0)})
    log[list(ACCELERATION)] = body.inv().apply([0, 0, 9.8])
    log.loc[1:, list(ANGULAR_RATE)] = (body[:-1].inv() * body[1:]).as_rotvec() * rate
    noise = np.random.default_rng(4).normal(size=(len(t), 6))
    log[list(CHANNELS)] += noise * ([2e-2] * 3 + [2e-3] * 3)
    return log


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
    log = summed(log, rate, force, turn)
    units = dict(zip(COUNTS, units, strict=True))
    found = taken(log, kind="multi_position", units=units)
    assert found["status"] == "rejected" and found["misdeclared"]
    [reason] = found["reasons"]
    assert f"off by the step of {1 / rate:.4g} s, so the log looks like increments of" in reason
    end = f"declare units.acceleration: {declare[0]} and units.angular_rate: {declare[1]}"
    assert reason.endswith(end) and "\n" not in reason
    units = dict(zip(COUNTS, declare, strict=True))
    assert taken(log, kind="multi_position", units=units)["reasons"] == []


@pytest.mark.parametrize("rate", [50.0, 100.0, 400.0])
def test_increments_at_rest_in_one_attitude_are_named(taken, rate):
    """Protects a static log of increments: nothing but gravity and noise shows them."""
    log = simulated("static", 5, example_truth(rate=rate), duration_s=60.0)
    [reason] = taken(summed(log, rate), kind="static")["reasons"]
    assert f"rad/s/√Hz: gravity is off by the step of {1 / rate:.4g} s" in reason
    assert reason.endswith("declare units.acceleration: m/s; see units.angular_rate too")
    units = dict(zip(COUNTS, ("m/s", "rad"), strict=True))
    assert taken(summed(log, rate), kind="static", units=units)["reasons"] == []
    # gravity that was taken out leaves as much by chance; or other values of as little noise
    taken_out, left = log.copy(), np.array([0, 0, 9.80665 / rate])
    taken_out[list(ACCELERATION)] += left - log[list(ACCELERATION)].mean()
    quiet = summed(log, rate)
    quiet[list(ACCELERATION)] *= 0.9
    for other in (taken_out, quiet):
        found = taken(other, kind="static")
        assert found["reasons"] == [] and "has gravity been taken out" in str(found["warnings"])


def test_increments_in_counts_and_without_turns_are_named(taken):
    """Protects the two logs of increments in which a sensor says less: by its scale, or nothing."""
    rate = 125.0
    log = summed(simulated("multi_position", 7, example_truth(rate=rate), poses=9), rate)
    nominal = {"acceleration": {"scale": 1e-7}, "angular_rate": {"scale": 1e-9}}
    counts = log.copy()
    for quantity, axes in (("acceleration", ACCELERATION), ("angular_rate", ANGULAR_RATE)):
        counts[list(axes)] = (log[list(axes)] / nominal[quantity]["scale"]).round()
    [reason] = taken(counts, units=COUNTS, nominal=nominal)["reasons"]
    declare = "nominal.acceleration.scale: 1.25e-05 and nominal.angular_rate.scale: 1.25e-07"
    assert reason.endswith(declare)
    # a gyroscope of which nothing is known but its noise
    noise = np.random.default_rng(1).normal(size=(len(log), 3))
    [reason] = taken(log.assign(**dict(zip(ANGULAR_RATE, 1e-5 * noise.T, strict=True))))["reasons"]
    assert "attitudes: gravity is off by the step of 0.008 s" in reason
    assert reason.endswith("declare units.acceleration: m/s; see units.angular_rate too")


def test_what_is_off_by_the_step_by_chance_is_no_increment(taken):
    """Protects logs of rates: gravity taken out, and units that look the same at 1 kHz."""
    log = simulated("static", 5, duration_s=60.0)
    log[list(ACCELERATION)] += [0, 0, 0.098] - log[list(ACCELERATION)].mean()
    found = taken(log, kind="static")
    assert found["reasons"] == []
    assert "has gravity been taken out of the log, or is it increments" in str(found["warnings"])
    log = simulated("multi_position", 5, example_truth(rate=1000.0), poses=5)
    found = taken(log, units={"acceleration": "g", "angular_rate": "deg/s"})
    assert "taken as g, it looks like m/s^2" in found["reasons"][0]
    assert "taken as deg/s, it looks like rad/s" in found["reasons"][1]


def test_a_recording_of_increments_is_rejected_with_the_cause(recordings, taken):
    """Protects a whole file as a logger writes it: no header, no units, three columns of angles."""
    path = recordings("unlabelled_increments_100Hz.txt.gz")
    columns = {"time": 0, "angular_rate": [1, 2, 3], "acceleration": [4, 5, 6]}
    [reason] = taken(path, kind="multi_position", columns=columns)["reasons"]
    assert reason.endswith("declare units.acceleration: m/s and units.angular_rate: rad")
    units = {"acceleration": "m/s", "angular_rate": "rad"}
    found = taken(path, kind="multi_position", columns=columns, units=units)
    assert found["status"] == "ok"
