"""Each row of the table of injections: its lines and no others, its rows, its figures."""

import numpy as np
import pytest

from imuloop.core.samples import ANGULAR_RATE, CHANNELS
from ingest.harm import in_packets, later
from ingest.injections import (
    INJECTIONS,
    KINDS,
    NO_FAULT_OF_VALUES,
    TEMPERATURE,
    check_figures,
    injected,
)
from ingest.logs import between_two_levels, gait, poses, simulated


@pytest.mark.parametrize("case", INJECTIONS, ids=lambda case: case.name)
def test_what_is_injected_is_named_and_nothing_else(run, case):
    log = injected(case)
    kind = KINDS.get(case.log, "multi_position")
    done = run(log, kind=kind, **case.declared)
    quality, samples = done.quality, done.samples
    lines = quality["reasons"] + quality["warnings"]
    assert quality["status"] == ("rejected" if case.rejected else "ok"), lines
    if case.says is not None:
        assert len(lines) == len(case.says), lines
        assert all(text in line for text, line in zip(case.says, lines, strict=True)), lines
    check_figures(quality, case.figures)
    if case.rejected:
        assert len(samples) == 0
    elif case.drops is not None:
        kept = log.drop(index=[*case.drops])
        kept = kept[~kept.index.duplicated()]
        names = [*CHANNELS, *({TEMPERATURE} & {*log})]
        np.testing.assert_array_equal(samples[names], kept[names])
        if case.rebuilt_within is not None:
            true = (kept.index - kept.index[0]) / 100
            np.testing.assert_allclose(samples.t, true, rtol=0, atol=case.rebuilt_within)


def test_noise_far_below_the_step_is_no_fault(run):
    check_figures(run(between_two_levels(), kind="static").quality, NO_FAULT_OF_VALUES)


def test_of_a_log_that_never_rests_nothing_is_said_about_its_noise(run):
    found = run(gait()).quality
    assert found["faults"]["rests"]["share"] < 0.1
    assert not any("at rest" in line for line in found["warnings"])


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_of_a_few_blocks_is_not_filtered(run, log, seed):
    noise = np.random.default_rng(seed).normal(size=(1100, 6)) * ([0.03] * 3 + [0.002] * 3)
    log = log.reindex(range(1100)).assign(t=np.arange(1100) / 350)
    log[[*CHANNELS]] = np.add(noise, [0.1, 0.2, 9.7, 0, 0, 0])
    assert run(log, kind="static").quality["warnings"] == []


def test_an_end_of_the_range_that_axes_reach_for_a_few_samples_each_is_found(run):
    """Too few on any axis alone: fast turns reach the end of a range at their peaks only."""
    log, limit, reached = poses(), 5.0, {}
    for name, share in zip(ANGULAR_RATE, (1, -1, 1), strict=True):
        at = log[name].mul(share).nlargest(9).index
        log[name] = log[name].clip(-0.99 * limit, 0.99 * limit)
        log.loc[at, name], reached[name] = share * limit, share * limit
    done = run(log)
    clipped = done.quality["faults"]["clipped_at"]
    found = {n: f["values"] for n, f in clipped.items() if f["rows"]}
    assert found == {name: [value] for name, value in reached.items()}
    ends = {n: [None, v] if v > 0 else [v, None] for n, v in reached.items()}
    assert done.quality["rails"] == ends == done.metadata["rails"]


def test_the_declared_full_scale_is_an_end_of_the_range(run):
    log = poses()
    most = log["gy"].abs().max()
    found = run(log, full_scale={"angular_rate": most / 0.99}).quality["rails"]
    assert found["gy"] == pytest.approx([-0.98 / 0.99 * most, 0.98 / 0.99 * most])
    assert not {"ax", "ay", "az"} & {*found}


@pytest.mark.parametrize("offset", [0, 32768])
def test_a_few_samples_at_the_end_of_sixteen_bits_are_clipped(run, offset):
    log, rates = simulated("multi_position", 3, poses=6), [*ANGULAR_RATE]
    log[rates] = (log[rates] / 1e-4).round()
    fastest = log.gx.abs().nlargest(18).index
    log.loc[fastest, "gx"] = np.where(log.gx[fastest] > 0, 32767, -32768)
    log[rates] += offset
    nominal = {"angular_rate": {"scale": 1e-4, "offset": offset}}
    [line] = run(log, units={"angular_rate": "count"}, nominal=nominal).quality["warnings"]
    assert line.startswith("clipped at a repeated extreme value: gx 18 samples")
    # the same values in SI: known by the step
    log[rates] = (log[rates] - offset) * 1e-4
    assert "gx 18 samples" in run(log).quality["warnings"][0]


@pytest.mark.parametrize(("end", "rate"), [(True, None), (False, 100), (True, 50)])
def test_packets_are_spread_where_samples_are_lost_or_the_sensor_pauses(run, end, rate):
    log = later((4000, 3.0))(in_packets(4, 0.3, 1e-4, end)(poses()))
    kept = log[np.random.default_rng(1).random(len(log)) > 0.01]
    done = run(kept, rate=rate)
    found = done.quality
    assert found["reasons"] == [] and found["duplicates"] == found["out_of_order"] == 0
    assert found["rows"] == len(kept)
    true = (kept.index.to_numpy() + 300 * (kept.index >= 4000)) / 100
    # a packet that lost a row is off by a step
    away = np.abs(done.samples.t - (true - true[0]))
    assert np.quantile(away, 0.97) < 0.002 and away.max() < 0.05
    assert any("s apart within each packet" in line for line in found["warnings"])
    assert not any("scale" in line for line in found["warnings"])


def test_figures_of_a_good_log_are_those_that_it_was_made_with(run, log):
    log["gx"] = np.round(log.gx / 0.00106) * 0.00106
    log.loc[100:, "t"] += 0.5
    whole = run(log).quality
    assert whole["duration_s"] == pytest.approx(5.49)
    assert whole["rate_hz"] == pytest.approx(100)
    assert whole["mean_specific_force"] == pytest.approx(9.8025, abs=2e-3)
    assert whole["quantisation_step"]["gx"] == pytest.approx(0.00106)


def test_every_row_is_counted_once(run, log):
    log["t"] = np.random.default_rng(1).permutation(log.t)
    log.loc[::7, "ax"] = np.nan
    log.loc[::5, "t"] = np.nan
    found = run(log, time_range=[0, 3]).quality
    parts = "rows outside_time_range non_finite duplicates out_of_order".split()
    assert sum(found[part] for part in parts) == found["rows_read"] == 500
    assert found["status"] == "rejected"
