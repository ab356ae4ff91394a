"""The same formula in devices of a type: found together where none shows it alone."""

from functools import partial

import pytest

from bench.discover import device, problem_of, with_extra
from imuloop.discover.discover import discover
from imuloop.discover.family import discover_jointly, members_of, no_type
from imuloop.discover.searched import of_poses
from imuloop.report.composed import type_part

FIRST = 13070
# at rest they are one
NAMES = {"x: fy^2*fz", "y: fx*fy*fz", "z: fx*fy^2"}


def extra(channels, size):
    """Return f_y² f_z on x."""
    return (size * channels.output[:, 1] ** 2 * channels.output[:, 2])[:, None] * [1.0, 0.0, 0.0]


def problems(sizes):
    found = {}
    for k, size in enumerate(sizes):
        truth, noise = device("forty", FIRST + k)
        truth = with_extra(truth, "accelerometer", partial(extra, size=size))
        found[f"imu_{k}"] = (problem_of(truth, FIRST + k, "accelerometer", noise), ())
    return found


@pytest.fixture(scope="module")
def shared():
    """What four devices show of which the last has it not."""
    return discover_jointly(members_of(problems([4e-5, 5e-5, -5e-5, 0.0])), seed=0)


def test_a_formula_is_of_the_devices_that_have_it(shared):
    assert shared["status"] == "named" and shared["formula"] in NAMES
    assert NAMES <= {shared["formula"], *shared["imitators"]}
    assert [d["has"] for d in shared["devices"].values()] == [True, True, True, False]
    for size, own in zip([4e-5, 5e-5, -5e-5, 0.0], shared["devices"].values(), strict=True):
        (value,), (std,) = own["values"].values(), own["std"].values()
        # each of those that are one has its own sign and place
        assert abs(abs(value) - abs(size)) < 4 * std


def test_the_report_says_of_which_devices_it_holds(shared):
    labels = {name: name.replace("_", " ").upper() for name in shared["devices"]}
    sensors = {"accelerometer": {"why": None, **shared, "left_out": {"imu_9": "no poses"}}}
    part = type_part(no_type("MODEL", None) | {"sensors": sensors}, labels | {"imu_9": "IMU 9"})
    assert "It holds of IMU 0, IMU 1 and IMU 2." in part["texts"][0]
    assert part["texts"][1] == "Accelerometer of IMU 9: no poses"
    assert [row[2] for row in part["table"].rows] == ["yes", "yes", "yes", "no"]


def test_what_no_device_shows_alone_all_show_together():
    small = problems([1.1e-5] * 5)
    alone = [discover(of_poses(*each)).found.candidates for each in small.values()]
    together = discover_jointly(members_of(small), seed=0)
    assert sum(map(bool, alone)) <= 1 and together["status"] != "nothing"


def test_nothing_is_shared_where_nothing_is():
    found = discover_jointly(members_of(problems([0.0] * 3)), seed=0)
    assert found["status"] == "nothing" and not found["devices"] and found["chance"] > 0.01
