"""A measured log, harmed as a logger would: a report of it, and a verdict that its data bear."""

import json
import math

import numpy as np
import pytest

from imuloop.__main__ import main
from segment.logs import xsens

GRAVITY = 9.81744
F, W = ["ax", "ay", "az"], ["gx", "gy", "gz"]


def midway(log, channels, change):
    late = log.t > log.t.iloc[-1] / 2
    log.loc[late, channels] = change(log.loc[late, channels])


def wrapped(size):
    """Return what integers make of more than `size`, m/s^2."""

    def harm(log):
        log[F] = (log[F] + size) % (2 * size) - size

    return harm


def clipped(channels, size):
    def harm(log):
        log[channels] = log[channels].clip(-size, size)

    return harm


NOTHING, OPEN = "not_testable", "unexplained"
# what became of the log; verdicts on accelerometer and gyroscope
HARMS = {
    # the gyroscope's own g-sensitivity is found all the same
    "accelerometer clipped": (clipped(F, 1.05 * GRAVITY), OPEN, "partly_explained"),
    "gyroscope clipped": (clipped(W, 1.5), "consistent", NOTHING),
    "scale halves": (lambda log: midway(log, F, lambda f: f / 2), NOTHING, NOTHING),
    "offset jumps": (lambda log: midway(log, F, lambda f: f + 5), NOTHING, NOTHING),
    "wrapped at 5": (wrapped(5.0), NOTHING, NOTHING),
    "wrapped at 7": (wrapped(7.0), NOTHING, NOTHING),
    "wrapped at 8.5": (wrapped(8.5), NOTHING, NOTHING),
}


def finite(content):
    """Return whether every number of a JSON file is one."""
    if isinstance(content, dict):
        content = list(content.values())
    if isinstance(content, list):
        return all(map(finite, content))
    return not isinstance(content, float) or math.isfinite(content)


@pytest.mark.parametrize(("harm", "force", "turn"), HARMS.values(), ids=HARMS.keys())
def test_a_verdict_that_the_data_bear(recordings, tmp_path, harm, force, turn):
    log = xsens(recordings)
    harm(log)
    log.to_parquet(tmp_path / "log.parquet", index=False)
    page, kept = tmp_path / "report.html", tmp_path / "kept"
    words = ["report", str(tmp_path / "log.parquet"), "-o", str(page), "--keep", str(kept)]
    assert main([*words, "--gravity", str(GRAVITY)]) == 0
    assert "</html>" in page.read_text()
    for path in kept.rglob("*.json"):
        assert finite(json.loads(path.read_text())), path
    diagnosis = json.loads((kept / "diagnosis.json").read_text())
    assert "failed" not in diagnosis
    found = diagnosis["sensors"]
    calibration = json.loads((kept / "calibration.json").read_text())
    for sensor, verdict in (("accelerometer", force), ("gyroscope", turn)):
        poses = found[sensor]["poses"]
        assert poses["verdict"] == verdict
        assert bool(poses["effects"]) == (verdict == "partly_explained")
        if verdict == NOTHING:
            assert poses["why"]
            # what nothing is known of is passed on as it was
            assert calibration[sensor]["T"] == np.eye(3).tolist()
        else:
            assert all(r["chi2_before"] > 0 for r in poses["residuals"].values())
