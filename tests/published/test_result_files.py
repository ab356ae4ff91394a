"""Every JSON file of the measured recordings fits its schema."""

import pytest

from bench.result_files import fault
from published.conftest import DEVICES


@pytest.mark.parametrize("device", DEVICES)
def test_every_json_file_of_a_measured_device_fits_its_schema(measured, device):
    paths = list(measured.of(device).rglob("*.json"))
    assert len(paths) > 5
    assert {str(p): wrong for p in paths if (wrong := fault(p))} == {}
