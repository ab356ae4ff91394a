"""Products of outputs: which there are; tests/diagnose/test_devices.py has one that is found."""

import numpy as np
import pytest

from bench.study.chain import diagnosis_of
from bench.study.devices import Injected, motion_device, with_effects
from imuloop.core.errors import ImuloopError
from imuloop.effects.products import products
from imuloop.model.effect import FittedEffect


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
    sensors = diagnosis_of(truth, 7, limits=False, motion=True)["sensors"]
    (effect,) = sensors["accelerometer"]["motion"]["effects"]
    assert (effect["constants"]["formula"], effect["constants"]["axis"]) == ("f_x w_y", "z")
    assert effect["parameters"]["cz"] == pytest.approx(0.01, rel=0.1)
    assert sensors["gyroscope"]["motion"]["effects"] == []
