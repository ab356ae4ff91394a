"""The cases of the study: effects, their sizes, and disturbances with them or without them."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

import imuloop.diagnose.diagnose  # noqa: F401  loads the library
from bench.study import physics
from bench.study.devices import Injected
from imuloop.model.effect import Effect, find_effect
from imuloop.simulate.truth import Popcorn

# how many detection limits large an effect is
LIMITS = 3.0
# time constants and widths lie between those that the library tries: at most this factor off
BETWEEN = 1.3
# effects that a record at rest is searched for, apart from the noise, by sensor
AT_REST = {
    "accelerometer": (
        "bias_temperature", "scale_temperature", "bias_temperature_rate", "thermal_hysteresis",
        "warm_up", "ramp", "steps",
    ),
    "gyroscope": (
        "bias_temperature", "bias_temperature_rate", "thermal_hysteresis", "warm_up", "ramp",
        "steps",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One kind of device."""

    kind: str  # 'control', 'effect' or 'two'
    record: str  # 'poses', 'static_record' or 'motion': which device it is, see `devices`
    sensor: str = ""  # that is changed; empty for a control
    names: tuple = ()  # effects put into it
    limits: float = LIMITS  # how many detection limits large it is


def all_cases(limits=LIMITS):
    """Return every case of a size, the controls of each kind of device first."""
    cases = [Case("control", record) for record in ("poses", "static_record", "motion")]
    for sensor, at_rest in AT_REST.items():
        of_poses = [
            name
            for name, effect in Effect.library.items()
            if sensor in effect.sensors
            and "poses" in effect.records
            and not effect.unobservable
            # the devices have one power cycle: tests/diagnose/test_turn_on_bias.py has three
            and "power_cycle" not in effect.needs
        ]
        cases += [Case("effect", "poses", sensor, (name,)) for name in sorted(of_poses)]
        names = [name for name in at_rest if name in Effect.library]
        cases += [Case("effect", "static_record", sensor, (name,)) for name in names]
        cases += [
            Case("effect", "motion", sensor, (name,))
            for name, effect in sorted(Effect.library.items())
            # effects of the poses are tried there
            if effect.sensors[0] == sensor
            and "motion" in effect.records
            and "poses" not in effect.records
        ]
    cases.append(Case("two", "poses", "accelerometer", ("quadratic", "bias_drift")))
    cases.append(Case("two", "poses", "gyroscope", ("g_sensitivity", "bias_temperature")))
    return [replace(case, limits=limits) for case in cases]


def choose_effects(case, seed, control):
    """Return the effects put into a device, sized by the diagnosis of its control.

    A detection limit d is the size of a parameter that alone is not zero. The parameters together
    have a random direction z, ``p_k = 3 d_k z_k`` with ``zᵀ R z = 1``: R, the information of the
    parameters with ones on its diagonal, makes their noncentrality nine times the noncentrality of
    one parameter at its limit. A parameter that physics bounds is as large as it can be. The
    direction follows from the seed and the names. None where the control, the outcome of the device
    of that seed without effects, has no detection limit: the log cannot show the effect.
    """
    rng = np.random.default_rng([seed, *"".join((case.sensor, *case.names)).encode()])
    part = control["diagnosis"]["sensors"][case.sensor][case.record]
    effects = []
    for name in case.names:
        candidate = next(c for c in part["candidates"] if c["name"] == name)
        if not candidate["detection_limit"]:
            return None
        # at rest the parameters of three axes leave nothing in common
        alike = np.eye(len(candidate["detection_limit"]))
        if case.record == "poses":
            # the log may show some of them alone
            shown = [p in candidate["detection_limit"] for p in candidate["parameters"]]
            alike = control["likeness"][case.sensor, name][np.ix_(shown, shown)]
        effects.append(_choose_effect(case, name, candidate, alike, rng))
    return tuple(effects)


def _choose_effect(case, name, candidate, alike, rng):
    """Return one effect of as many detection limits as the case has."""
    sensor, limits = case.sensor, case.limits
    limit, constants = candidate["detection_limit"], dict(candidate["constants"])
    keys = list(limit)
    for key in constants.keys() & {"tau", "half_width", "lag"}:
        constants[key] *= BETWEEN ** rng.uniform(-1, 1)
    z = rng.standard_normal(len(keys))
    if name == "bias_temperature":
        # of first order; whatever order the control's diagnosis looked at last
        z *= [key.startswith("c1") for key in keys]
    if limits == 1:
        # a limit is of one parameter alone
        z *= np.arange(len(keys)) == rng.choice(np.flatnonzero(z))
    z *= limits / np.sqrt(z @ alike @ z)
    # of a size without a limit nothing is put in
    values = dict.fromkeys(candidate.get("parameters", ()), 0.0)
    values |= {key: limit[key] * part for key, part in zip(keys, z, strict=True)}
    largest, bound = max(map(abs, values.values())), find_effect(name).limit
    size = limits * min(1.0, bound / largest)
    values = {key: float(value * size / limits) for key, value in values.items()}
    if name != "steps" or case.record == "poses":
        extra = partial(physics.EFFECTS[name], p=values, c=constants)
        return Injected(sensor, name, values, constants, size, extra)
    # of the first size, at one time in the middle part of every session
    first = tuple(values["h1" + axis] for axis in "xyz")
    noise = Popcorn(first, (float(rng.uniform(900, 2700)),))
    constants = {"times": noise.times}
    return Injected(sensor, name, values, constants, size, noise={name: (noise,)})
