"""The search beyond the library on measured data: it finds what is taken out, and no more."""

import pytest

from imuloop.calibrate.calibrate import start_pair
from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import find_effect
from imuloop.core.samples import SENSORS
from imuloop.diagnose.records.pose_diagnosis import pose_problem
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.discover.discovery import discover
from imuloop.discover.search_input import of_poses


def problem(measured, device):
    recording, noise, base = measured.fit_of(device)
    units = {sensor: getattr(base, sensor).raw_unit for sensor in SENSORS}
    pair, _ = start_pair(recording, noise, base.gravity, units, CalibrateSettings())
    return pose_problem(pair, recording, DiagnoseSettings(), 30, sensors=("gyroscope",))


@pytest.mark.study
def test_g_sensitivity_is_found_where_no_library_has_it(measured):
    found = discover(of_poses(problem(measured, "xsens_mti"), (), "gyroscope"))
    terms = {f"{axis}: f{other}" for axis in "xyz" for other in "xyz"}
    assert set(found.effect.formula.split("; ")) == terms and not found.selection.imitators
    # held out, the whole search in each part; as good as with the effect known
    assert found.kinds["pose_rate"]["ratio"] <= 0.25
    assert found.kinds["rotation"]["ratio"] <= 0.29


@pytest.mark.parametrize(
    ("device", "base"),
    [
        pytest.param("xsens_mti", ("g_sensitivity",), marks=pytest.mark.study),
        ("mpu9150_1", ()),
        *(pytest.param(f"mpu9150_{k}", (), marks=pytest.mark.study) for k in (2, 3)),
    ],
)
def test_nothing_more_is_found(measured, device, base):
    effects = tuple(OfSensor(find_effect(name)(), "gyroscope") for name in base)
    searched = of_poses(problem(measured, device), effects, "gyroscope")
    assert not discover(searched).selection.candidates
