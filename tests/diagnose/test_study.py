"""A small part of the simulated study, and the study's own judgement and physics."""

import pytest

from bench.study import physics
from bench.study.cases import AT_REST, Case, all_cases
from bench.study.devices import DEVICES
from bench.study.score import judge
from imuloop.model.effect import Effect

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
