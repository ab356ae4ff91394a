import json
import tracemalloc

import numpy as np
import pandas as pd
import pytest

from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.core.segments import segment_table
from imuloop.noise.allan import COLUMNS
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import Session
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import session_columns
from imuloop.segment.settings import SegmentSettings

SETTINGS = NoiseSettings()
DENSITY = dict(zip(CHANNELS, (0.01, 0.02, 0.03, 1e-3, 2e-3, 3e-3), strict=True))


def session(name="rest", kind="static", length=6000, rate=50.0, seed=0, rests=None, **columns):
    rng = np.random.default_rng(seed)
    samples = pd.DataFrame({"t": np.arange(length) / rate})
    for axis, density in DENSITY.items():
        samples[axis] = density * np.sqrt(rate) * rng.standard_normal(length)
    samples["az"] += 9.8
    samples = samples.assign(**columns)
    rests = [(0, length / rate)] if rests is None else rests
    start, end = zip(*rests, strict=True) if rests else ((), ())
    segments = segment_table(samples, start, end, ["static"] * len(rests), range(len(rests)))
    return Session(name, kind, samples, segments)


def test_white_density_of_each_axis():
    result = estimate_noise("imu", [session()], SETTINGS)
    for axis, density in DENSITY.items():
        assert result.model.axes[axis].N.value == pytest.approx(density, rel=0.05)
    assert result.sessions == ("rest",)


def test_sessions_pool_into_one_fit_and_keep_their_own_curves():
    sessions = [session("a", length=9000, seed=1), session("b", length=4000, seed=2)]
    both = estimate_noise("imu", sessions, SETTINGS)
    alone = estimate_noise("imu", sessions[1:], SETTINGS)
    width = [np.diff(r.model.axes["gx"].N.ci95)[0] for r in (both, alone)]
    assert width[0] == pytest.approx(width[1] * np.sqrt(4 / 13), rel=0.25)
    assert set(both.allan) == {"a", "b"}
    assert both.allan["a"]["tau_s"].max() == pytest.approx(60.0)
    pair = (pd.DataFrame(result.allan["b"]) for result in (both, alone))
    pd.testing.assert_frame_equal(*pair, rtol=1e-9)


def test_table_covers_the_model_and_has_the_contract_columns():
    table = pd.DataFrame(estimate_noise("imu", [session(length=20_000)], SETTINGS).allan["rest"])
    assert tuple(table.columns) == COLUMNS
    assert list(table["axis"].unique()) == list(CHANNELS)
    truth = table["axis"].map(DENSITY) / np.sqrt(table["tau_s"])
    inside = (table["ci_low"] <= truth) & (truth <= table["ci_high"])
    assert inside.mean() > 0.85


def test_a_knock_between_two_stretches_does_not_enter():
    knocked = session(length=6000, rests=[(0, 60), (62, 120)])
    knocked.samples.loc[3005:3090, "ax"] += 5.0
    knocked.samples.loc[3050:, "ax"] += 0.5
    result = estimate_noise("imu", [knocked], SETTINGS)
    assert result.model.axes["ax"].N.value == pytest.approx(0.01, rel=0.05)
    assert result.statistics["rest"]["ax"]["max"] < 0.5 + 5 * 0.01 * np.sqrt(50)


def gapped(gaps, kind="static", rate=50.0):
    """Return a session of 60 s, with gaps of so many seconds after so many."""
    samples = session(length=3000, rate=rate).samples
    t = samples["t"].to_numpy().copy()
    for after, seconds in gaps:
        t[round(after * rate) :] += seconds
    samples["t"] = t
    segments = session_columns(samples, kind, SegmentSettings())[0]
    return Session("rest", kind, samples, segments)


def coefficients(result):
    return [getattr(axis, name).upper95 for axis in result.model.axes.values() for name in "QNBKR"]


@pytest.mark.parametrize("kind", ["static", "multi_position"])
def test_what_lies_between_two_runs_costs_nothing_and_changes_nothing(kind):
    # an hour, a boot clock that meets GPS time, and that twice
    jumps = ([(15, 3600.0)], [(15, 1.7e9)], [(15, 1.7e9), (40, 1.7e9)])
    found, least = [], 0
    for gaps in jumps:
        given = gapped(gaps, kind)
        tracemalloc.start()
        found.append(estimate_noise("imu", [given], SETTINGS))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        least = least or peak
        assert peak < 1.5 * least
        assert sum("longer than all that was recorded" in note for note in found[-1].notes) == 1
    assert coefficients(found[1]) == pytest.approx(coefficients(found[0]), rel=1e-6)


