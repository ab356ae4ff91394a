"""Diagnose a sensor at the poses."""

from dataclasses import asdict

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import chdtrc

from imuloop.calibrate.least_squares import SINGULAR
from imuloop.diagnose.correlates import correlates, probes
from imuloop.diagnose.residuals import size
from imuloop.diagnose.search import (
    HeldOut,
    Search,
    candidates,
    floor_variance,
    folds,
    held_out,
    ratio_interval,
)
from imuloop.diagnose.trial import detection_limit, try_shapes
from imuloop.diagnose.twins import imitated, interchangeable
from imuloop.diagnose.verdict import NOTHING, UNTRIED, above_floor, unseen, verdict

# kinds of residuals at the poses of a device, which share the significance: gravity norm, pose
# rate, rotation
KINDS = 3


def pose_candidates(sensor, recording):
    """Return what `candidates` does for a sensor at the poses; nothing to try without poses."""
    poses = recording.poses
    if not len(poses):
        return {}, {}
    other = poses.w if sensor == "accelerometer" else poses.f
    return candidates(sensor, "poses", recording.pose_channels(sensor, lambda y: y, other))


def pose_search(model, recording, settings, tests=None, start=None):
    """Return the Search of all poses of a sensor; arguments as of `diagnose_poses` and `Search`."""
    available, _ = pose_candidates(model.sensor, recording)
    known = {type(effect.effect) for effect in model.known}
    available = {cls: shapes for cls, shapes in available.items() if cls not in known}
    everything = np.ones(len(recording.poses), dtype=bool)
    tests = tests or len(available)
    return Search(model, recording, everything, available, settings, tests, start=start)


def diagnose_poses(model, recording, settings, tests=None, fold_models=None, whole=None):
    """Diagnose one sensor at the poses.

    Parameters
    ----------
    model : AccelerometerPoses or GyroscopePoses
        How the sensor is fitted.
    recording : Recording
        Poses and rotations.
    settings : DiagnoseSettings
        Settings.
    tests : int, optional
        Number of tests that share the significance; this sensor's own by default.
    fold_models : sequence, optional
        How the sensor is fitted in each fold, where that too was chosen without the held-out poses.
    whole : Search, optional
        From `pose_search`, where another stage has use for its fits.

    Returns
    -------
    dict
        The contract's fields.
    Solution or None
        The fit with the effects that were added.
    list of tuple of Effect
        Those that each fold chose; empty if nothing was tested.
    """
    reason = model.untestable(recording)
    if reason:
        return {"verdict": "not_testable", "why": reason, **NOTHING}, None, []
    whole = whole or pose_search(model, recording, settings, tests)
    if reason := whole.lost():
        return {"verdict": "not_testable", "why": reason, **NOTHING}, None, []
    try:
        return _diagnosed(whole, fold_models)
    except LinAlgError:
        return {"verdict": "not_testable", "why": SINGULAR, **NOTHING}, None, []


