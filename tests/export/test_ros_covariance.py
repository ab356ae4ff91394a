"""The covariances of ROS' message, as a driver would copy them."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from export.devices import HOSTILE, RATE, N, device, unknown
from imuloop.core.errors import Lacking
from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.export.ros_covariance import text


def test_the_variance_of_white_noise_at_that_rate():
    content = yaml.safe_load(text(device()))
    for key, axes in (
        ("linear_acceleration_covariance", ACCELERATION),
        ("angular_velocity_covariance", ANGULAR_RATE),
    ):
        matrix = np.array(content[key]).reshape(3, 3)
        assert np.count_nonzero(matrix) == 3
        # white noise of density N has this variance in samples that are means over 1/rate
        np.testing.assert_allclose(np.diag(matrix), [N[a] ** 2 * RATE for a in axes], rtol=1e-15)
    assert content["orientation_covariance"] == [-1.0] + [0.0] * 8


def test_white_noise_that_was_not_seen_is_said_to_be_a_limit():
    board = device()
    axes = board.noise.axes | {"gy": AxisNoise(N=Coefficient(upper95=1e-5))}
    written = text(replace(board, noise=replace(board.noise, axes=axes)))
    line = next(x for x in written.splitlines() if x.startswith("angular"))
    assert line.endswith("# (rad/s)^2; gy, not seen: its 95 % upper limit")


def test_a_label_adds_nothing():
    assert yaml.safe_load(text(device(HOSTILE))) == yaml.safe_load(text(device()))


def test_no_file_without_noise_or_rate():
    with pytest.raises(Lacking, match="rate"):
        text(replace(device(), rate_hz=None))
    with pytest.raises(Lacking, match="noise"):
        text(replace(unknown(), rate_hz=100.0))
