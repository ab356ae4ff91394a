"""Where one residual stands for a verdict, it is the one that the effects lowered most."""

import json
import re
import shutil

import pytest

from imuloop.chain import Device
from imuloop.core.files import write_json
from imuloop.report.pictures import OF_RECORD
from imuloop.report.section import write_section
from imuloop.result import Result
from quick import DRAW, write_blank
from report.build import joined_report
from report.plausible_diagnosis import residual
from report.plausible_results import DEVICES

# held-out errors before and after, and floor, SI
STAYS, FELL = (19.6e-3, 19.6e-3, 18e-3), (2e-3, 2e-4, 1.8e-4)
ACROSS, DOWN = (236e-3, 13.6e-3, 12e-3), (7.55e-3, 7.70e-3, 7e-3)
# by record: the residuals, what the verdict says, and how the gain ends
RECORDS = {
    "poses": (
        {"pose_rate": ("rad/s", *FELL), "rotation": ("rad", *STAYS)},
        "angular rate left at rest, held-out root mean square falls from 0.115 °/s to 0.0115 °/s",
        "to 0.011 °/s, 10 times less",
    ),
    "motion": (
        {"velocity_vertical": ("m/s", *DOWN), "velocity_horizontal": ("m/s", *ACROSS)},
        "velocity at the end of a move, held-out root mean square falls from 236 mm/s to 13.6 mm/s",
        "to 14 mm/s, 17 times less",
    ),
}


@pytest.fixture(scope="module")
def told(results, tmp_path_factory):
    """The report's folder, and the result, of a device with an effect in poses and in motion."""
    folder = tmp_path_factory.mktemp("quoted")
    shutil.copytree(results / "board", folder / "board")
    path, (label, kinds) = folder / "board/diagnosis.json", DEVICES["board"]
    found = json.loads(path.read_text())
    turn = found["sensors"]["gyroscope"]
    turn["motion"] = dict(turn["poses"])
    for part, (residuals, *_) in RECORDS.items():
        turn[part]["residuals"] = {name: residual(*sizes) for name, sizes in residuals.items()}
    delay = {"name": "gyro_axis_delay", "residual": "velocity_horizontal"}
    turn["motion"]["effects"] = [turn["poses"]["effects"][0] | delay]
    found["sensors"]["accelerometer"]["motion"] = turn["motion"] | {"effects": []}
    write_json(path, found)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DRAW, write_blank)
        patch.setattr("imuloop.report.section.OF_RECORD", dict.fromkeys(OF_RECORD, lambda *_: []))
        write_section("board", label, folder / "board", kinds)
        joined_report(folder, ["board"], folder)
    return folder, Result(Device("board", folder / "board", kinds))


@pytest.mark.parametrize("part", RECORDS)
def test_the_residual_that_fell_most_stands_for_a_verdict(told, part):
    """Protects users from a verdict “explained” with a residual that stays as it was."""
    (folder, result), (_, verdict, gain) = told, RECORDS[part]
    page = re.sub(r"\s+", " ", (folder / "report.html").read_text())
    assert verdict in page and verdict in re.sub(r"\s+", " ", str(result))
    card = json.loads((folder / "board/summary.json").read_text())["card"]
    said = re.sub(r"\s+", " ", card["gain"])
    assert gain in said
    # what stays is no gain
    assert "1.1°" not in said and "7.7 mm/s" not in said
