"""Diagnose a sensor at the poses."""

from dataclasses import replace

import numpy as np

from imuloop.diagnose.residuals import size
from imuloop.diagnose.search import (
    candidates,
    detection_limit,
    hold_out,
    ratio_interval,
    search,
)
from imuloop.diagnose.verdict import NOTHING, UNTRIED, verdict

# kinds of residuals at the poses of a device, which share the significance: gravity norm, pose
# rate, rotation
KINDS = 3


def diagnose_poses(model, recording, settings):
    """Diagnose one sensor at the poses.

    Parameters
    ----------
    model : AccelerometerPoses or GyroscopePoses
        How the sensor is fitted.
    recording : Recording
        Poses and rotations.
    settings : DiagnoseSettings
        Settings.

    Returns
    -------
    dict, Solution or None
        The contract's fields, and the fit with the effects that were added.
    """
    reason = model.untestable(recording)
    if reason:
        return {"verdict": "not_testable", "why": reason, **NOTHING}, None
    available, missing = candidates(model.sensor, recording)
    base, found, trials = search(model, recording, available, settings.significance)
    held = hold_out(model, recording, base, available, settings)
    if held is None:
        reason = f"{len(recording.poses)} poses do not determine the model with a part held out"
        return {"verdict": "not_testable", "why": reason, **NOTHING}, base
    main = held[model.headline]
    ratio = ratio_interval(main, settings)
    # on held-out data an effect that is there lowers the error for certain
    added = found.effects if ratio[1] < 1 else ()
    final = found if added else base
    if not added:
        held = {kind: replace(h, after=h.before) for kind, h in held.items()}
    listed = [
        _candidate(t, added, ratio, main, model.headline, settings, trials) for t in trials.values()
    ]
    listed += [
        {"name": effect.name, "status": "not_available", "why": why, **UNTRIED}
        for effect, why in missing.items()
    ]
    share = settings.significance / KINDS
    above = [any(r.above_floor(share) for r in s.residuals.values()) for s in (base, final)]
    content = {
        "verdict": verdict(*above, added),
        "residuals": {
            kind: {
                "unit": base.residuals[kind].unit,
                "n": len(h.before),
                "floor": h.floor,
                "before": size(h.before),
                "after": size(h.after),
                "in_sample_before": size(base.residuals[kind].values),
                "in_sample_after": size(final.residuals[kind].values),
                "chi2_before": base.residuals[kind].reduced_chi2,
                "chi2_after": final.residuals[kind].reduced_chi2,
            }
            for kind, h in held.items()
        },
        "effects": [
            {
                "name": fitted.name,
                "parameters": fitted.values,
                "std": fitted.std,
                "units": effect.parameters,
                "p_value": trials[effect].p_value,
                "residual": model.headline,
                "heldout_before": size(main.before),
                "heldout_after": size(main.after),
                "ratio_ci95": ratio,
            }
            for effect, fitted in zip(added, final.calibration.effects, strict=True)
        ],
        "candidates": listed,
        "points": _points(recording, held),
    }
    return content, final


def _candidate(tried, added, ratio, main, headline, settings, trials):
    """Return what the contract holds of one candidate."""
    if tried.effect in added:
        status, why = "added", "lowers the residual in the fit and on held-out poses"
    elif tried.p_value >= settings.significance / len(trials):
        status, why = "rejected", "the residual does not fall by more than chance"
    else:
        status = "rejected"
        why = f"held-out error does not fall for certain: ratio {ratio[0]:.3f} to {ratio[1]:.3f}"
    return {
        "name": tried.effect.name,
        "status": status,
        "why": why,
        "residual": headline,
        "p_value": tried.p_value,
        "heldout_after": size(main.after),
        "detection_limit": detection_limit(tried, settings, len(trials)),
    }


def _points(recording, held):
    """Return one entry a pose or rotation, for pictures: held-out size before and after."""
    poses = recording.poses
    direction = poses.f / np.linalg.norm(poses.f, axis=1, keepdims=True)
    points = []
    for kind, h in held.items():
        of_pose = recording.rotations.first if kind == "rotation" else np.arange(len(poses))
        floor = np.sqrt(h.variance.sum(axis=1))
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
            }
            for pose, b, a, limit in zip(of_pose, before, after, floor, strict=True)
        ]
    return points
