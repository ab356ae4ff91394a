"""Allan curves of a session: which stretches count, intervals, and the file of the stage."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from imuloop import chain
from imuloop.core.samples import CHANNELS
from imuloop.core.segments import segment_table
from imuloop.core.tables import write_sessions, write_table
from imuloop.noise.allan import COLUMNS, allan_curve, no_curves, session_curves
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.simulate import noise
from seeds import seeds

SETTINGS, RATE = NoiseSettings(), 50.0


def session(x, rows, kinds=("static",), kind="static"):
    """Return a session with `x` on every axis; `rows` are the rows of its segments, in order."""
    samples = pd.DataFrame({"t": np.arange(len(x)) / RATE} | dict.fromkeys(CHANNELS, x))
    edges = np.cumsum([0, *rows]) / RATE
    segments = segment_table(samples, edges[:-1], edges[1:], kinds, range(len(kinds)))
    return RecordedSession("rest", kind, samples, segments)


def pooled(stretches, factors):
    """Return the overlapping deviation by its definition."""
    total, count = np.zeros((2, len(factors)))
    for k, m in enumerate(factors):
        for x in stretches:
            phase = np.cumsum(np.append(0.0, x))
            second = phase[2 * m :] - 2 * phase[m:-m] + phase[: -2 * m]
            total[k] += second @ second / (2 * m**2)
            count[k] += len(second)
    return np.sqrt(total / count)


@pytest.mark.parametrize("between", ["disturbed", "gap", "motion"])
def test_what_lies_between_two_rests_adds_no_term(between):
    rng = np.random.default_rng(1)
    before, after = rng.standard_normal(3000), 5 + rng.standard_normal(2500)
    x = np.concatenate([before, np.full(500, 1e3), after])
    kind = "multi_position" if between == "motion" else "static"
    rests = session(x, (3000, 500, 2500), ("static", between, "static"), kind)
    curve = pd.DataFrame(session_curves(rests, SETTINGS)).query("axis == 'gy'")
    assert tuple(curve.columns) == COLUMNS and set(curve["stage"]) == {"raw"}
    factors = np.rint(curve["tau_s"] * RATE).astype(int)
    assert factors.iloc[[0, -1]].tolist() == [1, 1000]
    np.testing.assert_allclose(curve["adev"], pooled([before, after], factors), rtol=1e-9)


def test_a_few_missing_samples_end_no_stretch():
    whole = session(np.random.default_rng(2).standard_normal(9000), (9000,))
    lost = replace(whole, samples=whole.samples.drop(index=range(4000, 4004)))
    assert session_curves(lost, SETTINGS)["tau_s"].max() == pytest.approx(60, rel=0.01)


@pytest.mark.parametrize("lengths", [[10_000], np.geomspace(60, 1500, 20).astype(int)])
@pytest.mark.parametrize(("quantisation", "walk"), [(0.0, 0.02), (1.0, 0.0), (0.0, 0.0)])
@seeds(40, 400)
def test_intervals_cover(seeds, quantisation, walk, lengths):
    """White noise of unit density, the other as coefficient: 95 % of the points hold the truth."""
    inside = []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 11])
        parts = [
            noise.white(n, 1.0, 1.0, rng)
            + noise.quantisation(n, 1.0, quantisation, rng)
            + noise.walk(n, 1.0, walk, rng)
            for n in lengths
        ]
        m, _, low, high, _ = allan_curve(parts, 1.0, SETTINGS)
        true = 3 * quantisation**2 / m**2 + 1 / m + walk**2 * (2 * m**2 + 1) / (6 * m)
        inside.append((low**2 <= true) & (true <= high**2))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.3 / np.sqrt(seeds))
    # the longest averaging times too
    assert np.mean(inside, axis=0)[-3:].min() > 0.95 - 1 / np.sqrt(seeds)


def test_each_session_has_its_own_curves_and_the_corrected_rows(tmp_path):
    x = np.random.default_rng(3).standard_normal(3000)
    device = chain.Device("imu", tmp_path, {"rest": "static", "poses": "multi_position"})
    sessions = {
        "rest": session(x, (3000,)),
        "poses": session(0 * x, (2000, 1000), ("static", "motion"), "multi_position"),
    }
    for name, one in sessions.items():
        write_table(tmp_path / name / "samples.parquet", one.samples)
        write_table(tmp_path / name / "segments.parquet", one.segments)
    corrected = session_curves(session(x / 2, (3000,)), SETTINGS, "corrected")
    tables = {"": no_curves(), "rest": corrected}
    write_sessions(tmp_path / "allan_corrected.parquet", tables)
    chain.allan(device)
    rest, poses = (pd.read_parquet(tmp_path / name / "allan.parquet") for name in sessions)
    assert tuple(rest.columns) == tuple(poses.columns) == COLUMNS
    raw, after = (rest[rest["stage"] == stage] for stage in ("raw", "corrected"))
    np.testing.assert_allclose(raw["adev"], 2 * after["adev"])
    # outputs of zero are of a sensor that the log lacks
    assert poses.empty


@pytest.mark.parametrize("x", [np.arange(3.0), np.full(400, 9.8)])
def test_short_or_constant_output_gives_what_there_is(x):
    curves = pd.DataFrame(session_curves(session(x, (len(x),)), SETTINGS))
    assert set(curves["axis"]) == set(CHANNELS) and not curves.isna().any(axis=None)
    assert curves["adev"].to_numpy() == pytest.approx(np.sqrt(0.5) * len(set(x)) / 3 * (x[0] == 0))
