"""What diagnosis.json holds of the static records of a sensor."""

import numpy as np

from imuloop.calibrate.noise_components import FARTHEST
from imuloop.core.effect import Effect
from imuloop.core.samples import SENSORS
from imuloop.diagnose.choice import ratio_interval
from imuloop.diagnose.content import residual_entry, search_content, untried
from imuloop.diagnose.records.probes import of_means
from imuloop.diagnose.records.static import fitted_effects
from imuloop.diagnose.residuals import held_out_covariance, size
from imuloop.diagnose.search import Search
from imuloop.diagnose.verdict import MARGIN, RESIDUALS, judge, verdict
from imuloop.effects.drifts import GaussMarkov

UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
# why a static record cannot show what the poses can
UNSEEN = {
    "bias_drift": "in a static record it is called ramp",
    "turn_on_bias": ("every static record has a level of its own: see its scatter from run to run"),
}


def static_content(sensor, finding, noise, change, processes):
    """Return the contract's fields of a sensor's Finding.

    `noise` is that of the records without the effects, the floor; `change` holds its coefficients
    before and after, by axis, where something was added; `processes` are AxisProcesses by axis.
    """
    choices, axes = finding.choices, SENSORS[sensor]
    problem, settings = choices.problem, choices.problem.settings
    kind, errors = problem.residual, (finding.before, finding.after)
    sides = zip(((), finding.effects), errors, strict=True)
    judged = [_judged(problem, *side, noise, axes) for side in sides]
    floor = _floor(problem, noise, axes)
    process, why = _process(sensor, processes, settings)
    added = [e.name for e in finding.effects] + [GaussMarkov.name] * bool(process)
    share = settings.significance / RESIDUALS / settings.family
    residual, above = residual_entry(
        problem, kind, UNITS[sensor], slice(None), judged, errors, floor, share, bool(added)
    )
    library = finding.effects[: len(choices.choice().added)]
    found = search_content(choices, library, finding.others, of_means(problem), sensor)
    for entry, own in zip(found["effects"], choices.choice().added, strict=True):
        entry["axis"] = axes[own.trial.axis] if own.before.shape[1] == 1 else None
    if finding.further:
        found["discovered"] = finding.further.content
        if finding.further.choices:
            found |= finding.further.joined(found["effects"], found["candidates"], finding.effects)
    found["effects"] += [process] if process else []
    tried = found["candidates"]
    tried.append(untried(GaussMarkov.name, "added" if process else "not_observable", why))
    listed = {c["name"] for c in tried}
    tried += [
        untried(
            name,
            "not_observable",
            UNSEEN.get(name, "in one attitude, without a turn, it cannot be told from the bias"),
        )
        for name, cls in Effect.library.items()
        if sensor in cls.sensors and name not in listed
    ]
    return {
        "verdict": verdict(*above, added),
        # the noise was estimated from what is left here: it can have taken up a pattern
        "slow_noise": bool(residual["after"] > MARGIN * residual["floor"] and not above[1]),
        "residuals": {kind: residual | {"sessions": _by_axis(axes, finding, floor)}},
        **found,
        "by_session": _by_session(choices),
        "noise": change,
        "points": _points(finding, floor),
    }


def _process(sensor, processes, settings):
    """Return the entry of noise with a correlation time, None where it is no effect, and why."""
    if not processes:
        return None, "the noise stage finds none"

    def ratio(each):
        before = np.column_stack([p.before for p in each])
        after = np.column_stack([p.after for p in each])
        return ratio_interval(each[0].fold, before, after, settings)

    intervals = {axis: ratio([p]) for axis, p in processes.items()}
    axes = [axis for axis, ends in intervals.items() if ends[1] < 1]
    if not axes:
        low, high = min(intervals.values(), key=lambda ends: ends[1])
        why = f"the noise has it, but it foretells no mean better: ratio {low:.3f} to {high:.3f}"
        return None, why
    terms = {f"{key}{a[1]}": getattr(processes[a].term, key) for key in ("q", "tc") for a in axes}
    each = [processes[axis] for axis in axes]
    ends = {name: c.ci95 or (c.value, c.value) for name, c in terms.items()}
    units = GaussMarkov().units(sensor)
    entry = {
        "name": GaussMarkov.name,
        "constants": {},
        "parameters": {name: c.value for name, c in terms.items()},
        "std": {name: (high - low) / 3.92 for name, (low, high) in ends.items()},
        "units": {name: units[name] for name in terms},
        # the noise stage has its own test
        "p_value": None,
        "residual": "bias",
        "axis": axes[0] if len(axes) == 1 else None,
        "heldout_before": size(np.column_stack([p.before for p in each])),
        "heldout_after": size(np.column_stack([p.after for p in each])),
        "ratio_ci95": ratio(each),
    }
    return entry, "found by the noise stage; it foretells the next mean better"


