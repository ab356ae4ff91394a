"""Products of outputs: named where no effect with a cause explains a record, and not tried else."""

from unittest.mock import patch

import numpy as np
import pytest

from bench.study import physics
from bench.study.chain import diagnosis_of
from bench.study.devices import Injected, motion_device, poses_device, with_effects
from calibrate.devices import plan_session, recording
from diagnose.models import pose_result
from imuloop.core.errors import ImuloopError
from imuloop.effects.products import products
from imuloop.model.effect import FittedEffect

# of sizes of about three detection limits
SIZES = {"f_y² f_z": 5e-5, "f_x f_y f_z": 5e-5, "θ f_x": 2e-4, "w_x f_y": 2e-4, "w_x w_z f_y": 4e-4}
QUICK = ("f_y² f_z",)
SEED = 7


def device(formula=""):
    truth = plan_session(poses_device("few"))
    if formula:
        sensor, *_ = physics.PRODUCTS[formula]
        extra = physics.product(formula, SIZES[formula])
        truth = with_effects(truth, [Injected(sensor, "product", extra=extra)])
    return truth, recording(truth, SEED)


@pytest.mark.usefixtures("no_limits")
@pytest.mark.parametrize(
    "formula",
    [f if f in QUICK else pytest.param(f, marks=pytest.mark.study) for f in physics.PRODUCTS],
)
def test_a_product_is_named_by_its_formula(formula):
    sensor, axis, _ = physics.PRODUCTS[formula]
    found = pose_result(*device(formula), tests=30, folds=6)
    (effect,) = found.contents[sensor]["effects"]
    assert (effect["name"], effect["constants"]["formula"]) == ("product", formula)
    assert effect["constants"]["axis"] == axis and found.contents[sensor]["verdict"] == "explained"
    error = effect["parameters"][f"c{axis}"] - SIZES[formula]
    assert abs(error) < 4 * effect["std"][f"c{axis}"]
    (other,) = {"accelerometer", "gyroscope"} - {sensor}
    assert found.contents[other]["effects"] == []


@pytest.mark.usefixtures("no_limits")
def test_a_record_at_its_floor_is_not_searched_for_products():
    where = "imuloop.diagnose.poses.products"
    with patch(where, side_effect=AssertionError("it was searched")):
        found = pose_result(*device(), tests=30, folds=6)
    for content in found.contents.values():
        assert content["verdict"] == "consistent"
        assert "product" not in {c["name"] for c in content["candidates"]}


def test_products_are_all_up_to_degree_three_but_for_the_base_model():
    formulas = [p.formula for p in products("accelerometer", "f", 30.0) if p.axis == "x"]
    # 6 squares, 10 cubes, and with the temperature 3 and 6
    assert len(formulas) == len(set(formulas)) == 25
    assert {"f_x²", "f_x f_y f_z", "θ f_z", "θ f_y²"} <= set(formulas) and "f_x" not in formulas
    formulas = [p.formula for p in products("gyroscope", "wf") if p.axis == "z"]
    assert {"f_x", "w_x f_y", "w_x w_z f_y"} <= set(formulas) and not {"w_x", "θ"} & set(formulas)


WRONG = [{"formula": f} for f in ("f_y² f_z²", "θ f_x θ", "g_x f_y", "", 3)]


@pytest.mark.parametrize("constants", [*WRONG, {"axis": "xy"}, {"sensor": "barometer"}], ids=str)
def test_what_is_no_product_is_refused(constants):
    with pytest.raises(ImuloopError, match="effect product: its constants do not fit"):
        FittedEffect.from_dict({"name": "product", "constants": constants, "parameters": {}})


@pytest.mark.study
def test_motion_shows_a_product_with_the_rate():
    def extra(now):
        return np.outer(0.01 * now.other[:, 1] * now.output[:, 0], [0.0, 0.0, 1.0])

    truth = with_effects(motion_device(), [Injected("accelerometer", "product", extra=extra)])
    found = diagnosis_of(truth, SEED, limits=False, motion=True)["sensors"]
    (effect,) = found["accelerometer"]["motion"]["effects"]
    assert (effect["constants"]["formula"], effect["constants"]["axis"]) == ("f_x w_y", "z")
    assert effect["parameters"]["cz"] == pytest.approx(0.01, rel=0.1)
    assert found["gyroscope"]["motion"]["effects"] == []
