"""What a long job says on its way."""

import logging

from imuloop.job_log import progress_lines


def test_a_long_job_says_how_far_it_is(caplog, capsys):
    now = [100.0]
    caplog.set_level(logging.INFO)
    progress = progress_lines("imu/still", seconds=10, clock=lambda: now[0])
    for now[0] in range(100, 133):
        progress("read", (now[0] - 100) * 10**8, 10**10)
    progress("measured", 0, 10**10)
    for now[0] in range(133, 150):
        progress("measured", (now[0] - 132) * 5 * 10**8, 10**10)
    assert caplog.messages == [
        "imu/still: read 1.0 of 10.0 GB, 100 MB/s, 90 s left",
        "imu/still: read 2.0 of 10.0 GB, 100 MB/s, 80 s left",
        "imu/still: read 3.0 of 10.0 GB, 100 MB/s, 70 s left",
        "imu/still: measured 5.0 of 10.0 GB, 500 MB/s, 10 s left",
    ]
