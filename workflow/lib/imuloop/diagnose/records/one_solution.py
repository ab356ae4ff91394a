"""One solution of what a reference shows of a sensor and what its other records do."""

from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from imuloop.calibrate.prior import GENERIC
from imuloop.calibrate.raw_units import in_raw_units
from imuloop.calibrate.reference.sensors import BESIDE, TURN
from imuloop.diagnose.records.pose_problem import by_effect
from imuloop.effects.other_sensor import LeverArm, SizeEffect

# sessions from which on whole ones are held out: without two of them one is left to learn from
WHOLE = 3
# probability beforehand of a bias as large that is none
BY_CHANCE = 0.05


def with_reference(calibration, results):
    """Return the calibration by all records and what was found beside a reference, one solution.

    Takes ReferenceResults by sensor. Of a sensor whose axes other records do not show, it is that
    beside the reference, the gyroscope's turned onto the accelerometer's where places show these.
    T and K that predict held-out data no better than those that are known are not written, nor is
    a bias that chance could give, nor anything of few sessions that do not tell a sensor from the
    reference.
    Where the accelerometer stays unexplained beside the reference and nothing else shows its axes,
    it stays as it was, and turns no gyroscope: the data sheet says how its axes lie. Effects of
    where a marker sits and how late the reference is are not the sensor's: they are not
    in it; nor is what was held out within a session only.
    """
    known = {s: r for s, r in results.items() if r.solution is not None}
    written, turned = {}, None
    beside = known.get("accelerometer")
    if beside and not beside.sensor.fitted and beside.content["verdict"] == "unexplained":
        del known["accelerometer"]
        why = _unexplained(beside)
        written["accelerometer"] = replace(calibration.accelerometer, not_testable=why)
    for sensor in [s for s, r in known.items() if r.within]:
        result, own = known.pop(sensor), getattr(calibration, sensor)
        why = own.not_testable if result.sensor.fitted else f"beside the reference, {result.within}"
        written[sensor] = replace(own, not_testable=why)
    if len(known) == 2 and not any(r.no_axes for r in known.values() if not r.sensor.fitted):
        force, turn = known["accelerometer"], known["gyroscope"]
        off = (turn.sessions - force.sessions)[:, 3:].mean(axis=0)
        turned = off, (force.variance + turn.variance)[3:]
    written |= {sensor: _written(result, turned) for sensor, result in known.items()}
    return replace(calibration, **written)


def _unexplained(result):
    """Return why what was found beside a reference is no calibration."""
    ((kind, left),) = result.content["residuals"].items()
    return (
        f"{kind.replace('_', ' ')} stays at {left['after']:.3g} {left['unit']}, by the noise "
        f"{left['floor']:.3g}, and no effect explains it: a fit to it is no calibration"
    )


def _written(result, turned):
    """Return the SensorCalibration of the state that a ReferenceResult has.

    `turned` is the rotation of a gyroscope's axes against the accelerometer's, and its variance,
    where only the reference shows both, else None.
    """
    sensor, own, effects = result.sensor, result.sensor.known, result.solution.effects
    count, first, x = len(sensor.state), len(sensor.base) - 6, result.solution.fit.x
    bias, places = slice(first + 3, first + 6), by_effect(np.arange(count, len(x)), effects)
    lasting = effects if len(result.sessions) >= WHOLE else ()
    kept = [e for e in lasting if e.name not in BESIDE]
    at = np.concatenate([np.arange(count), *(places[e] for e in kept)])
    x, covariance = x[at], result.covariance[np.ix_(at, at)]
    if sensor.fitted and result.no_axes:
        # what others say of T and K stays as it is
        covariance[:count] = covariance[:, :count] = 0.0
        covariance[:count, :count] = sensor.covariance
    if not sensor.fitted:
        mean, x[bias] = result.sessions[:, :3].mean(axis=0), sensor.state[bias]
        by_chance = ((mean - x[bias]) ** 2 / result.variance[:3]).sum() < chdtri(3, BY_CHANCE)
        x[bias] = x[bias] if by_chance else mean
        covariance[bias, bias] = np.diag(result.variance[:3])
        if turned and sensor.sensor == "gyroscope":
            x[:6] += TURN @ turned[0]
            covariance[:6, :6] += (
                TURN * (turned[1] - GENERIC["accelerometer"].misalignment ** 2) @ TURN.T
            )
    made = in_raw_units(
        own.raw_unit,
        sensor.base,
        x,
        covariance,
        method=own.method if sensor.fitted else "reference_motion",
        effects=[
            *(e.effect for e in sensor.effects),
            *(LeverArm() if isinstance(e, SizeEffect) else e for e in kept),
        ],
        known=[e for e in own.effects if sensor.fitted and e not in sensor.effects],
        reduced_chi2=own.reduced_chi2,
    )
    if sensor.fitted:
        ranges = {e.name: e.ranges for e in sensor.effects}
        held = [replace(e, ranges=ranges.get(e.name, e.ranges)) for e in made.effects]
        return replace(made, effects=tuple(held))
    if not result.no_axes:
        return made
    if by_chance and not kept:
        return replace(own, not_testable=result.no_axes)
    seen = slice(first + 3, None)
    names, covariance = made.names[seen], made.covariance[seen, seen]
    axes = {"T": own.T, "K": own.K, "names": names, "covariance": covariance}
    return replace(made, **axes, not_testable=result.no_axes)
