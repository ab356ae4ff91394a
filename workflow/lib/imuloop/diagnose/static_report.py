"""What a diagnosis holds of the static records of a sensor."""

from dataclasses import asdict

import numpy as np

from imuloop.core.effect import Effect
from imuloop.diagnose.residuals import Residual, size
from imuloop.diagnose.static_correction import process_effect
from imuloop.diagnose.static_estimate import fitted
from imuloop.diagnose.static_limits import detection_limits
from imuloop.diagnose.static_means import COLUMNS
from imuloop.diagnose.static_model import one_session
from imuloop.diagnose.static_noise import mean_covariance
from imuloop.diagnose.static_probes import static_correlates
from imuloop.diagnose.static_search import SCANS, StaticSearch
from imuloop.diagnose.static_spectrum import limits
from imuloop.diagnose.twins import imitated
from imuloop.diagnose.verdict import UNTRIED, above_floor, unseen, verdict
from imuloop.effects.gauss_markov import GaussMarkov

UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
RESIDUAL = "bias"


def static_content(sensor, finding, noise, change, settings):
    """Return the contract's fields.

    Parameters
    ----------
    sensor : str
        The sensor.
    finding : Finding
        What was found.
    noise : NoiseModel
        Noise of the records without the effects: the floor.
    change : dict
        Noise coefficients of each axis before and after; empty where nothing was added.
    settings : DiagnoseSettings
        Settings.
    """
    axes = [noise.axes[name] for name in COLUMNS[sensor]]
    floor = finding.blocks.floor(axes)
    share = settings.significance / 2
    judged = [_judge(finding, axes, base) for base in ((), finding.base)]
    spread = [np.sqrt(f) for f in floor]
    above = [
        above_floor(
            judge.above_floor(share),
            size(np.concatenate(errors)),
            size(np.concatenate(spread)),
            finding.blocks.ratio_interval(spread, errors),
        )
        for judge, errors in zip(judged, (finding.before, finding.after), strict=True)
    ]
    return {
        "verdict": verdict(*above, finding.added),
        "residuals": {
            RESIDUAL: {
                "unit": UNITS[sensor],
                "n": sum(map(len, finding.before)),
                "floor": float(np.sqrt(np.concatenate(floor).sum(axis=1).mean())),
                "before": size(np.concatenate(finding.before)),
                "after": size(np.concatenate(finding.after)),
                "chi2_before": judged[0].reduced_chi2,
                "chi2_after": judged[1].reduced_chi2,
                "sessions": _by_axis(sensor, finding, floor),
            }
        },
        "effects": _effects(sensor, finding),
        "candidates": _candidates(sensor, finding, settings),
        "confounded": imitated(_patterns(finding.search)),
        "correlates": static_correlates(finding.search, finding.base),
        "by_session": _by_session(finding),
        "noise": change,
        "points": _points(finding, floor),
    }


def _judge(finding, axes, base):
    """Return the residual of the fitted windows about their levels, against its floor."""
    total, dof, values = 0.0, 0, []
    effects = finding.effects if base else ()
    for record, *patterns in zip(finding.model.fitted, *(p.fitted for p in base), strict=True):
        left = record.values - sum(
            (d @ _vector(e) for d, e in zip(patterns, effects, strict=True)),
            np.zeros_like(record.values),
        )
        values.append(left - left.mean(axis=0))
        for axis, process in enumerate(axes):
            root = np.linalg.cholesky(mean_covariance(process, record.windows))
            white = np.linalg.solve(root, np.column_stack([np.ones(len(left)), left[:, axis]]))
            total += white[:, 1] @ white[:, 1] - (white[:, 0] @ white[:, 1]) ** 2 / (
                white[:, 0] @ white[:, 0]
            )
            dof += len(left) - 1
    dof -= sum(len(c) for p in base for c in p.columns)
    # rounding leaves less than nothing of what never leaves its level
    return Residual("", np.concatenate(values), max(float(total / dof), 0.0), float(dof))


def _vector(fitted_effect):
    return np.array([fitted_effect.values[name] for name in fitted_effect.effect.parameters])


def _by_axis(sensor, finding, floor):
    """Return the held-out errors of each session and axis."""
    squares = {
        "before": [e**2 for e in finding.before],
        "after": [e**2 for e in finding.after],
        "floor": floor,
    }
    found = {}
    for session in _sessions(finding):
        own = [i for i, r in enumerate(finding.model.records) if r.session == session]
        mean = {k: np.concatenate([s[i] for i in own]).mean(axis=0) for k, s in squares.items()}
        found[session] = {
            name: {key: float(np.sqrt(m[axis])) for key, m in mean.items()}
            for axis, name in enumerate(COLUMNS[sensor])
        }
    return found


