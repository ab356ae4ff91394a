import json

import numpy as np
import pandas as pd
import pytest

from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.core.segments import segment_table
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from loggers import lose

SETTINGS = NoiseSettings()
# square of K over N, 1/s^2
WALK = 2e-3
# what leaves a session the noise of ax alone
STILL = dict.fromkeys(CHANNELS[1:], 0.0)
DENSITY = dict(zip(CHANNELS, (0.01, 0.02, 0.03, 1e-3, 2e-3, 3e-3), strict=True))


def session(name="rest", kind="static", length=6000, rate=50.0, seed=0, rests=None, **columns):
    """Return a session of white noise; `columns` replace its columns, a number is a constant."""
    rng = np.random.default_rng(seed)
    samples = pd.DataFrame({"t": np.arange(length) / rate})
    for axis, density in DENSITY.items():
        samples[axis] = density * np.sqrt(rate) * rng.standard_normal(length)
    samples = samples.assign(**columns)
    rests = [(0, length / rate)] if rests is None else rests
    start, end = zip(*rests, strict=True) if rests else ((), ())
    segments = segment_table(samples, start, end, ["static"] * len(rests), range(len(rests)))
    return RecordedSession(name, kind, samples, segments)


def test_sessions_pool_into_one_fit():
    still = dict.fromkeys(CHANNELS[:5], 0.0)
    sessions = [session(n, length=k, seed=k, **still) for n, k in (("a", 9000), ("b", 4000))]
    both = estimate_noise("imu", sessions, SETTINGS)
    alone = estimate_noise("imu", sessions[1:], SETTINGS)
    width = [np.diff(r.model.axes["gz"].N.ci95)[0] for r in (both, alone)]
    assert width[0] == pytest.approx(width[1] * np.sqrt(4 / 13), rel=0.25)


def hours(seed):
    """Return 2,000 s at 50 Hz of white noise and walk, and 10 Hz in gx as high as its noise."""
    n = 100_000
    record = session(length=n, seed=seed)
    rng = np.random.default_rng([seed, 1])
    for axis, density in DENSITY.items():
        steps = rng.standard_normal(n) * density * np.sqrt(WALK / 50)
        record.samples[axis] += np.cumsum(steps)
    record.samples["gx"] += 1e-3 * np.sin(2 * np.pi * 10 * record.samples["t"])
    return record


def test_coefficients_hold_where_samples_are_missing():
    inside, walks, whole = [], [], hours(31)
    samples = lose(whole.samples, 0.01, np.random.default_rng(9), [1, 2, 3, 4, 5])
    segments = segment_table(samples, [0], [whole.samples["t"].max() + 0.02], ["static"], [0])
    result = estimate_noise("imu", [RecordedSession("rest", "static", samples, segments)], SETTINGS)
    for axis, density in DENSITY.items():
        noise = result.model.axes[axis]
        # of 100,000 samples N is known to 0.3 %
        assert noise.N.value == pytest.approx(density, rel=0.012)
        inside.append(noise.N.ci95[0] <= density <= noise.N.ci95[1])
        assert noise.K.identifiable
        walks.append(noise.K.ci95[0] <= density * np.sqrt(WALK) <= noise.K.ci95[1])
    assert np.mean(inside) >= 0.8 and np.mean(walks) >= 0.8
    (line,) = result.model.axes["gx"].sinusoid
    assert line.frequency.ci95[0] <= 10 <= line.frequency.ci95[1]
    assert line.amplitude.value == pytest.approx(1e-3, rel=0.05)
    assert "of the samples are missing, a few at a time" in result.notes[0]


def gapped(gaps, rate=50.0):
    samples = session(length=3000, rate=rate, **dict.fromkeys(CHANNELS[2:5], 0.0)).samples
    t = samples["t"].to_numpy().copy()
    for after, seconds in gaps:
        t[round(after * rate) :] += seconds
    samples["t"] = t
    segments = segment_session(samples, "static", SegmentSettings())[0]
    return RecordedSession("rest", "static", samples, segments)


def coefficients(result):
    noisy = [result.model.axes[axis] for axis in ("ax", "ay", "gz")]
    return [getattr(axis, name).upper95 for axis in noisy for name in "QNBKR"]


def test_what_lies_between_two_runs_costs_nothing_and_changes_nothing():
    # an hour, a boot clock that meets GPS time, and that twice
    jumps = ([(15, 3600.0)], [(15, 1.7e9)])
    # 1.7e9 s are 633 GiB of numbers
    results = [estimate_noise("imu", [gapped(gaps)], SETTINGS) for gaps in jumps]
    for result in results:
        assert sum("longer than all that was recorded" in note for note in result.notes) == 1
    assert coefficients(results[1]) == pytest.approx(coefficients(results[0]), rel=1e-6)


