"""Units, time stamps and the one clock of a log: what a user gets for each kind of them."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core.samples import CHANNELS
from ingest.logs import brief

SIX = [*CHANNELS]


# --- time stamps as they are written


@pytest.mark.parametrize(("unit", "ticks"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_whole_stamps_lose_nothing_whenever_they_start(log, run, unit, ticks):
    steps = np.arange(500) * (ticks // 100) + np.arange(500) % 2
    # since a moment that only a drone knows, and in Unix time, of which float64 loses three digits
    for years, start in ((8, None), (50, "2019-12-20T00:00:00Z")):
        done = run(log.assign(t=years * 365 * 86400 * ticks + steps), units={"time": unit})
        np.testing.assert_allclose(done.samples.t, steps / ticks, rtol=0, atol=2e-15)
        assert done.metadata["start"] == start


MOMENTS = pd.Timestamp("2024-02-29T23:59:57") + pd.to_timedelta(np.arange(500) * 10, "ms")
START = "2024-02-29T23:59:57Z"


@pytest.mark.parametrize(
    ("form", "start"),
    [("%Y-%m-%dT%H:%M:%S.%f", START), ("%Y-%m-%d %H:%M:%S.%fZ", START),
     ("%Y-%m-%dT%H:%M:%S.%f000+01:00", "2024-02-29T22:59:57Z"),
     ("%d-%b-%Y %H:%M:%S.%f", START), ("%H:%M:%S.%f", None)],
)  # fmt: skip
def test_dates_and_times_of_the_day_are_stamps(log, run, form, start):
    log["t"] = MOMENTS.strftime(form)
    log.loc[[20, 30], "t"] = ["?", "9999-12-31T00:00:00" if form.startswith("%Y") else ""]
    done = run(log)
    kept = np.delete(np.arange(500), [20, 30])
    np.testing.assert_allclose(done.samples.t, kept / 100, rtol=0, atol=1e-11)
    assert (done.metadata["start"], done.quality["non_finite"]) == (start, 2)
    if start:
        assert len(run(log, time_range=[start[:17] + "59", None]).samples) == 300


def test_a_crop_in_seconds_is_half_open_and_starts_at_zero(log, run):
    log["t"] += 1000
    done = run(log, time_range=[1, 4])
    assert (done.quality["outside_time_range"], done.samples.t[0]) == (200, 0)
    assert done.samples.ax.tolist() == log.ax[100:400].tolist()
    reasons = run(log, time_range=[60, 70]).quality["reasons"]
    assert reasons == ["the log has 500 rows, and none of them lies in the time range"]
    # after a clock that starts again, of the time that goes on
    log["t"] = np.r_[log.t[:200], log.t[:300]]
    assert len(run(log, time_range=[2.05, None]).samples) == 300


def test_a_log_without_time_has_the_declared_rate(log, run):
    # a row that is dropped keeps its place in time
    log.loc[3, "ax"] = np.nan
    done = run(log.drop(columns="t"), rate=204.8)
    np.testing.assert_array_equal(done.samples.t, np.delete(np.arange(500), 3) * (1 / 204.8))
    # rows stamped by the declared rate say nothing of it
    assert done.quality["clock"]["drift_ppm"] is None


# --- stamps of a host: the sensor's rate, what is lost, and what is only late


def normal(std):
    return lambda t, rng: np.sort(t + rng.normal(0, std, len(t)))


def polled(interval):
    """A host asks at even intervals, as over USB."""
    return lambda t, rng: np.ceil(t / interval) * interval


def exponential(mean, share=0.0, long=0.0):
    """A delay of each transfer; a host that is busy now and then sends what waits at once."""
    return lambda t, rng: np.maximum.accumulate(
        t + rng.exponential(mean, len(t)) + (rng.random(len(t)) < share) * long
    )


def by_host(rate, seconds, delay=None, every=0, share=0.0, packet=1, spacing=0.0):
    """Return a log at rest of a sensor of some rate, Hz, and the numbers of its samples.

    `delay` takes times of packets, of so many samples, to those at which the host gets them, s.
    Lost are each n-th packet and a share of them at random, but for the first and the last ones.
    Rows of a packet are `spacing` s apart, or share a time stamp.
    """
    rng = np.random.default_rng(1 + bool(every or share))
    number = np.arange(int(rate * seconds) // packet)
    lost = (number % every == every // 2) if every else rng.random(len(number)) < share
    kept = number[~lost | (number < 1) | (number >= len(number) - 9)]
    arrived = ((number + 1) * packet - 1) / rate
    arrived = delay(arrived[kept], rng) if delay else arrived[kept]
    kept = (kept[:, None] * packet + np.arange(packet)).ravel()
    t = np.repeat(arrived, packet)
    if packet == 1 or spacing:
        # a host needs 20 us for a row
        busy = 2e-5 * np.arange(len(t))
        t = np.maximum.accumulate(t + spacing * (kept % packet) - busy) + busy
    log = brief(2).iloc[[0]].sample(len(kept), replace=True, random_state=0, ignore_index=True)
    log[SIX] += rng.normal(size=(len(kept), 6)) * ([0.02] * 3 + [0.002] * 3)
    return log.assign(t=np.round(t, 7)), kept


LATE = [(115, exponential(0.004)), (115, normal(0.0036)), (115, normal(0.006)),
        (115, exponential(0.001, 0.003, 0.12)), (52, exponential(0.008, 0.01, 0.3)),
        (208.3, exponential(0.007)), (104.4, polled(0.008)), (25.09, polled(0.03)),
        (401.5, polled(0.001))]  # fmt: skip
LOST = [(100, {"every": 40}), (52, {"every": 40, "delay": polled(0.001)}),
        (115, {"every": 10, "delay": normal(0.0017)}),
        (200, {"share": 0.02, "delay": normal(0.001)}),
        (208.3, {"every": 97, "delay": exponential(0.001)}),
        *((200, {**loss, "packet": 8, "spacing": spacing, "delay": delay})
          for loss in ({"every": 40}, {"share": 0.1}) for spacing in (0.0, 2e-4)
          for delay in (None, exponential(0.003)))]  # fmt: skip


@pytest.mark.parametrize(
    ("rate", "seconds", "more"),
    [*((rate, 23, {"delay": delay}) for rate, delay in LATE), *((r, 40, how) for r, how in LOST)],
)
def test_late_samples_are_told_from_lost_ones(run, rate, seconds, more):
    """Protects rate and gaps of a whole log, by which turns are measured.

    A delay of a host is no loss, whatever its distribution: half of such logs had hundreds of gaps.
    Regular losses are no slower sensor.
    """
    log, kept = by_host(rate, seconds, **more)
    done, lost = run(log), np.diff(kept) - 1
    assert done.quality["status"] == "ok", done.quality["reasons"]
    assert done.quality["rate_hz"] == pytest.approx(rate, rel=3e-3)
    gaps = done.quality["gaps"]
    assert gaps["count"] == pytest.approx(np.count_nonzero(lost), rel=0.03, abs=1)
    in_gaps = gaps["total_s"] - gaps["count"] / rate
    assert in_gaps == pytest.approx(lost.sum() / rate, rel=0.03, abs=1.5 / rate)
    if lost.any():
        # each row has the time of its sample
        away = done.samples.t - (kept - kept[0]) / rate
        assert np.quantile(np.abs(away - np.median(away)), 0.9) < 0.5 / rate


@pytest.mark.parametrize(
    ("name", "rate", "gaps", "length"),
    # of 1,500 packets in 60 s the first file holds 1,462
    [("every_40th_packet_of_8_lost", 200, 38, 0.045), ("packets_share_stamps", 99.9995, 0, 0.0)],
)
def test_packets_of_recordings(recordings, run, name, rate, gaps, length):
    quality = run(recordings(f"{name}.csv.gz")).quality
    assert quality["rate_hz"] == pytest.approx(rate, rel=1e-6)
    assert quality["gaps"]["count"] == gaps
    assert quality["gaps"]["total_s"] == pytest.approx(gaps * length)
