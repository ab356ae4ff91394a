"""A small part of the simulated study, and the study's own judgement and physics."""

import numpy as np
import pytest

from bench.study import physics
from bench.study.cases import AT_REST, Case, all_cases, choose_effects
from bench.study.devices import DEVICES
from bench.study.run import run
from bench.study.score import judge, pulls, ratio
from bench.study.tables import document
from imuloop.model.effect import Effect

PART = (
    Case("control", "poses", plan="few"),
    Case("effect", "poses", "accelerometer", ("quadratic",), plan="few"),
)


@pytest.mark.study
def test_devices_are_judged_by_what_was_put_in():
    part = run(PART, first=0, seeds=1, controls=1, workers=2, progress=lambda line: None)
    (control,), (quadratic,) = (part[case] for case in PART)
    assert judge(PART[0], control)["more"] == []
    found = judge(PART[1], quadratic)
    assert found["right"] == ["quadratic"] and found["more"] == []
    assert ratio(PART[1], quadratic) <= 1.25
    assert np.abs(pulls(quadratic)).max() < 3.5
    # the diagnosis got nothing of it: the control's parameters are zero
    assert not judge(PART[1], {**quadratic, "diagnosis": quadratic["control"]})["right"]
    text = document(part, 0)
    assert "| quadratic | accelerometer | poses | 1/1 | – | – | " in text


CLOSED = sorted(physics.EFFECTS.keys() - {"ramp"})


def test_every_effect_that_poses_or_motion_can_show_is_in_the_study():
    studied = {(case.sensor, case.names[0]) for case in all_cases() if case.kind == "effect"}
    for name, effect in Effect.library.items():
        if effect.records == ("motion",):
            assert name in CLOSED and (effect.sensors[0], name) in studied
        if (
            "poses" in effect.records
            and not effect.unobservable
            and "power_cycle" not in effect.needs
        ):
            assert name in CLOSED
            assert {(sensor, name) for sensor in effect.sensors} <= studied


def candidate(name, limit=None, **more):
    found = {"name": name, "detection_limit": limit, "constants": {}, "status": "rejected"}
    return {**found, "parameters": dict.fromkeys(limit or (), 0.0), **more}


def diagnosis_of(effects=(), candidates=(), confounded=(), sensor="gyroscope", record="poses"):
    empty = {"verdict": "consistent", "effects": [], "candidates": [], "residuals": {}}
    parts = {s: {r: dict(empty) for r in DEVICES} for s in AT_REST}
    parts[sensor][record] |= {
        "effects": [{"name": name} for name in effects],
        "candidates": list(candidates),
        "confounded": list(confounded),
    }
    return {"sensors": parts}


DRIFT = Case("effect", "poses", "gyroscope", ("bias_drift",))
LIKE_WARM_UP = [{"effect": "bias_drift", "with": "warm_up", "share": 0.9}]
FOUND = [candidate("bias_drift", status="added")]
CONFOUNDED = [candidate("bias_drift", status="confounded", confounded_with="warm_up")]


@pytest.mark.parametrize(
    ("found", "right", "twins", "missed", "more"),
    [
        ({"effects": ["bias_drift"]}, ["bias_drift"], {}, [], 0),
        ({"effects": ["warm_up"]}, [], {}, ["bias_drift"], 1),
        (
            {"effects": ["warm_up"], "candidates": CONFOUNDED},
            *([], {"bias_drift": "warm_up"}, [], 0),
        ),
        (
            {"effects": ["warm_up"], "confounded": LIKE_WARM_UP},
            *([], {"bias_drift": "warm_up"}, [], 0),
        ),
        # found at rest, known at the poses
        ({"candidates": FOUND}, ["bias_drift"], {}, [], 0),
        # a twin that was not added explains nothing
        ({"effects": ["g_sensitivity"], "confounded": LIKE_WARM_UP}, *([], {}, ["bias_drift"], 1)),
        ({"effects": ["bias_drift"], "sensor": "accelerometer"}, [], {}, ["bias_drift"], 1),
    ],
)
def test_a_diagnosis_is_judged_by_what_it_names(found, right, twins, missed, more):
    made = judge(DRIFT, {"diagnosis": diagnosis_of(**found)})
    assert (made["right"], made["twins"], made["missed"]) == (right, twins, missed)
    assert len(made["more"]) == more


def test_an_effect_has_nine_times_the_noncentrality_of_its_limit():
    names = ("dx", "dy", "dz")
    limits = dict(zip(names, (1e-6, 2e-6, 3e-6), strict=True))
    alike = np.array([[1, 0.6, 0], [0.6, 1, -0.3], [0, -0.3, 1]])
    control = {
        "diagnosis": diagnosis_of(candidates=[candidate("bias_drift", limits)]),
        "likeness": {("gyroscope", "bias_drift"): alike},
    }
    made = [choose_effects(DRIFT, seed, control)[0] for seed in (1, 1, 2)]
    z = np.array([[one.values[k] / limits[k] for k in names] for one in made])
    np.testing.assert_allclose(np.einsum("si,ij,sj->s", z, alike, z), 9)
    assert np.array_equal(z[0], z[1]) and not np.allclose(z[0], z[2])
    # an effect without a limit is not put in
    control["diagnosis"] = diagnosis_of(candidates=[candidate("bias_drift")])
    assert choose_effects(DRIFT, 1, control) is None
