"""The six-position calibration beside imucal's, on imucal's own recording and on simulated ones."""

import json
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from bench.peers.contend import contend
from bench.peers.six_faces import CALLS, FACES, FORCE, GRAVITY, RATE
from bench.stages import REPOSITORY
from bench.study.tables import table
from imuloop.calibrate.six_position import decompose
from imuloop.simulate.truth import example_truth

LOG, SECTIONS = "example_ferraris_session.csv", "example_ferraris_session_list.json"
# simulated sessions; degrees that a face is off, about both axes that lie in it; samples of each
SESSIONS, TILT, LENGTH = 50, 1.0, 400
# m/s^2 a sample
NOISE = 0.02


def recording():
    """Return the paths of log and sections, or None where they are not at hand."""
    folders = [os.environ.get("IMULOOP_MIRROR"), REPOSITORY / "data/cache"]
    found = [
        next((p for f in folders if f for p in Path(f).rglob(name)), None)
        for name in (LOG, SECTIONS)
    ]
    return None if None in found else found


def simulate(folder):
    """Write simulated sessions, whose faces are a little off, and return the true parameters."""
    rng, sensor = np.random.default_rng(1), example_truth().accelerometer
    inverse = np.linalg.inv(sensor.T @ np.diag(sensor.K))
    names = (*FACES, "x_rot", "y_rot", "z_rot")
    sections = {n: {"start": i * LENGTH, "end": (i + 1) * LENGTH} for i, n in enumerate(names)}
    up = np.concatenate([np.kron(np.eye(3), [[1], [-1]]), np.eye(3)])
    for session in range(SESSIONS):
        # the turns only fill their place: they do not enter what is compared
        off = np.cross(rng.normal(0, np.radians(TILT), (len(up), 3)), up)
        direction = (up + off) / np.linalg.norm(up + off, axis=1, keepdims=True)
        raw = np.repeat(GRAVITY * direction @ inverse.T + sensor.b, LENGTH, axis=0)
        log = pd.DataFrame(raw + rng.normal(0, NOISE, raw.shape), columns=FORCE)
        turning = np.repeat(np.concatenate([np.zeros((6, 3)), -60 * np.eye(3)]), LENGTH, axis=0)
        log[["gyr_x", "gyr_y", "gyr_z"]] = turning
        log.to_csv(folder / f"{session:03}.csv", index=False)
        (folder / f"{session:03}.json").write_text(json.dumps(sections))
    return np.concatenate([sensor.T[np.triu_indices(3, 1)], sensor.K, sensor.b])


def call(name, folder, environment):
    """Return what a contender printed, with its parameters, or why it failed."""
    told = contend("six_faces", name, folder, environment if name == "imucal" else None)
    if isinstance(told, str):
        return told
    parameters = [decompose(each[:, :3], each[:, 3])[0] for each in np.load(folder / f"{name}.npy")]
    return {**told, "parameters": np.array(parameters)}


def errors(parameters, truth):
    """Return the rms errors of scale factor, bias and misalignment over sessions, as text."""
    misalignment, scale, bias = np.split(parameters - truth, [3, 6], axis=-1)
    rms = [np.sqrt(np.mean(x**2)) for x in (scale / truth[3:6], bias, misalignment)]
    return f"{rms[0]:.3%}", f"{rms[1]:.2g} m/s²", f"{np.degrees(rms[2]):.2g}°"


def compare(rounds, environment):
    """Return the table and what it says of the recording."""
    with tempfile.TemporaryDirectory() as simulated, tempfile.TemporaryDirectory() as measured:
        simulated, measured = Path(simulated), Path(measured)
        truth, given = simulate(simulated), recording()
        for source, end in zip(given or (), ("csv", "json"), strict=False):
            shutil.copy(source, measured / f"0.{end}")
        timed = measured if given else simulated
        turns = [{n: call(n, timed, environment) for n in CALLS} for _ in range(rounds)]
        found = {n: call(n, simulated, environment) for n in CALLS}
    rows, best = [], {}
    for name in ("imuloop", "imucal"):
        failed = next((t[name] for t in (*turns, found) if isinstance(t[name], str)), None)
        if failed:
            rows.append((name, f"failed: {failed}", *"––––"))
            continue
        best[name] = min(turn[name]["seconds"] for turn in turns)
        shown = f"imucal {found[name]['version']}" if name == "imucal" else f"**{name}**"
        time = f"{1e3 * best[name]:.2f} ms ({best[name] / best['imuloop']:.2f} ×)"
        what = {
            "imuloop": "accelerometer, with covariance; finds the faces itself (the stage "
            "`segment`, not timed here). No scale of the gyroscope: that comes from turns between "
            "attitudes, with no known angle",
            "imucal": "accelerometer, and from three turns of a known angle the gyroscope, and its "
            "g-sensitivity; no standard errors. Somebody marks nine sections by hand",
        }[name]
        rows.append((shown, time, *errors(found[name]["parameters"], truth), what))
    header = ("", "time", "scale factor", "bias", "misalignment", "computes")
    text = table(header, rows)
    text += (
        f"\n\nErrors are rms over {SESSIONS} simulated sessions, whose faces are off by {TILT:g}° "
        f"about each axis, {LENGTH} samples each."
    )
    if not given:
        return f"{text} The time is of one of them: imucal's recording is not at hand."
    text += (
        f" The time is that of imucal's own recording, in its published sections and at its "
        f"published rate of {RATE:g} Hz"
    )
    if len(best) < 2:
        return f"{text}."
    mine, theirs = (turns[0][name]["parameters"][0] for name in ("imuloop", "imucal"))
    misalignment, scale, bias = np.split(np.abs(mine - theirs), [3, 6])
    return (
        f"{text}; there both differ by at most {(scale / theirs[3:6]).max():.1e} in a scale "
        f"factor, {bias.max():.2g} m/s² in a bias, {np.degrees(misalignment.max()):.2g}° in a "
        "misalignment."
    )