def test_a_log_that_is_mostly_gaps_keeps_its_walk_and_is_not_searched_for_lines():
    rng, rate = np.random.default_rng(2), 50.0
    # ten seconds each five minutes: no gap is longer than all that was recorded
    drift = np.cumsum(0.1 * rng.standard_normal(60)).repeat(500)
    samples = session(length=30_000, rate=rate, **STILL).samples
    samples["t"] += 290.0 * (np.arange(30_000) // 500)
    samples["ax"] += drift
    start = np.arange(60) * 300.0
    kinds = ["static", "gap"] * 60
    edges = np.column_stack([start, start + 10]).ravel()
    segments = segment_table(samples, edges[:-1], edges[1:], kinds[:-1], np.zeros(119))
    result = estimate_noise("imu", [RecordedSession("rest", "static", samples, segments)], SETTINGS)
    assert result.model.axes["ax"].K.value == pytest.approx(0.1 / np.sqrt(300), rel=0.3)
    assert any("no lines are sought" in note for note in result.notes)


def test_all_rests_stand_in_and_say_what_they_cannot_tell():
    poses = session("poses", "multi_position", rests=[(0, 40), (45, 50)], **STILL)
    faces = session("faces", "six_position", rests=[(0, 20)], **STILL)
    result = estimate_noise("imu", [faces, poses], SETTINGS)
    assert result.sessions == ("faces", "poses")
    assert "from all 3 rests, the longest of 40 s" in result.notes[0]


@pytest.mark.parametrize("sessions", [[], [session(length=0, rests=[])]])
def test_nothing_to_use_is_a_result(sessions):
    result = estimate_noise("imu", sessions, SETTINGS)
    assert not any(axis.N.identifiable for axis in result.model.axes.values())
    assert not result.model.mean_covariance([[0, 1]]).any()
    assert "no session holds a rest" in result.notes[-1]


def test_what_a_reader_must_know_is_noted():
    t = np.arange(6000) / 50 + np.random.default_rng(4).uniform(-0.004, 0.004, 6000)
    sessions = [
        session("bad", rests=[], **STILL),
        session(t=t, temperature=np.linspace(-17.6, 74, 6000), **STILL),
        session("slow", length=500, rate=1.98, **STILL),
    ]
    result = estimate_noise("imu", sessions, SETTINGS)
    assert result.sessions == ("rest",)
    for note in ("bad holds no rest", "slow has 1.98 Hz", "-17.6 to 74.0 degC"):
        assert any(note in line for line in result.notes)


def test_constant_and_broken_channels_are_named():
    result = estimate_noise("imu", [session(**STILL | {"gy": np.nan})], SETTINGS)
    assert any("gx: output is constant" in note for note in result.notes)
    assert any("gy: values that are not finite" in note for note in result.notes)
    assert result.model.axes["ax"].N.identifiable
    json.dumps(result.to_dict()["axes"], allow_nan=False)


@pytest.mark.parametrize("size", [1e38, 1e-30])
def test_output_of_any_size_is_a_result(size):
    rng = np.random.default_rng(5)
    output = np.sin(np.arange(6000) / 7) + 0.1 * rng.standard_normal(6000)
    sessions = [session(**STILL | {"ax": x}) for x in (output, size * output)]
    one, other = (estimate_noise("imu", [one_session], SETTINGS) for one_session in sessions)
    fitted, expected = other.model.axes["ax"], one.model.axes["ax"]
    assert fitted.N.value == pytest.approx(size * expected.N.value, rel=1e-6)
    assert len(fitted.sinusoid) == len(expected.sinusoid) == 1


def test_noise_json_holds_the_model_and_the_rest(tmp_path):
    result = estimate_noise("imu", [session(**STILL)], SETTINGS)
    result.to_json(tmp_path / "noise.json")
    assert NoiseModel.from_json(tmp_path / "noise.json") == result.model
    content = json.loads((tmp_path / "noise.json").read_text())
    assert set(content) == {
        *("format", "device", "axes", "rate_hz", "rates_hz", "spectrum"),
        *("statistics", "sessions", "notes"),
    }
    assert content["statistics"]["rest"]["ax"]["std"] == pytest.approx(0.01 * np.sqrt(50), rel=0.05)
