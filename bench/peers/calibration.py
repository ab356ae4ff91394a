"""Calibration of simulated devices by imuloop and by dedrunk: whole process, and true errors."""

import os
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

from bench.peers.log import write_mcap
from bench.realistic.device import CHANNELS, GRAVITY, record, sphere
from bench.realistic.judge import errors
from bench.tables import table
from bench.workflow import timed_process
from imuloop.model.calibration import Calibration

# m/s² per mg, and seconds of a quarter turn at the rate of the judge, 100 °/s
MG, QUARTER = GRAVITY / 1000, 0.9


def by_imuloop(folder, device, environment, _):
    """Return seconds and the function that corrects specific force and angular rate, SI."""
    device.write(folder / "log.csv")
    command = [sys.executable, "-m", "imuloop", "calibrate", folder / "log.csv", "-o", folder / "o"]
    seconds = timed_process(command, os.environ | environment)[1]
    fit, warm = Calibration.from_json(folder / "o/calibration.json"), "temperature"

    def corrected(f, w, t, hot):
        return fit.apply_arrays(f, w, t, hot if warm in device.columns else None, nominal=True)

    return seconds, corrected


def by_dedrunk(folder, device, environment, programs):
    """Return seconds and the function that corrects specific force and angular rate, SI.

    Kalibr's model: ``a_raw = M a + b`` and ``ω_raw = M C ω + b``; each sensor has its own M.
    """
    axes = np.array([device.columns[name] for name in CHANNELS])
    write_mcap(folder / "log.mcap", axes[:3], axes[3:], device.columns["t"])
    command = [programs / "bin/dedrunk", "--yes", "intrinsics", folder / "log.mcap"]
    command += ["-O", folder / "imu.yaml"]
    seconds = timed_process(command, os.environ | environment)[1]
    text = (folder / "imu.yaml").read_text().partition("accelerometers:")[2]
    rows = [[float(x) for x in row.split(",")] for row in re.findall(r"\[(.*)\]", text)]
    M, b, M_g, _, C, b_g = np.split(np.array(rows), np.cumsum([3, 1, 3, 3, 3]))
    inverse, inverse_g = np.linalg.inv(M), np.linalg.inv(M_g @ C)
    return seconds, lambda f, w, *_: ((f - b) @ inverse.T, (w - b_g) @ inverse_g.T)


def in_true_frame(device, corrected):
    """Return the function `corrected` with its body axes turned to the true ones.

    Each package has its own convention of the body axes; the turn follows from noise-free gravity.
    """
    true = GRAVITY * sphere(60)
    raw, still = device.accelerometer.raw(true), np.zeros(len(true))
    force, _ = corrected(raw, np.zeros_like(true), still, still + device.middle)
    turn = Rotation.align_vectors(true, force)[0]
    return lambda *samples: [turn.apply(x) for x in corrected(*samples)]


CONTENDERS = {"imuloop": by_imuloop, "dedrunk-cli": by_dedrunk}


def calibration(seeds, programs, environment):
    """Return the table of times and errors on devices without effects, one per seed."""
    outcomes = {name: [] for name in CONTENDERS}
    for seed in seeds:
        device = record(seed, "clean")
        for name, contender in CONTENDERS.items():
            with TemporaryDirectory() as folder:
                seconds, corrected = contender(Path(folder), device, environment, programs)
            error = errors(device, in_true_frame(device, corrected))
            turn = np.degrees(error["gyroscope"]) * QUARTER
            outcomes[name].append((seconds, error["accelerometer"] / MG, turn))
    rows = [(name, *(f"{x:.2g}" for x in np.median(of, axis=0))) for name, of in outcomes.items()]
    size = f"{len(seeds)} recordings of poses"
    return table((size, "processor time, s", "at rest, mg", "after a quarter turn, degrees"), rows)
