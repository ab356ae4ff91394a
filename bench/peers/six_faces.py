"""The six-position calibration beside imucal's, on imucal's own recording and on simulated ones."""

import json
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from bench.measured import CACHE
from bench.peers.calls import FACES, FACES_CALLS, FACES_RATE, FORCE, GRAVITY
from bench.peers.contend import contend
from bench.study.tables import table
from imuloop.calibrate.six_position import decompose
from imuloop.simulate.truth import example_truth

LOG, SECTIONS = "example_ferraris_session.csv", "example_ferraris_session_list.json"
# simulated sessions; degrees that a face is off, about both axes that lie in it; samples of each
SESSIONS, TILT, LENGTH = 50, 1.0, 400
# m/s^2 a sample
NOISE = 0.02
WHAT = {
    "imuloop, faces": "accelerometer, with covariance; faces found by `segment`, not timed here",
    "imucal, faces": "accelerometer; from three turns of known angle gyroscope and g-sensitivity; "
    "sections marked by hand",
}


def simulate(folder):
    """Write simulated sessions, whose faces are a little off, and return the true parameters."""
    rng, sensor = np.random.default_rng(1), example_truth().accelerometer
    inverse = np.linalg.inv(sensor.T @ np.diag(sensor.K))
    names = (*FACES, "x_rot", "y_rot", "z_rot")
    sections = {n: {"start": i * LENGTH, "end": (i + 1) * LENGTH} for i, n in enumerate(names)}
    up = np.concatenate([np.kron(np.eye(3), [[1], [-1]]), np.eye(3)])
    # the turns only fill their place: they do not enter what is compared
    turning = np.repeat(np.concatenate([np.zeros((6, 3)), -60 * np.eye(3)]), LENGTH, axis=0)
    for session in range(SESSIONS):
        off = np.cross(rng.normal(0, np.radians(TILT), (len(up), 3)), up)
        direction = (up + off) / np.linalg.norm(up + off, axis=1, keepdims=True)
        raw = np.repeat(GRAVITY * direction @ inverse.T + sensor.b, LENGTH, axis=0)
        log = pd.DataFrame(raw + rng.normal(0, NOISE, raw.shape), columns=FORCE)
        log[["gyr_x", "gyr_y", "gyr_z"]] = turning
        log.to_csv(folder / f"{session:03}.csv", index=False)
        (folder / f"{session:03}.json").write_text(json.dumps(sections))
    return np.concatenate([sensor.T[np.triu_indices(3, 1)], sensor.K, sensor.b])


def errors(parameters, truth):
    """Return the rms errors of scale factor, bias and misalignment over sessions, as text."""
    misalignment, scale, bias = np.split(parameters - truth, [3, 6], axis=-1)
    rms = [np.sqrt(np.mean(x**2)) for x in (scale / truth[3:6], bias, misalignment)]
    return f"{rms[0]:.3%}", f"{rms[1]:.2g} m/s²", f"{np.degrees(rms[2]):.2g}°"


def parameters(name, folder):
    """Return misalignments, scale factors and biases that a contender found, a row per session."""
    found = np.load(folder / f"{name}.npy")
    return np.array([decompose(each[:, :3], each[:, 3])[0] for each in found])


def compare(rounds, environment):
    """Return the table and what it says of the recording."""
    mirror, rows, best, made = os.environ.get("IMULOOP_MIRROR") or CACHE, [], {}, {}
    given = [next(Path(mirror).rglob(name), None) for name in (LOG, SECTIONS)]
    with tempfile.TemporaryDirectory() as simulated, tempfile.TemporaryDirectory() as measured:
        simulated, measured = Path(simulated), Path(measured)
        truth, timed = simulate(simulated), simulated
        if None not in given:
            timed = measured
            for source in given:
                shutil.copy(source, measured / f"0{source.suffix}")
        for name in FACES_CALLS:
            found = [contend(name, simulated, environment)]
            found += [contend(name, timed, environment) for _ in range(rounds)]
            if failed := next((each for each in found if isinstance(each, str)), None):
                rows.append((name.removesuffix(", faces"), f"failed: {failed}", *"––––"))
                continue
            best[name], version = min(each["seconds"] for each in found[1:]), found[0]["version"]
            made[name] = parameters(name, timed)[0]
            shown = f"imucal {version}" if version else "**imuloop**"
            time = f"{1e3 * best[name]:.2f} ms ({best[name] / best['imuloop, faces']:.2f}×)"
            rows.append((shown, time, *errors(parameters(name, simulated), truth), WHAT[name]))
    text = table(("", "time", "scale factor", "bias", "misalignment", "computes"), rows)
    text += (
        f"\n\nErrors are rms over {SESSIONS} simulated sessions, faces off by {TILT:g}° about each "
        f"axis, {LENGTH} samples each."
    )
    if None in given:
        return f"{text} The time is of one of them: imucal's recording is not at hand."
    text += f" The time is of imucal's own recording, published sections, {FACES_RATE:g} Hz"
    if len(made) < 2:
        return f"{text}."
    mine, theirs = made.values()
    misalignment, scale, bias = np.split(np.abs(mine - theirs), [3, 6])
    return (
        f"{text}; there both differ by at most {(scale / theirs[3:6]).max():.1e} in a scale "
        f"factor, {bias.max():.2g} m/s² in a bias, {np.degrees(misalignment.max()):.2g}° in a "
        "misalignment."
    )
