"""What the first rest of a log of poses shows is not imposed on them: they judge for themselves."""

from dataclasses import replace

import pytest

from bench.study.chain import diagnosis_of
from diagnose.test_search import with_effect
from imuloop.core.files import read_json
from imuloop.model.effect import find_effect
from imuloop.simulate.truth import SessionTruth, Thermometer, example_truth

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
EFFECTS = {"accelerometer": ("scale_temperature", 4e-4), "gyroscope": ("bias_temperature", 3e-4)}


@pytest.mark.study
def test_an_effect_that_the_first_rest_shows_too_is_that_of_the_poses():
    changed = {
        sensor: getattr(with_effect(sensor, find_effect(name)(), [size] * 3), sensor)
        for sensor, (name, size) in EFFECTS.items()
    }
    warm = {"sessions": {"multi_position": PLAN}, "thermometer": Thermometer(noise=0.02, step=0.01)}
    diagnosis, calibration = diagnosis_of(
        replace(example_truth(), **changed, **warm),
        seed=1,
        also=lambda truth, sessions, folder: read_json(folder / "calibration.json"),
        limits=False,
    )
    for sensor, (name, size) in EFFECTS.items():
        found = diagnosis["sensors"][sensor]["poses"]["effects"]
        assert [effect["name"] for effect in found] == [name]
        (held,) = calibration[sensor]["effects"]
        # slow noise that a log of minutes cannot show makes standard errors too small: the size
        # counts
        assert list(held["parameters"].values()) == pytest.approx([size] * 3, rel=0.2)