def _floor(problem, noise, axes):
    """Return the variance that noise alone gives the errors without effects, (M, 3).

    The slow noise at the windows of the fit, the rest at the means' own.
    """
    found = []
    parts = zip(problem.records, problem.merged, problem.evidence.blocks, strict=True)
    for record, merged, block in parts:
        windows, length = merged.windows, merged.length
        at = np.searchsorted(windows[:, 0], record.windows[:, 0], side="right") - 1
        columns = []
        for process in (noise.axes[name] for name in axes):
            # the level is the mean of what is seen
            slow = held_out_covariance(
                process.mean_covariance(windows), block.nuisance, block.folds, np.diag(length)
            ).diagonal()
            own, fast = (
                process.N.square / t + 2 * process.Q.square / t**2
                for t in (record.length, length[at])
            )
            columns.append(slow[at] + own - fast)
        found.append(np.column_stack(columns))
    return np.concatenate(found)


def _judged(problem, effects, errors, noise, axes):
    """Return the Judged of the means less effects about their levels, and of held-out errors.

    By the noise as estimated, and with flicker and walk at the ends of their intervals.
    """
    evidence = problem.evidence
    taken = [problem.design(e.effect) @ e.vector for e in effects]
    left = np.concatenate([r.values for r in problem.merged]) - sum(taken, np.zeros(()))
    blocks = list(zip(evidence.split(left), evidence.blocks, problem.merged, strict=True))
    fitted = sum(len(c) for p in evidence.patterns([e.effect for e in effects]) for c in p.columns)
    known = {(axis, term): noise.known(axis, term) for axis in axes for term in "BK"}
    most = noise.with_sizes({key: size + FARTHEST * std for key, (size, std) in known.items()})
    alternatives = [
        (
            0.0,
            [
                (
                    values[:, k],
                    model.axes[name].mean_covariance(record.windows),
                    block.nuisance,
                    block.folds,
                    [np.ones(len(values), dtype=bool)],
                )
                for values, block, record in blocks
                for k, name in enumerate(axes)
            ],
        )
        for model in (noise, most)
    ]
    # errors of all means are those of the windows of the fit
    square, ends = 0.0, np.cumsum([len(r.windows) for r in problem.records])[:-1]
    each = zip(problem.records, problem.merged, np.split(errors, ends), strict=True)
    for record, merged, own in each:
        first = np.searchsorted(record.windows[:, 0], merged.windows[:, 0])
        mean = np.add.reduceat(own, first) / np.diff(np.append(first, len(own)))[:, None]
        square += (mean**2).sum()
    _, (judged,) = judge(alternatives, [square], fitted)
    return judged


def _by_axis(axes, finding, floor):
    """Return the held-out errors of each session and axis."""
    problem = finding.choices.problem
    session = np.concatenate([np.repeat(r.session, len(r.windows)) for r in problem.records])
    squares = {"before": finding.before**2, "after": finding.after**2, "floor": floor}
    return {
        str(own): {
            name: {key: float(np.sqrt(s[session == own, k].mean())) for key, s in squares.items()}
            for k, name in enumerate(axes)
        }
        for own in dict.fromkeys(session)
    }


def _by_session(choices):
    """Return the parameters of each effect, with standard errors, fitted to each session alone.

    All together; one by one in a session where they are not told apart. Lines and steps are of
    their sessions anyway.
    """
    problem = choices.problem
    base = tuple(e for e in choices.choice().base if e.kind not in problem.scans)
    found = {e.name: {} for e in base}
    for session in dict.fromkeys(r.session for r in problem.records if base):
        alone = Search(problem.of_session(session), frozenset())
        own = fitted_effects(alone, base)
        if own is None:
            own = sum((fitted_effects(alone, (e,)) or () for e in base), ())
        for effect in own:
            found[effect.name][session] = {
                name: {"value": value, "std": effect.std[name]}
                for name, value in effect.values.items()
            }
    return found


def _points(finding, floor):
    """Return one entry per mean, for pictures."""
    points, problem = [], finding.choices.problem
    ends = np.cumsum([len(r.windows) for r in problem.records])[:-1]
    parts = (np.split(v, ends) for v in (finding.before, finding.after, floor))
    for i, (record, before, after, own) in enumerate(zip(problem.records, *parts, strict=True)):
        left = record.values
        for effect in finding.effects:
            left = left - problem.derivatives(effect.effect)[i] @ effect.vector
        raw, left = (v - v.mean(axis=0) for v in (record.values, left))
        for k, start in enumerate(record.windows[:, 0]):
            points.append(
                {
                    "residual": problem.residual,
                    "index": k,
                    "session": record.session,
                    "start_s": float(start),
                    "before": float(np.linalg.norm(before[k])),
                    "after": float(np.linalg.norm(after[k])),
                    "values": raw[k].tolist(),
                    **({"corrected": left[k].tolist()} if finding.effects else {}),
                    "floor": float(np.sqrt(own[k].sum())),
                }
            )
    return points
