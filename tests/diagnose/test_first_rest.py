"""What the first rest of a log of poses shows is not imposed on them: they judge for themselves."""

import json
from dataclasses import replace

import pytest

from diagnose.test_search import with_effect
from imuloop.__main__ import main
from imuloop.core.effect import find_effect
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import SessionTruth, Thermometer

# it warms in the first rest already
KNOTS = ((0, 24), (60, 34), (170, 38), (260, 38), (420, 27), (470, 27), (590, 34), (900, 34))
PLAN = SessionTruth(
    "multi_position",
    poses=40,
    rest_s=(4.0, 8.0),
    temperature=KNOTS,
    thermal_s=15.0,
    initial_rest_s=60.0,
)


@pytest.mark.parametrize(
    ("sensor", "name", "size"),
    [("accelerometer", "scale_temperature", 4e-4), ("gyroscope", "bias_temperature", 3e-4)],
)
def test_an_effect_that_the_first_rest_shows_too_is_that_of_the_poses(
    tmp_path, no_limits, sensor, name, size
):
    truth = replace(
        with_effect(sensor, find_effect(name)(), [size] * 3),
        sessions={"multi_position": PLAN},
        thermometer=Thermometer(noise=0.02, step=0.01),
    )
    log, keep, report = (tmp_path / n for n in ("poses.csv", "keep", "report.html"))
    write_log(log, simulate_session(truth, "multi_position", 1), {})
    words = ["report", f"multi_position={log}", "-o", str(report), "--keep", str(keep)]
    assert main(words) in (0, None)
    diagnosis = json.loads((keep / "diagnosis.json").read_text())
    found = [e["name"] for e in diagnosis["sensors"][sensor]["poses"]["effects"]]
    assert found == [name]
    calibration = json.loads((keep / "calibration.json").read_text())
    (held,) = calibration[sensor]["effects"]
    # slow noise that a log of minutes cannot show makes standard errors too small: the size counts
    assert list(held["parameters"].values()) == pytest.approx([size] * 3, rel=0.2)