def _diagnosed(whole, fold_models):
    """Return what `diagnose_poses` does, of poses whose fit without effects is one."""
    model, recording, settings = whole.model, whole.recording, whole.settings
    available, (_, others) = whole.available, pose_candidates(model.sensor, recording)
    known = {type(effect.effect) for effect in model.known}
    fold_models = fold_models or [model] * min(settings.folds, len(recording.poses))
    searches = folds(fold_models, recording, available, settings, whole.tests, whole)
    if searches is None:
        reason = f"{len(recording.poses)} poses do not determine the model with a part held out"
        return {"verdict": "not_testable", "why": reason, **NOTHING}, whole.step().solution, []

    effects, entries, failed = _chosen(whole, searches)
    base, final = whole.step(), whole.step(effects)
    # the choice of effects is made again in each fold
    chosen = [s.greedy()[0] if effects else () for s in searches]
    before = [s.errors() for s in searches]
    after = [s.errors(c) for s, c in zip(searches, chosen, strict=True)]
    held = held_out(before, after)
    if effects and all(size(h.after) >= size(h.before) for h in held.values()):
        # what each part chooses for itself predicts it no better: nothing that helps was found
        ratios = [ratio_interval(h, settings) for h in held.values()]
        failed |= {type(effect): min(ratios) for effect in effects}
        effects, entries, final, chosen = (), [], base, [()] * len(searches)
        held = held_out(before, before)
    variance = floor_variance(base, searches)

    share = settings.significance / KINDS
    above = [
        any(
            above_floor(
                step.solution.residuals[kind].above_floor(share),
                size(getattr(h, side)),
                size(floor := np.sqrt(variance[kind])),
                ratio_interval(HeldOut(h.fold, floor, getattr(h, side)), settings),
            )
            for kind, h in held.items()
        )
        for step, side in ((base, "before"), (final, "after"))
    ]
    fitted = final.solution.calibration.effects[len(model.known) :]
    content = {
        "verdict": verdict(*above, effects),
        "slow_noise": above[1] and _within_limits(final, share),
        "residuals": {
            kind: {
                "unit": base.solution.residuals[kind].unit,
                "n": len(h.before),
                "floor": float(np.sqrt(variance[kind].sum(axis=1).mean())),
                "before": size(h.before),
                "after": size(h.after),
                "in_sample_before": size(base.solution.residuals[kind].values),
                "in_sample_after": size(final.solution.residuals[kind].values),
                "chi2_before": base.solution.residuals[kind].reduced_chi2,
                "chi2_after": final.solution.residuals[kind].reduced_chi2,
            }
            for kind, h in held.items()
        },
        "effects": [
            {
                **effect.to_dict(),
                "units": effect.effect.units(model.sensor),
                **entry,
            }
            for effect, entry in zip(fitted, entries, strict=True)
        ],
        "candidates": [
            *(_candidate(cls, whole, searches, effects, failed, settings) for cls in available),
            *(
                {"name": cls.name, "status": "added", "why": "found in the static record"} | UNTRIED
                for cls in known
            ),
            *(
                {"name": cls.name, "status": status, "why": why, **UNTRIED}
                for cls, (status, why) in others.items()
            ),
        ],
        "confounded": imitated(_patterns(base)),
        "correlates": correlates(final.white, final.linear, probes(recording, model.sensor)),
        "points": _points(recording, held, variance),
    }
    return content, final.solution, chosen


def _chosen(whole, searches):
    """Return the effects that lower the residual, in the fit and on held-out poses.

    Returns
    -------
    tuple of Effect
        In the order in which they were added.
    list of dict
        For each what the contract says of it, beside its parameters.
    dict of type to list of float
        Interval of the ratio of held-out errors of effects that passed the test alone.
    """
    found, failed = whole.greedy()
    while True:
        # what those after it take up whole is none of its own
        if taken := [e for e in found if type(e) not in whole.step(_without(found, e)).trials]:
            found = _without(found, taken[0])
            continue
        entries = {effect: _entry(effect, found, whole, searches) for effect in found}
        idle = next((e for e, entry in entries.items() if entry["ratio_ci95"][1] >= 1), None)
        if idle is None:
            return found, list(entries.values()), failed
        failed[type(idle)] = entries[idle]["ratio_ci95"]
        found = _without(found, idle)


def _entry(effect, found, whole, searches):
    """Return what an effect adds to all others, on held-out data too; every fold fits itself."""
    others = _without(found, effect)
    trial = whole.step(others).trials[type(effect)]
    kind = whole.kind(others, trial)
    before, after = (
        [s.errors(s.shaped(map(type, chosen))) for s in searches] for chosen in (others, found)
    )
    held = held_out(before, after)[kind]
    return {
        "p_value": trial.p_value,
        "residual": kind,
        "heldout_before": size(held.before),
        "heldout_after": size(held.after),
        "ratio_ci95": ratio_interval(held, whole.settings),
    }


def _without(effects, effect):
    """Return the effects but one."""
    return tuple(e for e in effects if e != effect)


def _patterns(step):
    """Return the whitened patterns of each effect that was tried, one a shape."""
    patterns = {}
    for shape, raw in zip(step.linear.shapes, step.white.columns, strict=True):
        if type(shape) in step.trials:
            patterns.setdefault(shape.name, []).append(step.white.left(raw))
    return patterns


