"""Increments of velocity and angle become rates by the interval that they are really of."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core.samples import CHANNELS
from imuloop.core.units import DEGREE
from ingest.figures import check_figures
from ingest.logs import FORCE, RATE

SIX = [*CHANNELS]
DELTA = [f"dv{axis}" for axis in "xyz"] + [f"dtheta_{axis}" for axis in "xyz"]
# as ulog2csv writes a vehicle_imu
OF_PX4 = [f"delta_{name}[{i}]" for name in ("velocity", "angle") for i in range(3)]
# a sensor whose intervals vary by a tenth, whole us; another one's; and stamps that end them
TICKS = np.random.default_rng(3).integers(9_500, 10_500, 500)
EACH = np.repeat([TICKS, TICKS + 37], 3, axis=0).T
STAMPS, EVEN = np.cumsum(TICKS), 10_000 * np.arange(500)
# stamps of a host, which say nothing of the intervals
OF_HOST = STAMPS + np.random.default_rng(5).integers(-1000, 1000, 500)
OWN_DT = {"delta_velocity_dt": EACH[:, 0], "delta_angle_dt": EACH[:, 5]}
INTERVAL = {"acceleration": "delta_velocity_dt", "angular_rate": "delta_angle_dt"}
US = {"time": "us", "interval": "us"}
LOST = [*range(100, 150), 300]
# a roll-over, a repeated and a late stamp, and a clock that starts again
FAULTY = (2**32 - 1_000_000 + EVEN) % 2**32
FAULTY[40], FAULTY[[60, 61]] = FAULTY[39], FAULTY[[61, 60]]
FAULTY[380:] -= FAULTY[380]
# a sensor that pauses, so that the stamps of packets stay but for those within a packet
PAUSED = 0.05 * (np.arange(500) // 5) + 3.0 * (np.arange(500) >= 250)
STEPS = "step of the stamps that ends at the row; 1 at the start has none and is dropped"

# interval of each row, s; other columns; rows that are lost, and dropped; figures; what is declared
CASES = {
    "steps of the stamps": (TICKS * 1e-6, {"time_us": 10**9 + STAMPS}, [], [0], {
        "warnings.0": lambda line: line.endswith(f"divided by their interval: {STEPS}"),
        "warnings.1": lambda line: f"{TICKS[2:].std() / TICKS[2:].mean():.1%} of a step" in line,
        "increments.usual_step_s": np.median(TICKS[2:]) * 1e-6,
        "increments.without_interval": 1, "increments.by_usual_step": 0}, {}),
    **{f"a column {name}": (TICKS * 1e-6, {"time_us": OF_HOST, name: TICKS}, [], [], {
        "warnings.0": lambda line: line.endswith("divided by their interval: logged"),
        "columns.interval": [name]}, {"units": units})
       for name, units in (("delta_t [us]", {}), ("interval", {"interval": "us"}))},
    **{f"one of each sensor, {columns}": (EACH * 1e-6, {"timestamp": STAMPS} | OWN_DT, [], [],
        {"columns.interval": [*OWN_DT]}, {"units": US, "columns": columns})
       for columns in ({}, {"interval": INTERVAL})},
    "lost rows": (0.01, {"time_us": EVEN}, LOST, [0], {
        "gaps.count": 2, "increments.by_usual_step": 2, "warnings.0": lambda line:
        "2 after gaps are of the usual step 0.01 s" in line}, {}),
    "faults of stamps": (0.01, {"time_us": FAULTY}, [], [0, 40, 61], {
        "duplicates": 1, "out_of_order": 1, "clock.rollovers": 1, "clock.resets": 1}, {}),
    # each packet holds a part of its step
    "packets": (0.01, {"t": PAUSED}, [], [0], {"increments.usual_step_s": 0.01}, {}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_increments_become_the_rates_that_they_are_of(log, run, case):
    seconds, columns, lost, dropped, figures, declared = CASES[case]
    names, rates = OF_PX4 if "timestamp" in columns else DELTA, log[SIX].to_numpy()
    seconds = np.broadcast_to(np.transpose(seconds), rates.T.shape).T
    table = pd.DataFrame(rates * seconds, columns=names)
    done = run(table.assign(**columns).drop(index=lost), **declared)
    assert done.quality["status"] == "ok", done.quality["reasons"]
    np.testing.assert_allclose(done.samples[SIX], np.delete(rates, [*lost, *dropped], 0), rtol=1e-9)
    check_figures(done.quality, figures)
    names = [done.metadata["raw_units"][q]["name"] for q in ("acceleration", "angular_rate")]
    assert names == ["m/s^2", "rad/s"]


def test_increments_of_stamps_in_bursts_are_of_the_step_of_the_line(log, run):
    late = np.repeat(np.random.default_rng(6).gamma(2, 0.001, 100), 5)
    t = 0.05 * (np.arange(500) // 5) + late + 0.002 * (np.arange(500) % 5)
    done = run(pd.DataFrame(log[SIX].to_numpy() * 0.01, columns=DELTA).assign(t=t))
    step = done.samples.t[499] / 499
    assert done.quality["clock"]["rebuilt"] and step == pytest.approx(0.01, rel=5e-3)
    np.testing.assert_allclose(done.samples[SIX], log[SIX] * (0.01 / step), rtol=1e-12)
    assert done.quality["increments"]["interval"] == "step of the rows, rebuilt"


def test_columns_of_any_name_are_increments_where_their_unit_says_so(log, run):
    units = {"acceleration": "mm/s", "angular_rate": "deg"}
    done = run(log.assign(**log[FORCE] * 10, **log[RATE] * 0.01 / DEGREE), units=units)
    np.testing.assert_allclose(done.samples[SIX], log[SIX].iloc[1:], rtol=1e-9)
