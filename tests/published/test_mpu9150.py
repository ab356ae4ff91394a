"""Three MPU-9150 boards against the table published with their logs; schemas of all devices."""

import numpy as np
import pytest

from published.conftest import BOARDS, DEVICES
from result_files import fault

# scale factor error in per cent as published, of the output against the truth: 1/K - 1
SCALE = {1: (0.363, 0.315, 0.647), 2: (0.471, 0.482, 0.932), 3: (0.382, 0.355, 0.780)}
# m/s^2
BIAS = {1: (0.103, 0.097, 0.344), 2: (0.090, 0.070, 0.338), 3: (0.096, 0.008, -0.045)}


@pytest.mark.parametrize("board", BOARDS)
def test_the_accelerometer_is_as_published_and_no_effect_is_added(measured_results, board):
    device = f"mpu9150_{board}"
    accelerometer = measured_results.json(device, "multi_position")["accelerometer"]
    scale = (1 / np.array(accelerometer["K"]) - 1) * 100
    np.testing.assert_allclose(scale, SCALE[board], atol=0.10)
    np.testing.assert_allclose(accelerometer["b"], BIAS[board], atol=0.015)
    for sensor in measured_results.json(device, "diagnosis")["sensors"].values():
        assert sensor["poses"]["effects"] == []


@pytest.mark.parametrize("device", DEVICES)
def test_every_json_file_of_a_measured_device_fits_its_schema(measured_results, device):
    paths = list(measured_results.of(device).rglob("*.json"))
    assert len(paths) > 5
    assert {str(p): wrong for p in paths if (wrong := fault(p))} == {}
