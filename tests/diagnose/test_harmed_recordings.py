"""A measured log, harmed as a logger would: a verdict that its data bear."""

import numpy as np
import pytest

from imuloop.core.files import read_json
from quick import diagnose_log
from result_files import fault
from segment.logs import static_log, xsens

GRAVITY = 9.81744
F, W = ["ax", "ay", "az"], ["gx", "gy", "gz"]


def halve_end(log):
    log.loc[log.t > log.t.iloc[-1] / 2, F] /= 2


def clip(channels, size):
    def harm(log):
        log[channels] = log[channels].clip(-size, size)

    return harm


NOTHING = "not_testable"


@pytest.mark.study
@pytest.mark.parametrize(
    ("harm", "force", "turn"),
    [
        # 7 of 38 rests are left out; verdicts are as for the whole log
        (clip(F, 1.05 * GRAVITY), "consistent", "explained"),
        (clip(W, 1.5), "consistent", NOTHING),
        (halve_end, NOTHING, NOTHING),
    ],
    ids=["accelerometer clipped", "gyroscope clipped", "scale halves"],
)
def test_a_verdict_that_the_data_bear(recordings, tmp_path, harm, force, turn):
    log = xsens(recordings)
    harm(log)
    diagnosis = diagnose_log(tmp_path, log, gravity=GRAVITY)
    assert {str(p): wrong for p in tmp_path.rglob("*.json") if (wrong := fault(p))} == {}
    calibration = read_json(tmp_path / "calibration.json")
    for sensor, verdict in (("accelerometer", force), ("gyroscope", turn)):
        poses = diagnosis[sensor]["poses"]
        assert poses["verdict"] == verdict
        effects = [effect["name"] for effect in poses["effects"]]
        assert effects == ["g_sensitivity"] * (verdict == "explained")
        if verdict == NOTHING:
            assert poses["why"]
            # a sensor without a calibration is passed on as it was
            assert calibration[sensor]["T"] == np.eye(3).tolist()
        else:
            assert all(r["chi2_before"] > 0 for r in poses["residuals"].values())


def test_a_log_that_is_rejected_is_no_device_without_it(tmp_path):
    """Protects several logs: figures of two of three trials were taken for figures of all."""
    log = static_log(1, 1000)
    log[F] = 1.0
    with pytest.raises(
        RuntimeError, match=r"^imu/log was rejected: the acceleration never changes"
    ):
        diagnose_log(tmp_path, log)
