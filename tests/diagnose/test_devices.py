"""Simulated devices through all stages, each once, and a table of what their results say."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from bench.study import physics
from bench.study.chain import run_stages
from bench.study.devices import Injected, with_effects
from calibrate.devices import known_noise, plan_session, recording
from imuloop import chain
from imuloop.core.files import read_json
from imuloop.core.samples import ANGULAR_RATE, CHANNELS, SENSORS
from imuloop.model.calibration import Calibration
from imuloop.model.effect import FittedEffect, find_effect
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import SessionTruth, example_truth
from imuloop.validate.drift import check_drift
from quick import hurry

TRUTH = plan_session(example_truth(rate=50.0), poses=30)
POSES = "multi_position"
RATE = list(ANGULAR_RATE)
# rad/s per m/s^2: 0.1 deg/s per g, as common parts have
G = np.radians(0.1) / 9.80665 * Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
GAIN = {f"G{i}{j}": G[i, j] for i in range(3) for j in range(3)}
# white noise and, in a changing temperature, bias per K of each axis of a device at rest, SI
WHITE = {"accelerometer": 2e-3, "gyroscope": 2e-4}
SLOPES = {
    "accelerometer": np.array([1e-3, -2e-3, 3e-3]),
    "gyroscope": np.array([2e-4, 1e-4, -1e-4]),
}
# standard deviation of the bias between power cycles: 1 mg and 0.11 deg/s
JUMP = {"accelerometer": 9.80665e-3, "gyroscope": np.radians(0.11)}
CYCLE = SessionTruth(POSES, poses=16, rest_s=(4.0, 4.0), move_s=(2.0, 2.0))


def of_poses(truth=TRUTH, change=lambda log: log, seed=1):
    """Return the log of a device's poses, changed."""
    return {"log": change(simulate_session(truth, POSES, seed))}


def at_rest(*attitudes, warm=True):
    """Return logs of 4000 s at 4 Hz, one an attitude."""
    logs, t = {}, np.arange(16_000) / 4.0
    kelvin = 12 * np.sin(2 * np.pi * t / 3000.0)
    for seed, up in enumerate(attitudes):
        x = np.random.default_rng(seed).normal(size=(len(t), 6))
        x *= 2 * np.repeat([*WHITE.values()], 3)
        x[:, :3] += up
        x += warm * np.outer(kelvin, np.concatenate([*SLOPES.values()]))
        log = pd.DataFrame(x, columns=CHANNELS)
        logs[f"rest_{seed}"] = log.assign(t=t, temperature=20 + kelvin)
    return logs


def jumps(number=3, size=1.0):
    """Return what each power cycle adds to the bias of both sensors, raw units."""
    rng = np.random.default_rng(1)
    return [{s: tuple(rng.normal(0, size * JUMP[s], 3)) for s in SENSORS} for _ in range(number)]


def power_cycles(number=3, size=1.0, seed=10):
    """Return logs of several power cycles, the bias of each another."""
    logs = {}
    for k, jump in enumerate(jumps(number, size)):
        truth = replace(TRUTH, sessions={POSES: replace(CYCLE, turn_on=jump)})
        logs[f"cycle_{k}"] = simulate_session(truth, POSES, seed + k)
    return logs


def later(channels, values):
    """Return a change of a log: other values in its last third."""

    def change(log):
        rows = np.arange(len(log)) > 2 / 3 * len(log)
        log.loc[rows, channels] = values(log.loc[rows, channels].to_numpy())
        return log

    return change


def cut(log):
    """Return the log without 8 s in its middle, its stamps even."""
    n = len(log) // 2
    rest = log.drop(index=range(n, n + 400)).reset_index(drop=True)
    return rest.assign(t=log["t"].to_numpy()[: len(rest)])


def g_sensitive():
    effect = FittedEffect(find_effect("g_sensitivity")(), GAIN, {})
    return replace(TRUTH, gyroscope=replace(TRUTH.gyroscope, effects=(effect,)))


# of sizes of about five detection limits
PRODUCTS = {"f_y² f_z": 1e-4, "w_x f_y": 5e-4}


def with_products():
    injected = [
        Injected(physics.PRODUCTS[f][0], "product", extra=physics.product(f, size))
        for f, size in PRODUCTS.items()
    ]
    return with_effects(TRUTH, injected)


