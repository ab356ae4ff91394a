"""What a host's stamps say: the sensor's rate, what is lost, and what is only late."""

import numpy as np
import pytest

from ingest.hosts import at_random, every, exponential, normal, polled, stalls, stamped

NO_LOSS = "no sample is lost"


def check(found, rate, kept):
    """Check rate, gaps and what is said of losses against the numbers of the samples."""
    lost = np.diff(kept) - 1
    assert found["status"] == "ok", found["reasons"]
    assert found["rate_hz"] == pytest.approx(rate, rel=3e-3)
    count = found["gaps"]["count"]
    assert count == pytest.approx(np.count_nonzero(lost), rel=0.03, abs=1)
    in_gaps = found["gaps"]["total_s"] - count / rate
    assert in_gaps == pytest.approx(lost.sum() / rate, rel=0.03, abs=1.5 / rate)
    if lost.any():
        assert NO_LOSS not in str(found["warnings"])


@pytest.mark.parametrize(
    ("rate", "delay"),
    [
        (115, exponential(0.004)),
        (115, normal(0.0036)),
        (115, normal(0.006)),
        (115, stalls(0.001, 0.003, 0.12)),
        (52, stalls(0.008, 0.01, 0.3)),
        (208.3, exponential(0.007)),
        (104.4, polled(0.008)),
        (25.09, polled(0.03)),
        (401.5, polled(0.001)),
    ],
)
def test_rows_that_are_late_are_not_lost(run, rate, delay):
    """Protects the rate of the whole log: a delay of a host is no loss, whatever its distribution.

    Half of these logs had hundreds of gaps.
    """
    log, kept = stamped(rate, 23, 1, delay=delay)
    check(run(log).quality, rate, kept)


@pytest.mark.parametrize(
    ("rate", "more"),
    [
        (100, {"loss": every(40)}),
        (52, {"loss": every(40), "delay": polled(0.001)}),
        (115, {"loss": every(10), "delay": normal(0.0017)}),
        (208.3, {"loss": every(97), "delay": exponential(0.001)}),
        (200, {"loss": at_random(0.02), "delay": normal(0.001)}),
        *(
            (200, {"loss": loss, "packet": 8, "spacing": spacing, "delay": delay})
            for loss in (every(40, 8), at_random(0.1, 8))
            for spacing in (0.0, 2e-4)
            for delay in (None, exponential(0.003))
        ),
    ],
)
def test_what_is_lost_is_found_among_what_is_late(run, rate, more):
    """Protects rate and gaps of losses: regular ones were taken for a slower sensor.

    That was said to be complete, and its turns were too small.
    """
    log, kept = stamped(rate, 40, 2, **more)
    done = run(log)
    check(done.quality, rate, kept)
    # and each row has the time of its sample
    away = done.samples.t - (kept - kept[0]) / rate
    assert np.quantile(np.abs(away - np.median(away)), 0.9) < 0.5 / rate


def test_a_log_with_every_40th_packet_lost(recordings, run):
    found = run(recordings("every_40th_packet_of_8_lost.csv.gz")).quality
    assert found["rate_hz"] == pytest.approx(200, rel=1e-6)
    gaps = found["gaps"]
    # of 1,500 packets in 60 s the file holds 1,462
    assert gaps["count"] == 38
    assert gaps["total_s"] / gaps["count"] - 1 / 200 == pytest.approx(0.04)
