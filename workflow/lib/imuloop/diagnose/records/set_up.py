"""The set-up of a reference: its clock and its marker, which every fit estimates."""

from dataclasses import asdict, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chndtrinc
from scipy.stats import chi2

from imuloop.core.effect import Channels
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import size_of
from imuloop.diagnose.records.one_solution import BESIDE
from imuloop.diagnose.records.poses import by_effect
from imuloop.effects.clock_drift import ClockDrift
from imuloop.effects.lever_arm import LeverArm
from imuloop.effects.time_offset import TimeOffset

# standard deviation beforehand of each parameter, s, s per s and m: next to nothing is known
LOOSE = {"time_offset": 0.1, "clock_drift": 0.02, "lever_arm": 1.0}
# standard deviation of a parameter that is not fitted
CLAMPED = 1e-7


class Adopted(Choices):
    """Choices of a problem with the effects that those of another one add."""

    def __init__(self, problem, library):
        super().__init__(problem)
        self.library = library

    def choice(self, out=frozenset()):
        """Return the Choice of the other search."""
        return self.library.choice(out)

    def nested(self, out):
        """Return the effects that the other search adds without some parts."""
        return self.library.nested(out)


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


def loose(rows, effects):
    """Return base rows as of PoseProblem with those of the set-up after them."""
    deviations = np.array([LOOSE[e.name] for e in effects for _ in e.parameters])
    known, z = rows
    return block_diag(known, np.diag(1 / deviations)), np.append(z, np.zeros(len(deviations)))


def clamped(problem, columns, values=0.0):
    """Return a problem whose parameters in some columns are fixed to values."""
    rows, z = problem.base_rows
    kept = ~rows[:, columns].any(axis=1)
    fixed = np.eye(rows.shape[1])[columns] / CLAMPED
    z = np.append(np.broadcast_to(values, len(columns)) / CLAMPED, z[kept])
    rows = np.vstack([fixed, rows[kept]]), z
    return replace(problem, base_rows=rows, _linearized={}, _columns={})


def set_up_content(choices, covariance):
    """Return the contract's effects and candidates of a set-up, and Choices without those found.

    Found is what differs from zero by the test of Wald, beside all that is fitted; takes the
    covariance of the parameters of all data.
    """
    problem, base, search = choices.problem, choices.choice().base, choices.search()
    (kind,), sensor, first = problem.sensor.kinds, problem.sensor, len(problem.sensor.names)
    rows, x = problem.of_kind(kind), problem.linearized(base).solution.fit.x
    places = by_effect(np.arange(first, len(x)), (*problem.found, *base))
    tested = {}
    for effect in (e for e in problem.found if e.name in BESIDE):
        at = places[effect]
        own, values = np.linalg.inv(covariance[np.ix_(at, at)]), x[at]
        chance = float(chi2.sf(values @ own @ values, len(at)))
        tested[effect] = at, own, chance, chance < np.exp(search.threshold(0))
    found = [effect for effect, (*_, passes) in tested.items() if passes]
    errors = choices.errors(choices.nested)[rows]
    after, effects, candidates = size_of(problem, kind, errors), [], []
    for effect, (at, own, chance, passes) in tested.items():
        std = np.sqrt(np.diag(covariance)[at])
        parameters, deviations = (
            dict(zip(effect.parameters, map(float, v), strict=True)) for v in (x[at], std)
        )
        entry = {
            "name": effect.name,
            "constants": asdict(effect),
            "parameters": parameters,
            "std": deviations,
            "units": effect.units(sensor.sensor),
            "p_value": chance,
            "residual": kind,
            "heldout_after": after,
        }
        why = "fitted with the rest of the set-up; it does not differ from zero by more than chance"
        if passes:
            without = Adopted(clamped(problem, at), choices)
            before = without.errors(without.nested)[rows]
            size = problem.measure[rows][:, None]
            effects.append(
                entry
                | {
                    "heldout_before": size_of(problem, kind, before),
                    "ratio_ci95": choices.ratio(problem.fold[rows], before / size, errors / size),
                }
            )
            why = "of the set-up: fitted with the rest of it, and differs from zero"
        # a parameter that alone is not zero, found with the power that is asked for
        wanted = chi2.isf(np.exp(search.threshold(0)), len(at))
        square = chndtrinc(wanted, len(at), 1 - problem.settings.power)
        limits = problem.enough * np.sqrt(square / np.diag(own))
        candidates.append(
            entry
            | {
                "status": "added" if passes else "rejected",
                "why": why,
                "confounded_with": None,
                "detection_limit": dict(zip(effect.parameters, limits.tolist(), strict=True)),
            }
        )
    before = choices
    if found:
        before = Adopted(clamped(problem, np.concatenate([places[e] for e in found])), choices)
    return {"effects": effects, "candidates": candidates}, before
