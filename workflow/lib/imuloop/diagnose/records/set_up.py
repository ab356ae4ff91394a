"""The set-up of a reference: its clock and its marker, which every fit estimates."""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtrc, chdtri, chndtrinc, ndtri

from imuloop.core.effect import Channels
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import size_of
from imuloop.diagnose.records.pose_problem import by_effect
from imuloop.effects.delays import ClockDrift, TimeOffset
from imuloop.effects.other_sensor import LeverArm

# standard deviation beforehand of each parameter, s, s per s and m: next to nothing is known
LOOSE = {"time_offset": 0.1, "clock_drift": 0.02, "lever_arm": 1.0}
# standard deviation of a parameter that is not fitted
FIXED = 1e-7


def set_up(sensor, recording):
    """Return the effects of a reference's set-up on a sensor beside it.

    What one of them leaves can hide that another lowers the error, and goes into axes and scale
    factors: every fit has them all.
    """
    log = recording.logs[0]
    if sensor == "gyroscope":
        return TimeOffset(), *ClockDrift.shapes(Channels(log.t, log.w, log.f, log.temperature))
    turns = all(np.isfinite(log.w).any() for log in recording.logs)
    return (TimeOffset(), LeverArm(marker=1)) if turns else (TimeOffset(),)


def prior_rows(sensor, effects):
    """Return base rows as of PoseProblem: of a ReferenceSensor's state, and of the set-up."""
    deviations = np.array([LOOSE[e.name] for e in effects for _ in e.parameters])
    known, z = sensor.prior_rows()
    return block_diag(known, np.diag(1 / deviations)), np.append(z, np.zeros(len(deviations)))


def fixed(problem, columns, values=0.0):
    """Return a problem whose parameters in some columns are fixed to values."""
    rows, z = problem.base_rows
    kept = ~rows[:, columns].any(axis=1)
    own = np.eye(rows.shape[1])[columns] / FIXED
    z = np.append(np.broadcast_to(values, len(columns)) / FIXED, z[kept])
    rows = np.vstack([own, rows[kept]]), z
    return replace(problem, base_rows=rows, _linearized={}, _columns={})


def set_up_content(choices, covariance, fitted, errors):
    """Return the contract's effects and candidates of a set-up, and Choices without those found.

    Found is what differs from zero by the test of Wald and lowers held-out errors, beside all that
    is fitted; takes the covariance of the parameters of all data, FittedEffects by effect, and the
    held-out errors with all.
    """
    problem, search = choices.problem, choices.search()
    (kind,), first = problem.sensor.kinds, len(problem.sensor.state)
    rows, count = problem.of_kind(kind), len(covariance)
    places = by_effect(np.arange(first, count), fitted)
    chance, power = np.exp(search.threshold(0)), problem.settings.power
    part_of_row, measure = problem.part_of_row[rows], problem.error_scale[rows][:, None]
    errors, effects, candidates, found = errors[rows], [], [], []
    for effect in problem.found:
        at, values = places[effect], fitted[effect].vector
        own = np.linalg.inv(covariance[np.ix_(at, at)])
        p_value = float(chdtrc(len(at), values @ own @ values))
        entry = fitted[effect].to_dict() | {
            "units": effect.units(problem.sensor.sensor),
            "p_value": p_value,
            "residual": kind,
            "heldout_after": size_of(problem, kind, errors),
        }
        status, why = "rejected", "of the set-up: fitted, and zero but for chance"
        if p_value < chance:
            before = Choices(fixed(problem, at)).errors(choices.nested)[rows]
            ratio = choices.ratio(part_of_row, before / measure, errors / measure)
            why = "held-out error does not fall for certain: ratio {:.3f} to {:.3f}".format(*ratio)
            if ratio[1] < 1:
                status, why = "added", "of the set-up: fitted, and lowers held-out errors"
                before = size_of(problem, kind, before)
                effects.append(entry | {"heldout_before": before, "ratio_ci95": ratio})
                found += [*at]
        # the test asks for χ² of so much; held-out errors fall by χ² ± 2 χ, for certain 1.96 times
        square = max(
            chndtrinc(chdtri(len(at), chance), len(at), 1 - power),
            4 * (ndtri(0.975) + ndtri(power)) ** 2,
        )
        limits = problem.limit_correction * np.sqrt(square / np.diag(own))
        limits = dict(zip(effect.parameters, limits.tolist(), strict=True))
        entry |= {"status": status, "why": why, "confounded_with": None, "detection_limit": limits}
        candidates.append(entry)
    before = Choices(fixed(problem, np.array(found))) if found else choices
    return {"effects": effects, "candidates": candidates}, before