def _sessions(finding):
    """Return the sessions of a finding, each once."""
    return list(dict.fromkeys(r.session for r in finding.model.records))


def _effects(sensor, finding):
    """Return the entries of the added effects, several steps as one."""
    by_name = {e.name: e for e in finding.effects}
    found = []
    for passed in finding.choice.passed:
        effect = by_name[passed.trial.pattern.name]
        found.append(
            {
                **effect.to_dict(),
                "units": effect.effect.units(sensor),
                "p_value": passed.trial.p_value,
                "residual": RESIDUAL,
                "axis": COLUMNS[sensor][passed.trial.axis],
                "heldout_before": size(np.concatenate(passed.before)),
                "heldout_after": size(np.concatenate(passed.after)),
                "ratio_ci95": passed.ratio,
            }
        )
    if finding.has_process:
        process, before = finding.process, size(np.concatenate(finding.after))
        found.append(
            {
                "name": GaussMarkov.name,
                **process_effect(process.test),
                "units": GaussMarkov().units(sensor),
                "p_value": process.test.p_value,
                "residual": RESIDUAL,
                "axis": None,
                # the error itself does not fall: what is foreseen of it does
                "heldout_before": before,
                "heldout_after": process.share * before,
                "ratio_ci95": process.ratio,
            }
        )
    return found


def _candidates(sensor, finding, settings):
    """Return the entry of every effect that the sensor can have."""
    search = finding.search
    found = [_candidate(sensor, finding, cls, settings) for cls in (*search.shapes, *SCANS)]
    found.append(_process(sensor, finding, settings))
    listed = {c["name"] for c in found} | {cls.name for cls in finding.others}
    found += [
        {"name": cls.name, "status": status, "why": why, **UNTRIED}
        for cls, (status, why) in finding.others.items()
    ]
    found += [
        {"name": name, "status": "not_observable", "why": _unseen(cls), **UNTRIED}
        for name, cls in Effect.library.items()
        if sensor in cls.sensors and name not in listed
    ]
    return found


def _unseen(cls):
    if cls.name == "bias_drift":
        return "in a static record it is called ramp"
    if cls.name == "turn_on_bias":
        return "every static record has a level of its own: see its scatter from run to run"
    return "in one attitude, without a turn, it cannot be told from the bias"


def _candidate(sensor, finding, cls, settings):
    search, base = finding.search, finding.base
    kinds = [type(p.effect) for p in base]
    if cls in kinds:
        before = base[: kinds.index(cls)]
        trial = finding.choice.passed[kinds.index(cls)].trial
        status, why = "added", "lowers the residual in the fit and in held-out blocks of time"
    else:
        before, trial = base, search.trial(base, cls)
        status, why = "rejected", "the residual does not fall by more than chance"
    if trial is None:
        alone = search.trial((), cls)
        why = "what it adds in these data is taken up by the bias"
        twin = _holder(search, base, alone) if alone else None
        if twin is None:
            return {"name": cls.name, "status": "not_observable", "why": why, **UNTRIED}
        before, trial = (), alone
        status, why = "confounded", f"{twin} adds all that it would: they are one in these data"
    else:
        twin = None if status == "added" else _twin(search, base, cls)
        if status != "added" and cls in finding.choice.failed:
            low, high = finding.choice.failed[cls]
            why = f"held-out error does not fall for certain: ratio {low:.3f} to {high:.3f}"
        elif trial.impossible:
            why = f"it would have to be larger than {cls.limit:g}, the most that is possible"
        elif twin:
            status = "confounded"
            why = f"in these data it could stand in for {twin}: neither adds to the other"
        twin = twin if status == "confounded" else None
    found = detection_limits(search, before, trial, settings.power)
    if status == "rejected" and (hidden := unseen(cls, found)):
        status, why, found = "not_observable", hidden, None
    return {
        "name": cls.name,
        "status": status,
        "why": why,
        "residual": RESIDUAL,
        "p_value": trial.p_value,
        "heldout_after": size(np.concatenate(finding.blocks.following((cls,)))),
        "constants": asdict(trial.pattern.effect),
        "confounded_with": twin,
        "detection_limit": found,
        "units": trial.pattern.effect.units(sensor),
    }


