"""One device through imuloop and the plain fit, both against the truth on data that none saw."""

import time
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import imuloop
from bench.realistic.device import CHANNELS, DEGREE, GRAVITY, record, sphere
from bench.realistic.plain import fit

SENSORS = ("accelerometer", "gyroscope")
DIRECTIONS = 60
RATE = 100 * DEGREE
# how long each direction is held: derivatives and windows of any effect are over then, s
HOLD = 2.0
SOUND = ("consistent", "not_testable")


def probes(device):
    """Yield time (s), temperature (°C), true specific force and rate, (3,) each, noise-free.

    All over the sphere at rest and at 100 °/s, early and late in the log, at its middle
    temperature and the temperatures of the coldest and the warmest rest, each steady.
    """
    directions = sphere(DIRECTIONS)
    about = np.random.default_rng(device.seed).permutation(directions)
    for t in device.columns["t"][-1] * np.array([0.1, 0.9]):
        for temperature in (device.temperatures[0], device.middle, device.temperatures[1]):
            for up, axis in zip(directions, about, strict=True):
                yield t, temperature, GRAVITY * up, np.zeros(3)
                yield t, temperature, GRAVITY * up, RATE * axis


def errors(device, corrected):
    """Return the root-mean-square errors of a calibration, SI, by name.

    `corrected` gives specific force and rate of raw ones, (n, 3) each, at times and temperatures
    (n,). ``accelerometer`` is at rest, ``gyroscope`` at rest and at 100 °/s.
    """
    n, squares = int(HOLD * device.rate) | 1, {s: [] for s in SENSORS}
    for t, temperature, *true in probes(device):
        raw = [
            np.tile(getattr(device, s).raw(true[k]) + device.bias(k, t, temperature), (n, 1))
            for k, s in enumerate(SENSORS)
        ]
        times = t + (np.arange(n) - n // 2) / device.rate
        output = corrected(*raw, times, np.full(n, temperature))
        force, turn = (np.sum((output[k][n // 2] - true[k]) ** 2) for k in range(2))
        squares["gyroscope"].append(turn)
        if not true[1].any():
            squares["accelerometer"].append(force)
    return {name: float(np.sqrt(np.mean(values))) for name, values in squares.items()}


def judge(seed, case, keep=None):
    """Return the outcome of one device, for JSON; its log and results stay in a folder `keep`."""
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(keep or folder) / f"{case}_{seed}"
        folder.mkdir(parents=True, exist_ok=True)
        device = record(seed, case)
        device.write(folder / "log.csv")
        (folder / "truth.json").write_text(device.truth())
        start = time.process_time()
        result = imuloop.calibrate(folder / "log.csv", folder=folder / "results", progress=False)
        seconds = time.process_time() - start
        return outcome(device, result) | {"seconds": round(seconds, 1)}


def outcome(device, result):
    """Return the judgement of a Result, for JSON."""
    calibration, warm = result.calibration, "temperature" in device.columns
    apply = calibration.apply_arrays
    ours = errors(device, lambda f, w, t, hot: apply(f, w, t, hot if warm else None, nominal=True))
    log = np.column_stack([device.columns[name] for name in CHANNELS])
    plain = fit(device.columns["t"], log[:, :3], log[:, 3:], device.rests)

    def by_plain(f, w, *_):
        return [s.corrected(x) if s else x for s, x in zip(plain, (f, w), strict=True)]

    others = errors(device, by_plain)
    missing = [s for s, sensor in zip(SENSORS, plain, strict=True) if sensor is None]
    return {
        **{
            name: getattr(device, name) for name in ("case", "seed", "parts", "effect_free", "rate")
        },
        "rests": len(device.rests),
        "failures": result.failures,
        "notes": result.notes,
        "methods": {s: getattr(calibration, s).method for s in SENSORS},
        "not_testable": {s: getattr(calibration, s).not_testable for s in SENSORS},
        "verdicts": result.verdict,
        "effects": {
            s: {r: [e["name"] for e in part["effects"]] for r, part in parts.items()}
            for s, parts in result.diagnosis["sensors"].items()
        },
        "no_plain_fit": missing,
        "imuloop": ours,
        "plain": others,
        "ratios": {s: None if s in missing else ours[s] / others[s] for s in SENSORS},
        "pulls": {s: pulls(getattr(calibration, s), getattr(device, s)) for s in SENSORS},
    }


def pulls(sensor, true):
    """Return the errors of the T, K and b that were estimated, in their standard errors."""
    off = {letter: getattr(sensor, letter) - getattr(true, letter) for letter in "TKb"}
    return {
        name: float(off[name[0]][tuple(map(int, name[1:]))] / std)
        for name, std in sensor.std.items()
        if name[0] in off and name[1:].isdigit() and std > 0
    }


def alarms(device):
    """Return the verdicts that say that something is missing, 'sensor record: verdict, effects'."""
    return [
        f"{sensor} {record}: {' '.join([verdict, *device['effects'][sensor][record]])}"
        for sensor, records in device["verdicts"].items()
        for record, verdict in records.items()
        if verdict not in SOUND
    ]
