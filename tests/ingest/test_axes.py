"""Axes of the two sensors that do not fit: reported, with what mends them; never in good logs."""

import numpy as np
import pandas as pd
import pytest

from calibrate.devices import planned
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.ingest.axes import KEPT, Axes
from imuloop.ingest.thinning import EvenSubsample
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth

KINDS = {"multi_position": {"poses": 10, "initial_rest_s": 10.0}, "six_position": {"repeats": 2}}
MIRRORED = "swapped or mirrored axes, a left-handed frame"


def simulated(kind, seed=7):
    return simulate_session(planned(example_truth(), kind, **KINDS[kind]), kind, seed)


@pytest.fixture(scope="module")
def logs():
    return {kind: simulated(kind) for kind in KINDS}


def turned(acceleration, angular_rate):
    """What is logged as x, y, z of each sensor: the number of its true axis, with the sign."""

    def change(log):
        for names, numbers in ((ACCELERATION, acceleration), (ANGULAR_RATE, angular_rate)):
            true = log[list(names)].to_numpy()
            log[list(names)] = true[:, np.abs(numbers) - 1] * np.sign(numbers)

    return change


def fitted(log, rate=100, rows=1 << 17):
    axes = Axes(rate)
    for start in range(0, len(log), rows):
        axes.add({name: log[name].to_numpy()[start : start + rows] for name in CHANNELS})
    return axes.fit()


GOOD, SWAPPED = (1, 2, 3), (2, 1, 3)


@pytest.mark.parametrize(
    ("acceleration", "angular_rate", "text"),
    [
        (GOOD, SWAPPED, f"x as gy, y as gx, z as gz: {MIRRORED}"),
        (GOOD, (1, -2, 3), f"y as -gy, z as gz: {MIRRORED}"),
        ((1, 2, -3), GOOD, "x as -gx, y as -gy, z as gz: turned axes;"),
        (SWAPPED, GOOD, "x as -gy, y as -gx, z as -gz: turned axes;"),
        (SWAPPED, SWAPPED, f"x as -gx, y as -gy, z as -gz: {MIRRORED}"),
        # mounted on its side
        (GOOD, (1, 3, -2), "x as gx, y as -gz, z as gy: turned"),
    ],
)
def test_axes_that_do_not_fit_are_reported(logs, run, acceleration, angular_rate, text):
    log = logs["multi_position"].copy()
    turned(acceleration, angular_rate)(log)
    lines = run(log).quality["warnings"]
    assert len(lines) == 1
    assert text in lines[0]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("swapped", [False, True])
def test_bias_scale_lost_rows_and_a_narrow_range_change_nothing(kind, swapped):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        log = simulated(kind, seed)
        # 0.3 rad/s of bias, misalignments of 5 degrees, scale errors of 10 %
        mixing = (np.eye(3) + 0.08 * rng.normal(size=(3, 3))) * rng.uniform(0.9, 1.1, 3)
        rates = log[list(ANGULAR_RATE)].to_numpy() @ mixing + rng.uniform(-0.3, 0.3, 3)
        limit = 0.6 * np.abs(rates).max()
        log[list(ANGULAR_RATE)] = np.clip(rates, -limit, limit)
        if swapped:
            turned(GOOD, (1, -3, 2))(log)
        kept = rng.random(len(log)) > 0.03
        kept[2000:2150] = False
        assert fitted(log[kept])["mapping"] == ([1, 3, -2] if swapped else None)


def about_x(rng):
    t = np.arange(6000) / 100
    angle = 1.2 * np.sin(2 * np.pi * t / 6) * (t > 6)
    force = 9.8 * np.array([0 * t, np.sin(angle), np.cos(angle)])
    rate = np.array([np.gradient(angle, t), 0 * t, 0 * t])
    x = np.concatenate([force, rate]) + rng.normal(size=(6, len(t))) * 0.02
    return {"t": t, **dict(zip(CHANNELS, x, strict=True))}


def test_turns_about_one_axis_tell_that_axis_alone(run):
    x = about_x(np.random.default_rng(1))
    x = pd.DataFrame(x)
    # what is never turned may be swapped or not: nobody can tell
    for log in (x, x.assign(gy=x.gz, gz=-x.gy)):
        assert run(log).quality["warnings"] == []
    lines = run(x.assign(gx=x.gy, gy=-x.gx)).quality["warnings"]
    assert len(lines) == 1
    assert "with x as -gy: swapped or mirrored axes (the turns of this log leave" in lines[0]


def test_rows_of_a_long_log_are_thinned_evenly():
    thinned = EvenSubsample(KEPT)
    for start in range(0, 100_000, 777):
        thinned.add(np.arange(start, min(start + 777, 100_000))[:, None])
    rows = thinned.rows()[:, 0]
    assert KEPT <= len(rows) <= 2 * KEPT
    assert set(np.diff(rows)) == {thinned.stride}
