"""Stamps whose unit nobody declared: what shows that they are no seconds."""

import numpy as np
import pytest

from imuloop.core.samples import ANGULAR_RATE, Samples
from imuloop.core.units import DEGREE
from imuloop.ingest.stamps import NANOSECONDS
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from ingest.logs import example_truth, poses, simulated


def in_units(log, rate, unit):
    """Return a log with whole stamps in a unit."""
    ticks = 1e9 / NANOSECONDS[unit] / rate
    return log.assign(t=np.rint(np.arange(len(log)) * ticks).astype(int))


@pytest.mark.parametrize("kind", ["multi_position", "static"])
@pytest.mark.parametrize(
    ("rate", "unit"), [(50.0, "ms"), (100.0, "ms"), (400.0, "ms"), (100.0, "us"), (100.0, "ns")]
)
def test_stamps_that_are_no_seconds_are_rejected_with_their_unit(run, kind, rate, unit):
    """Protects logs whose unit nobody declared: they ran through, or died later, at 0.1 Hz."""
    changed = {"poses": 6} if kind == "multi_position" else {"duration_s": 30.0}
    log = in_units(simulated(kind, 3, example_truth(rate=rate), **changed), rate, unit)
    found = run(log, kind=kind).quality
    assert (found["status"], len(found["reasons"])) == ("rejected", 1)
    [reason] = found["reasons"]
    for remedy in (f"units.time: {unit}", f"--time-unit {unit}", f"units={{'time': '{unit}'}}"):
        assert remedy in reason
    if unit == "ms" and kind == "multi_position":
        assert "1,000 times those of gravity" in reason
    assert run(log, kind=kind, units={"time": unit}).quality["reasons"] == []


def test_turns_alone_show_milliseconds(run):
    """Protects stamps that are not whole, at 1 kHz, and with turns in deg/s."""
    log = simulated("multi_position", 3, example_truth(rate=1000.0), poses=4)
    found = run(log.assign(t=np.arange(len(log)) + 0.4321)).quality
    assert "milliseconds" in found["reasons"][0]
    log = poses()
    log[[*ANGULAR_RATE]] /= DEGREE
    assert "57,000 times" in run(log.assign(t=log.t * 1e3 + 0.1)).quality["reasons"][-1]


@pytest.mark.parametrize(
    ("rate", "kind", "declared"),
    [
        (1.0, "static", {}),
        (2.0, "multi_position", {}),
        (10.0, "multi_position", {}),
        (0.1, "static", {"units": {"time": "s"}}),
        (0.1, "static", {"rate": 0.1}),
    ],
)
def test_seconds_stay_seconds(run, rate, kind, declared):
    changed = {"poses": 8} if kind == "multi_position" else {"duration_s": 300 / rate}
    log = simulated(kind, 3, example_truth(rate=rate), **changed)
    found = run(log.assign(t=np.arange(len(log)) / rate), kind=kind, **declared).quality
    assert found["reasons"] == []
    assert found["rate_hz"] == pytest.approx(rate)


def test_seconds_that_are_declared_are_believed_by_what_follows(run):
    """Protects slow logs: a sample longer than a part of a rest ended in an IndexError."""
    log = poses(50.0)
    done = run(log.assign(t=20.0 * np.arange(len(log))), units={"time": "s"})
    assert done.quality["reasons"] == []
    segments, _ = segment_session(Samples(done.path), "multi_position", SegmentSettings())
    assert len(segments)


def test_unix_time_in_seconds_stays_so(run):
    log = simulated("static", 3, example_truth(rate=0.2), duration_s=1500.0)
    found = run(in_units(log, 0.2, "s").assign(t=lambda x: x.t + 1_700_000_000)).quality
    assert found["reasons"] == []
