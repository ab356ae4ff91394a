"""A measured log, harmed as a logger would: a report of it, and a verdict that its data bear."""

import json

import numpy as np
import pytest

from imuloop.__main__ import main
from segment.logs import xsens

GRAVITY = 9.81744
F, W = ["ax", "ay", "az"], ["gx", "gy", "gz"]


def halved(log):
    log.loc[log.t > log.t.iloc[-1] / 2, F] /= 2


def shifted(log):
    log.loc[log.t > log.t.iloc[-1] / 2, F] += 5


def wrapped(log):
    """What integers make of more than 7 m/s^2."""
    log[F] = (log[F] + 7) % 14 - 7


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
    "scale halves": (halved, NOTHING, NOTHING),
    "offset jumps": (shifted, NOTHING, NOTHING),
    "wrapped": (wrapped, NOTHING, NOTHING),
}


@pytest.mark.parametrize(("harm", "force", "turn"), HARMS.values(), ids=HARMS.keys())
def test_a_verdict_that_the_data_bear(recordings, tmp_path, no_limits, harm, force, turn):
    log = xsens(recordings)
    harm(log)
    log.to_parquet(tmp_path / "log.parquet", index=False)
    page, kept = tmp_path / "report.html", tmp_path / "kept"
    words = ["report", str(tmp_path / "log.parquet"), "-o", str(page), "--keep", str(kept)]
    assert main([*words, "--gravity", str(GRAVITY)]) == 0
    assert "</html>" in page.read_text()
    for path in kept.rglob("*.json"):
        assert not {"NaN", "Infinity"} & set(path.read_text().replace(",", " ").split()), path
    diagnosis = json.loads((kept / "diagnosis.json").read_text())
    assert "failed" not in diagnosis
    calibration = json.loads((kept / "calibration.json").read_text())
    for sensor, verdict in (("accelerometer", force), ("gyroscope", turn)):
        poses = diagnosis["sensors"][sensor]["poses"]
        assert poses["verdict"] == verdict
        assert bool(poses["effects"]) == (verdict == "partly_explained")
        if verdict == NOTHING:
            assert poses["why"]
            # what nothing is known of is passed on as it was
            assert calibration[sensor]["T"] == np.eye(3).tolist()
        else:
            assert all(r["chi2_before"] > 0 for r in poses["residuals"].values())