def _holder(search, base, alone):
    """Return the added effect without which a candidate can be tried, or None."""
    for pattern in base:
        others = tuple(p for p in base if p is not pattern)
        if search.test(others, alone.pattern):
            return pattern.name
    return None


def _twin(search, base, cls):
    """Return the name of an added effect that a candidate could stand in for, or None.

    It could if in its place it passes the test, and the effect beside it then does not.
    """
    for pattern in reversed(base):
        others = tuple(p for p in base if p is not pattern)
        instead = search.trial(others, cls)
        if not instead or instead.impossible or instead.log_p >= search.threshold(len(others)):
            continue
        beside = search.test((*others, instead.pattern), pattern)
        if beside is None or beside.log_p >= search.threshold(len(base)):
            return pattern.name
    return None


def _process(sensor, finding, settings):
    """Return the entry of noise with a correlation time."""
    process, name = finding.process, GaussMarkov.name
    if process is None:
        why = "too few means without a gap for a spectrum"
        return {"name": name, "status": "not_observable", "why": why, **UNTRIED}
    test, threshold = process.test, finding.search.threshold(len(finding.base))
    tc, found = limits(test, process.spectra, process.window, threshold, settings.power)
    if finding.has_process:
        status, tc = "added", test.tc
        why = (
            "the spectrum is likelier with it; held-out error is what is foreseen of it, by the "
            "predictive likelihood, for noise cannot be subtracted"
        )
    elif not any(found):
        why = "flicker and walk would imitate it in records as short as these"
        return {"name": name, "status": "not_observable", "why": why, **UNTRIED}
    else:
        status, why = "rejected", "the spectrum is not likelier with it by more than chance"
        if test.log_p < threshold:
            low, high = process.ratio
            why = f"held-out blocks are not likelier for certain: ratio {low:.3f} to {high:.3f}"
    return {
        "name": name,
        "status": status,
        "why": why,
        "residual": RESIDUAL,
        "p_value": test.p_value,
        "heldout_after": process.share * size(np.concatenate(finding.after)),
        "constants": {"tc": tc},
        "confounded_with": None,
        "detection_limit": {
            p: q for p, q in zip(GaussMarkov.parameters, found, strict=True) if q is not None
        },
        "units": GaussMarkov().units(sensor),
    }


def _patterns(search):
    """Return the patterns of the effects with listed shapes, as white noise sees them."""
    found = {}
    weights = [np.sqrt(r.length)[:, None, None] for r in search.sight.model.fitted]
    for patterns in search.shapes.values():
        for pattern in patterns:
            if search.test((), pattern) is None:
                continue
            parts = [w * (d - d.mean(axis=0)) for w, d in zip(weights, pattern.fitted, strict=True)]
            stacked = np.concatenate(parts)
            found.setdefault(pattern.name, []).append(stacked.reshape(-1, stacked.shape[2]))
    return found


def _by_session(finding):
    """Return the effects fitted to each session alone, together if it tells them apart."""
    patterns = tuple(p for p in finding.base if not isinstance(p.effect, SCANS))
    found = {p.name: {} for p in patterns}
    for session in _sessions(finding):
        alone = StaticSearch(one_session(finding.model, session), {}, 1.0, 1)
        own = fitted(alone, patterns)
        if own is None:
            own = sum((fitted(alone, (p,)) or () for p in patterns), ())
        for effect in own:
            found[effect.name][session] = {
                name: {"value": value, "std": effect.std[name]}
                for name, value in effect.values.items()
            }
    return found


def _points(finding, floor):
    """Return one entry a mean, for pictures."""
    points = []
    for i, record in enumerate(finding.model.records):
        left = record.values
        for pattern, effect in zip(finding.base, finding.effects, strict=True):
            left = left - pattern.means[i] @ _vector(effect)
        raw, left = (v - v.mean(axis=0) for v in (record.values, left))
        before, after = (np.linalg.norm(e[i], axis=1) for e in (finding.before, finding.after))
        for k, start in enumerate(record.windows[:, 0]):
            points.append(
                {
                    "residual": RESIDUAL,
                    "index": k,
                    "session": record.session,
                    "start_s": float(start),
                    "before": float(before[k]),
                    "after": float(after[k]),
                    "values": raw[k].tolist(),
                    **({"corrected": left[k].tolist()} if finding.base else {}),
                    "floor": float(np.sqrt(floor[i][k].sum())),
                }
            )
    return points
