"""A small part of the simulated study, and the study's own judgement and physics."""

from bench.study import physics
from bench.study.cases import all_cases
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
