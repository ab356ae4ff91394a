"""A bias that jumps once gets its step, and no other record is unexplained by it."""

import json

import numpy as np
import pytest

from bench.realistic.judge import SENSORS, judge


def test_a_bias_that_jumps_gets_its_step(no_limits, tmp_path):
    outcome = judge(16, "jump", tmp_path)
    truth, diagnosis = (
        json.loads((tmp_path / "jump_16" / name).read_text())
        for name in ("truth.json", "results/diagnosis.json")
    )
    force, turn = (diagnosis["sensors"][s]["poses"] for s in SENSORS)
    (step,) = force["effects"]
    assert step["name"] == "steps"
    assert step["constants"]["times"] == pytest.approx([truth["jump_s"]], abs=0.5)
    sizes = [step["parameters"][f"h1{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(sizes, truth["steps"][0], rtol=0.1, atol=2e-3)
    assert all(r["after"] < r["before"] for r in force["residuals"].values())
    assert turn["effects"] == [] and outcome["ratios"]["accelerometer"] < 0.2
    # a pose that may lie on either side of the step is predicted by nothing, and counts in no error
    assert [force["verdict"], turn["verdict"]] == ["explained", "consistent"]
    assert "unexplained" not in outcome["verdicts"]["accelerometer"]["motion"]