def test_runs_are_sessions_of_their_own():
    whole = gapped([(15, 1.7e9)])
    parts = []
    for name, rows in (("a", slice(0, 750)), ("b", slice(750, None))):
        samples = whole.samples[rows].reset_index(drop=True)
        segments = session_columns(samples, "static", SegmentSettings())[0]
        parts.append(Session(name, "static", samples, segments))
    one, two = (estimate_noise("imu", sessions, SETTINGS) for sessions in ([whole], parts))
    assert coefficients(one) == pytest.approx(coefficients(two), rel=1e-5)


def test_a_log_that_is_mostly_gaps_keeps_its_walk_and_is_not_searched_for_lines():
    rng, rate = np.random.default_rng(2), 50.0
    # ten seconds each five minutes: no gap is longer than all that was recorded
    drift = np.cumsum(0.1 * rng.standard_normal(60)).repeat(500)
    samples = session(length=30_000, rate=rate).samples
    samples["t"] += 290.0 * (np.arange(30_000) // 500)
    samples["ax"] += drift
    segments = session_columns(samples, "static", SegmentSettings())[0]
    result = estimate_noise("imu", [Session("rest", "static", samples, segments)], SETTINGS)
    assert result.model.axes["ax"].K.value == pytest.approx(0.1 / np.sqrt(300), rel=0.3)
    assert any("no lines are sought" in note for note in result.notes)


def test_all_rests_stand_in_and_say_what_they_cannot_tell():
    poses = session("poses", "multi_position", rests=[(0, 40), (45, 50)])
    faces = session("faces", "six_position", rests=[(0, 20)])
    result = estimate_noise("imu", [faces, poses], SETTINGS)
    assert result.sessions == ("faces", "poses")
    assert "from all 3 rests, the longest of 40 s" in result.notes[0]
    assert result.allan["poses"]["tau_s"].max() == pytest.approx(40 / 3, rel=0.01)


def test_static_session_without_a_rest_is_left_out_with_a_note():
    result = estimate_noise("imu", [session("bad", rests=[]), session("good")], SETTINGS)
    assert result.sessions == ("good",)
    assert any("bad" in note for note in result.notes)
    assert not len(result.allan["bad"]["tau_s"])


@pytest.mark.parametrize("sessions", [[], [session(length=0, rests=[])]])
def test_nothing_to_use_is_a_result(sessions):
    result = estimate_noise("imu", sessions, SETTINGS)
    assert not any(axis.N.identifiable for axis in result.model.axes.values())
    assert not result.model.pose_mean_covariance([[0, 1]]).any()
    assert "no session holds a rest" in result.notes[-1]


def test_a_rest_of_ten_samples_is_a_result():
    result = estimate_noise("imu", [session(length=10)], SETTINGS)
    assert not result.model.axes["ax"].N.identifiable
    assert any("too few samples" in note for note in result.notes)
    assert len(result.allan["rest"]["tau_s"]) == 6 * 3


def test_constant_and_broken_channels_are_named():
    result = estimate_noise("imu", [session(gx=0.0, gy=np.nan)], SETTINGS)
    assert any("gx: output is constant" in note for note in result.notes)
    assert any("gy: values that are not finite" in note for note in result.notes)
    assert result.model.axes["gz"].N.identifiable
    json.dumps(result.to_dict()["axes"], allow_nan=False)


def test_another_rate_is_left_out_with_a_note():
    result = estimate_noise(
        "imu", [session("fast"), session("slow", length=500, rate=1.98)], SETTINGS
    )
    assert result.sessions == ("fast",)
    assert any("slow has 1.98 Hz" in note for note in result.notes)


def test_slow_log_with_temperature():
    result = estimate_noise(
        "imu",
        [session(length=8400, rate=1.98, temperature=np.linspace(-17.6, 74, 8400))],
        SETTINGS,
    )
    assert result.model.axes["gx"].N.value == pytest.approx(1e-3, rel=0.05)
    assert any("-17.6 to 74.0 degC" in note for note in result.notes)


def test_jitter_is_noted():
    rng = np.random.default_rng(4)
    t = np.arange(6000) / 50 + rng.uniform(-0.004, 0.004, 6000)
    result = estimate_noise("imu", [session(t=t)], SETTINGS)
    assert any("scatters by" in note for note in result.notes)


def test_noise_json_holds_the_model_and_the_rest(tmp_path):
    result = estimate_noise("imu", [session()], SETTINGS)
    result.to_json(tmp_path / "noise.json")
    assert NoiseModel.from_json(tmp_path / "noise.json") == result.model
    content = json.loads((tmp_path / "noise.json").read_text())
    assert set(content) == {
        *("format", "device", "axes", "rate_hz", "curve_fit", "spectrum", "uncut"),
        *("repeatability", "statistics", "sessions", "notes"),
    }
    assert content["statistics"]["rest"]["gz"]["std"] == pytest.approx(3e-3 * np.sqrt(50), rel=0.05)