def _candidate(cls, whole, searches, effects, failed, settings):
    """Return what the contract holds of one candidate."""
    classes = [type(effect) for effect in effects]
    base, final = whole.step(), whole.step(effects)
    if cls in classes:
        at = whole.step(tuple(e for e in effects if type(e) is not cls))
        status, why = "added", "lowers the residual in the fit and on held-out poses"
    else:
        at = final
        status, why = "rejected", "the residual does not fall by more than chance"
    trial = at.trials.get(cls)
    twin = None
    if trial is None:
        names = {effect.name for effect in effects}
        pairs = imitated(_patterns(base))
        twins = [p["with"] for p in pairs if p["effect"] == cls.name and p["with"] in names]
        if not twins:
            return UNTRIED | {"name": cls.name, "status": "not_observable", "why": at.reasons[cls]}
        why = f"in these data all that it adds is part of {twins[0]}"
        return UNTRIED | {
            "name": cls.name,
            "status": "confounded",
            "why": why,
            "confounded_with": twins[0],
        }
    if cls in failed:
        low, high = failed[cls]
        why = f"held-out error does not fall for certain: ratio {low:.3f} to {high:.3f}"
    elif trial.impossible:
        why = f"it would have to be larger than {cls.limit:g}, the most that is possible"
    elif cls not in classes and _walk_alike(
        at, trial, whole.threshold(effects), len(whole.available[cls])
    ):
        why = (
            "slow noise that the rests are too short to exclude could look the same: record "
            "hours at rest"
        )
    elif cls not in classes:
        twin = _twin(cls, whole, effects)
        if twin:
            status = "confounded"
            why = f"in these data it could stand in for {twin}: neither adds to the other"
    kind = whole.kind(at.solution.effects, trial)
    alone = held_out([s.errors() for s in searches], [s.errors_alone(cls) for s in searches])
    sized = trial
    if status != "added" and at.spread:
        # what is not explained counts as noise
        spread = at.spread.only(trial.column)
        sized = try_shapes(spread, [trial.effect])[0].get(cls, trial)
    limits = detection_limit(sized, len(whole.available[cls]), settings, whole.tests)
    if status == "rejected" and (hidden := unseen(cls, limits)):
        status, why, limits = "not_observable", hidden, None
    return {
        "name": cls.name,
        "status": status,
        "why": why,
        "residual": kind,
        "p_value": trial.p_value,
        "heldout_after": size(alone[kind].after) if cls in base.trials else None,
        "constants": asdict(trial.effect),
        "parameters": dict(zip(trial.effect.parameters, sized.values.tolist(), strict=True)),
        "std": dict(zip(trial.effect.parameters, sized.std.tolist(), strict=True)),
        "confounded_with": twin,
        "detection_limit": limits,
        "units": trial.effect.units(whole.model.sensor),
    }


def _within_limits(step, significance):
    """Tell whether slow noise at its limits leaves nothing unexplained."""
    if step.slow is None:
        return False
    left = step.slow.rest
    return bool(chdtrc(len(left) - step.slow.q.shape[1], left @ left) >= significance)


def _walk_alike(step, trial, threshold, shapes):
    """Tell whether nothing but slow noise at its limits speaks against a candidate."""
    if step.slow is None or trial.log_p < np.log(threshold):
        return False
    one = [w.only(trial.column) for w in (step.white, step.spread) if w]
    found = try_shapes(one[0], [trial.effect], one[1:])[0].get(type(trial.effect))
    return found is not None and found.log_p + np.log(shapes) < np.log(threshold)


def _twin(cls, whole, effects):
    """Return the name of an added effect that a candidate could stand in for, or None."""
    final = whole.step(effects)
    columns = [
        c
        for shape, c in zip(final.linear.shapes, final.white.columns, strict=True)
        if type(shape) is cls
    ]
    end = len(final.solution.fit.x)
    for effect in reversed(effects):
        added = slice(end - len(effect.parameters), end)
        values = final.solution.fit.x[added]
        if interchangeable(final.white, added, values, columns, whole.threshold(effects)):
            return effect.name
        end = added.start
    return None


def _points(recording, held, variance):
    """Return one entry a pose or rotation, for pictures: held-out errors and their size."""
    poses = recording.poses
    direction = poses.f / np.linalg.norm(poses.f, axis=1, keepdims=True)
    points = []
    for kind, h in held.items():
        of_pose = recording.rotations.first if kind == "rotation" else np.arange(len(poses))
        floor = np.sqrt(variance[kind].sum(axis=1))
        # the norm of gravity is too large or too small; the others have a size alone
        signed = h.before.shape[1] == 1
        before, after = (
            e[:, 0] if signed else np.linalg.norm(e, axis=1) for e in (h.before, h.after)
        )
        points += [
            {
                "residual": kind,
                "index": int(pose),
                "session": int(poses.session[pose]),
                "start_s": float(poses.start_s[pose]),
                "direction": direction[pose].tolist(),
                "before": float(b),
                "after": float(a),
                "floor": float(limit),
                "components": {"before": h.before[k].tolist(), "after": h.after[k].tolist()},
            }
            for k, (pose, b, a, limit) in enumerate(zip(of_pose, before, after, floor, strict=True))
        ]
    return points