B = TRUTH.gyroscope.b
DEVICES = {
    "plain": of_poses,
    "g-sensitive": lambda: of_poses(g_sensitive()),
    "products": lambda: of_poses(with_products()),
    "four poses": lambda: of_poses(plan_session(TRUTH, poses=3)),
    "cut": lambda: of_poses(change=cut),
    "accelerometer halves": lambda: of_poses(
        change=later(list(CHANNELS[:3]), lambda x: 0.5 * x), seed=0
    ),
    "gyroscope swaps axes": lambda: of_poses(change=later(RATE, lambda x: x[:, [1, 0, 2]])),
    "gain halves": lambda: of_poses(change=later(RATE, lambda x: B + 0.5 * (x - B))),
    "bias jumps": lambda: of_poses(change=later(RATE, lambda x: x + 0.03)),
    "power cycles": power_cycles,
    "equal power cycles": lambda: power_cycles(2, 0.0, 20),
    "heated": lambda: at_rest((0.1, -0.2, 9.8), (9.8, 0.3, -0.1)),
    "heated, one attitude": lambda: at_rest((0.1, -0.2, 9.8)),
    "at rest": lambda: at_rest((0.1, -0.2, 9.8), warm=False),
}
# those of which the calibration alone is judged
CHANGED = ("accelerometer halves", "gyroscope swaps axes", "gain halves", "bias jumps")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return a function: the folder of the results of a device, which is run when asked first."""

    @cache
    def of(name):
        folder, logs = tmp_path_factory.mktemp("device"), DEVICES[name]()
        kinds = dict.fromkeys(logs, "static" if "rest_0" in logs else POSES)
        device = chain.Device("imu", folder, kinds, gravity=TRUTH.gravity)
        for session, log in logs.items():
            log.to_parquet(folder / f"{session}.parquet", index=False)
            chain.ingest(device, session, {}, [folder / f"{session}.parquet"])
        stages = (chain.segment, chain.noise, chain.calibrate, chain.diagnose)
        with hurry("imu"):
            run_stages(device, stages[: 3 if name in CHANGED else 4])
        return folder

    return of


def look(content, keys):
    """Return what stands in a result at keys; ``*`` is each of a list."""
    for n, key in enumerate(keys):
        if key == "*":
            return [look(part, keys[n + 1 :]) for part in content]
        content = content[int(key) if isinstance(content, list) else key]
    return content


def near(**true):
    """Expect the parameters of an effect within four standard errors, and its errors to fall."""

    def holds(effect):
        off = [(effect["parameters"][k] - v) / effect["std"][k] for k, v in true.items()]
        low, high = effect["ratio_ci95"]
        ratio = effect["heldout_after"] / effect["heldout_before"]
        return np.abs(off).max() < 4 and low <= ratio <= high < 1 and effect["p_value"] < 1e-4

    return holds


def at_floor(residual):
    """Expect a residual that is as large as its noise."""
    return residual["after"] == pytest.approx(residual["floor"], rel=0.25)


def of_slopes(sensor):
    slopes = zip("xyz", SLOPES[sensor], strict=True)
    return near(**{f"c1{axis}": slope for axis, slope in slopes})


def of_jumps(sensor):
    b = np.array([jump[sensor] for jump in jumps()])
    true = (b - b.mean(axis=0))[1:] * getattr(TRUTH, sensor).K.mean()
    return near(**{f"s{k + 2}{axis}": true[k, i] for k in range(2) for i, axis in enumerate("xyz")})


def noise_again(sensor):
    """Expect the noise without the temperature that was read as a slow term."""

    def holds(noise):
        white = [axis["after"]["N"]["value"] for axis in noise.values()]
        slow = [axis["after"][k]["value"] for axis in noise.values() for k in "KR"]
        return white == pytest.approx([WHITE[sensor]] * 3, rel=0.03) and set(slow) == {None}

    return holds


def at_two_thirds(words):
    """Expect that words name the time at which a sensor changed, within 20 s."""
    end = of_poses(seed=0)["log"]["t"].iloc[-1]
    return abs(float(words.split("changed at about ")[1].split(" s:")[0]) - 2 / 3 * end) < 20.0


F, W = SENSORS
EXPECTED = [
    *(("plain", f"{s} poses verdict", "consistent") for s in SENSORS),
    *(("plain", f"{s} poses effects", []) for s in SENSORS),
    *(("plain", f"{F} poses residuals {r}", at_floor) for r in ("gravity_norm",)),
    *(("plain", f"{W} poses residuals {r}", at_floor) for r in ("pose_rate", "rotation")),
    # no product is looked for where nothing is missing
    ("plain", f"{F} poses candidates * name", lambda names: "product" not in names),
    ("g-sensitive", f"{W} poses verdict", "explained"),
    ("g-sensitive", f"{F} poses verdict", "consistent"),
    ("g-sensitive", f"{W} poses effects * name", ["g_sensitivity"]),
    ("g-sensitive", f"{W} poses effects 0", near(**GAIN)),
    *(("g-sensitive", f"{W} poses residuals {r}", at_floor) for r in ("pose_rate", "rotation")),
    *(("products", f"{s} poses verdict", "explained") for s in SENSORS),
    ("products", f"{F} poses effects * constants formula", ["f_y² f_z"]),
    ("products", f"{W} poses effects * constants formula", ["w_x f_y"]),
    ("products", f"{F} poses effects 0", near(cx=1e-4)),
    ("products", f"{W} poses effects 0", near(cz=5e-4)),
    *(("four poses", f"{s} poses verdict", "not_testable") for s in SENSORS),
    *(("four poses", f"calibration {s} method", POSES) for s in SENSORS),
    ("cut", f"{W} poses verdict", "consistent"),
    ("cut", f"{W} poses contradicting * session", ["log"]),
    ("accelerometer halves", f"multi_position {F} method", "nominal"),
    ("accelerometer halves", f"multi_position {F} not_testable", at_two_thirds),
    # the rates at rest need no direction of gravity
    ("accelerometer halves", f"multi_position {W} method", "static"),
    ("gyroscope swaps axes", f"multi_position {F} method", POSES),
    # its bias before and after has no mean that is right for either
    ("gyroscope swaps axes", f"multi_position {W} method", "nominal"),
    ("gyroscope swaps axes", f"multi_position {W} not_testable", "the gyroscope, or an axis"),
    ("gain halves", f"multi_position {W} method", "static"),
    ("bias jumps", f"multi_position {W} method", POSES),
    *(("power cycles", f"{s} poses verdict", "explained") for s in SENSORS),
    *(("power cycles", f"{s} poses effects * name", ["turn_on_bias"]) for s in SENSORS),
    *(("power cycles", f"{s} poses effects 0", of_jumps(s)) for s in SENSORS),
    *(("equal power cycles", f"{s} poses verdict", "consistent") for s in SENSORS),
    *(("equal power cycles", f"{s} poses effects", []) for s in SENSORS),
    *(("heated", f"{s} static_record verdict", "explained") for s in SENSORS),
    *(("heated", f"{s} static_record effects * name", ["bias_temperature"]) for s in SENSORS),
    *(("heated", f"{s} static_record effects 0", of_slopes(s)) for s in SENSORS),
    *(("heated", f"{s} static_record residuals bias", at_floor) for s in SENSORS),
    *(("heated", f"{s} static_record noise", noise_again(s)) for s in SENSORS),
    (
        "heated, one attitude",
        f"{F} static_record confounded",
        lambda pairs: (
            ("scale_temperature", "bias_temperature") in {(p["effect"], p["with"]) for p in pairs}
        ),
    ),
    *(("at rest", f"{s} static_record verdict", "consistent") for s in SENSORS),
    *(("at rest", f"{s} static_record effects", []) for s in SENSORS),
    *(("at rest", f"{s} static_record noise", {}) for s in SENSORS),
    *(
        # white noise of means over a minute on three axes, the level of the other blocks
        ("at rest", f"{s} static_record residuals bias floor", WHITE[s] * np.sqrt(3 / 60 * 59 / 58))
        for s in SENSORS
    ),
]


@pytest.mark.parametrize(("device", "path", "expected"), EXPECTED)
def test_the_results_of_a_device_say(results, device, path, expected):
    name, *keys = path.split()
    if name in SENSORS:
        name, keys = "diagnosis", ["sensors", name, *keys]
    value = look(read_json(results(device) / f"{name}.json"), keys)
    if callable(expected):
        assert expected(value), value
    elif isinstance(expected, float):
        assert value == pytest.approx(expected, rel=0.1)
    elif keys[-1] == "not_testable":
        assert expected in value
    else:
        assert value == expected


def test_scale_and_misalignment_are_as_good_as_of_one_run(results):
    cycles, plain = (
        Calibration.from_json(results(name) / "calibration.json")
        for name in ("power cycles", "equal power cycles")
    )
    for sensor in SENSORS:
        std, other = getattr(cycles, sensor).std, getattr(plain, sensor).std
        assert all(std[name] < 1.3 * other[name] for name in other if name[0] in "TK")


def test_a_check_allows_for_what_the_power_cycles_showed(results):
    """No calibration knows the bias of the next power cycle; it moves by as much as the others."""
    calibration, turn_on = Calibration.from_json(results("power cycles") / "calibration.json"), JUMP
    jump = {s: tuple(np.array([1.0, -1.0, 0.5]) * size) for s, size in turn_on.items()}
    truth = replace(TRUTH, sessions={POSES: replace(CYCLE, turn_on=jump)})
    log = recording(truth, 7)
    assert not check_drift(calibration, log, known_noise(truth)).drifted
    assert check_drift(calibration, log, known_noise(truth), turn_on=(0.0, 0.0)).drifted


@pytest.mark.parametrize("name", ["gain halves", "accelerometer halves"])
def test_a_gyroscope_keeps_a_bias_that_did_not_change(results, name):
    turn = Calibration.from_json(results(name) / "multi_position.json").gyroscope
    assert np.abs(turn.b - TRUTH.gyroscope.b).max() < 1e-3
