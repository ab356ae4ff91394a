"""Logs in motion: the rests give the noise, and a log without a rest gives no noise."""

import numpy as np
import pandas as pd
import pytest

import imuloop
from imuloop.__main__ import main
from imuloop.core.files import read_json
from imuloop.core.rotation import exponential, matrix, prefix_product
from imuloop.core.samples import CHANNELS, SENSORS
from quick import hurry
from test_command_line import one_line_error

RATE = 100.0
# white noise, m/s²/√Hz and rad/s/√Hz
DENSITY = {"accelerometer": 1.5e-3, "gyroscope": 1.7e-4}
# low and high end, Hz, and standard deviation, rad/s and m/s², of the parts of each motion
MOTIONS = {
    "flight": {"rate": [(0.1, 2, 0.3), (20, 50, 0.05)], "force": [(0.05, 1, 1), (20, 50, 1)]},
    "hovering": {"rate": [(0.1, 2, 0.03), (20, 50, 0.05)], "force": [(0.05, 1, 0.1), (20, 50, 1)]},
    "walk": {"rate": [(0.02, 6, 0.3), (1.7, 1.9, 0.3)], "force": [(0.5, 15, 1), (1.7, 1.9, 2)]},
}


def band(rng, n, low, high, size):
    """Return Gaussian noise of a band of frequencies, (n, 3), and of standard deviation `size`."""
    frequency = np.fft.rfftfreq(n, 1 / RATE)
    spectrum = np.fft.rfft(rng.standard_normal((n, 3)), axis=0)
    spectrum[(frequency < low) | (frequency > high)] = 0
    x = np.fft.irfft(spectrum, n, axis=0)
    return size * x / x.std(axis=0)


def moving_log(motion, seed, seconds=60.0, rests=()):
    """Return the log of a device that moves, but for rests from one time to another, s."""
    rng, n = np.random.default_rng([seed, len(motion)]), round(seconds * RATE)
    t = np.arange(n) / RATE
    moves = np.prod([np.clip(np.maximum(a - t, t - b) / 0.3, 0, 1) for a, b in rests], axis=0)
    rate, force = (
        sum(band(rng, n, *part) for part in MOTIONS[motion][key]) * np.reshape(moves, (-1, 1))
        for key in ("rate", "force")
    )
    attitude = prefix_product(exponential(rate[:-1] / RATE))
    attitude = np.concatenate([[[1.0, 0, 0, 0]], attitude])
    force = np.einsum("nji,nj->ni", matrix(attitude), force + np.array([0, 0, 9.80665]))
    log = {"t": t}
    for (sensor, axes), true in zip(SENSORS.items(), (force, rate), strict=True):
        noise = DENSITY[sensor] * np.sqrt(RATE) * rng.standard_normal((n, 3))
        log |= dict(zip(axes, (true + noise + 0.02).T, strict=True))
    return pd.DataFrame(log)


@pytest.mark.parametrize(
    ("motion", "axes"),
    [*((motion, CHANNELS) for motion in MOTIONS), *(("flight", axes) for axes in SENSORS.values())],
)
def test_a_log_without_a_rest_has_no_noise_and_says_so(motion, axes, tmp_path, capsys):
    moving_log(motion, 1)[["t", *axes]].to_csv(tmp_path / "log.csv", index=False)
    line = one_line_error(["noise", tmp_path / "log.csv", "-o", tmp_path / "out"], capsys)
    assert "no session holds a rest" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_reason_stands_where_the_numbers_would_be(tmp_path):
    moving_log("flight", 4).to_csv(tmp_path / "log.csv", index=False)
    how = {"folder": tmp_path / "out", "progress": False}
    with hurry("device"):
        result = imuloop.calibrate([], static=tmp_path / "log.csv", **how)
    assert all(axis.N.size is None for axis in result.noise.values())
    notes = read_json(tmp_path / "out/noise.json")["notes"]
    assert any("no session holds a rest" in note for note in notes)
    static = result.diagnosis["sensors"]["gyroscope"]["static_record"]
    assert static["verdict"] == "not_testable" and static["why"]


RESTS = [("flight", [(0, 10)]), ("walk", [(10, 14), (25, 28), (40, 45)])]


@pytest.mark.parametrize(("motion", "rests"), RESTS)
def test_the_rests_of_a_moving_log_give_its_noise(motion, rests, tmp_path, blank_figures):
    moving_log(motion, 5, rests=rests).to_csv(tmp_path / "log.csv", index=False)
    assert main(["noise", str(tmp_path / "log.csv"), "-o", str(tmp_path / "out")]) == 0
    axes = read_json(tmp_path / "out/noise.json")["axes"]
    for sensor, names in SENSORS.items():
        for axis in names:
            assert axes[axis]["N"]["value"] == pytest.approx(DENSITY[sensor], rel=0.15)
