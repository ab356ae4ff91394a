"""Comparison to a reference: effects of the set-up, and the residuals that remain."""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, chdtri, chndtrinc

from imuloop.calibrate.reference import LEAST_WINDOWS, fit_set_up, read_reference, windows_of
from imuloop.core.samples import SENSORS
from imuloop.core.tables import joined
from imuloop.diagnose.records.pose_tables import no_tables
from imuloop.estimate.error_ratio import ratio_interval
from imuloop.estimate.residuals import size
from imuloop.estimate.verdict import RESIDUALS, not_testable, verdict
from imuloop.model.effect import OUTPUT

FEW = f"fewer than {LEAST_WINDOWS} windows in which a reference is compared"


def diagnose_reference(sessions, noise, gravity, settings, tests, calibration):
    """Return the fields of diagnosis.json by sensor, and the columns of reference.parquet.

    The fields are an empty dict without a session with a reference, and “not testable” where too
    few windows can be compared. `sessions` has ``kind``, ``samples``
    and ``segments`` of each session by name; `noise` is the NoiseModel, `gravity` local gravity,
    m/s^2, `tests` the number of tests of the other records, which share the significance, and
    `calibration` the Calibration from these records.
    """
    content, tables = dict.fromkeys(SENSORS, not_testable(FEW)), [no_tables()["reference"]]
    if "reference_motion" not in [session["kind"] for session in sessions.values()]:
        return {}, *tables
    logs = read_reference(sessions, calibration)
    windows = windows_of([*logs.values()], gravity, calibration)
    if not windows:
        return content, *tables
    found, (log, *others), count = fit_set_up(windows, noise), windows[0].logs, settings.folds
    tests += settings.family * sum(len(w.effects) for w in windows)
    # a fold is a whole session, or a stretch of time where there is one session
    folds = found.of_windows(lambda w: w.session if others else count * w.first // len(log.t))
    for w in windows:
        block, columns = _judged(found, w, folds, settings, tests)
        block["set_up"] = _of_sessions(found, w, logs, getattr(calibration, w.sensor))
        content[w.sensor], number = block, np.searchsorted(w.session, w.session)
        columns |= {"session": np.array([*logs], object)[w.session], "start_s": w.t[:, 0]}
        columns |= {"pose": np.arange(len(number)) - number, "end_s": w.t[:, -1]}
        tables.append(dict.fromkeys(tables[0], np.full(len(number), np.nan)) | columns)
    return content, joined(tables)


def _judged(found, w, folds, settings, tests):
    """Return the fields of diagnosis.json of one sensor, and its columns of reference.parquet.

    `found` is the fit of the set-up, `w` the Windows of the sensor, and `folds` the fold of each
    row.
    """
    rows = found.of_windows(lambda each: np.full(len(each.session), each is w))
    after, scale = found.errors(folds)[rows, None], np.sqrt(found.variance[rows, None])
    effects, candidates, added, chance = [], [], [], settings.significance / tests
    for name, units in w.effects.items():
        at = w.shared[[[*w.units].index(name) for name in units]].tolist()
        own, before = found.covariance[np.ix_(at, at)], found.errors(folds, at)[rows, None]
        interval = ratio_interval(folds[rows], before / scale, after / scale)
        p_value = chdtrc(len(at), found.x[at] @ np.linalg.solve(own, found.x[at]))
        entry = {"name": name, "p_value": float(p_value), "residual": w.kind}
        entry |= _parameters(units, found.x[at], own) | {"heldout_after": size(_norm(after))}
        passed = p_value < chance and interval[1] < 1
        if passed:
            added = added + at
            effects.append(entry | {"heldout_before": size(_norm(before)), "ratio_ci95": interval})
        # size, in standard errors, at which χ² passes the test with the wanted power
        least = chndtrinc(chdtri(len(at), chance), len(at), 1 - settings.power) ** 0.5
        entry["detection_limit"] = {name: least * std for name, std in entry["std"].items()}
        entry["why"] = "fitted; ratio of held-out errors {:.3f} to {:.3f}".format(*interval)
        entry |= {"status": "added" if passed else "rejected", "confounded_with": None}
        candidates.append(entry)
    floor, above = np.sqrt(found.floor[rows]), []
    residual = {"unit": w.unit, "n": len(w.session), "floor": size(_norm(floor))}
    columns = {"residual": np.full(len(w.session), w.kind, object)}
    columns[f"{w.kind}_floor"] = _norm(floor)[:, 0]
    for key, without in (("before", added), ("after", [])):
        held, fitted = (found.errors(p, without)[rows] for p in (folds, np.full_like(folds, -1)))
        dof = max(len(floor) - len(w.shared) - w.places.size, 1)
        chi2 = ((fitted / floor) ** 2).sum()
        residual |= {key: size(_norm(held)), f"chi2_{key}": float(chi2 / dof)}
        columns[f"{w.kind}_{key}"] = _norm(held)[:, 0]
        share = settings.significance / RESIDUALS / settings.family
        above.append(chdtrc(dof, chi2) < share and residual[key] > residual["floor"])
    content = {"verdict": verdict(*above, bool(added)), "residuals": {w.kind: residual}}
    content |= {"effects": effects, "candidates": candidates, "confounded": []}
    return content, columns


def _of_sessions(found, w, logs, calibration):
    """Return bias b, nominal SI, and mounting, a rotation vector m, rad, for each session."""
    names, units = ("bx", "by", "bz", "mx", "my", "mz"), [OUTPUT[w.sensor]] * 3 + ["rad"] * 3
    content, units = {}, dict(zip(names, units, strict=True))
    back = np.linalg.inv(calibration.T * calibration.K / calibration.raw_unit.scale)
    for (name, log), at in zip(logs.items(), w.places[:, :6], strict=True):
        bias = calibration.raw_unit.to_si(calibration.b) + back @ found.x[at[:3]]
        turn = Rotation.from_matrix(log.frame) * Rotation.from_rotvec(found.x[at[3:]])
        values = np.append(bias, turn.as_rotvec())
        content[name] = _parameters(units, values, found.covariance[np.ix_(at, at)])
    return content


def _parameters(units, values, covariance):
    """Return the fields of diagnosis.json for parameters: values, standard errors and units."""
    found = {"parameters": values, "std": np.sqrt(np.diag(covariance))}
    found = {k: dict(zip(units, v.tolist(), strict=True)) for k, v in found.items()}
    return found | {"units": units, "constants": {}}


def _norm(errors):
    """Return the norms of residuals of three components, (3 m,) or (3 m, 1), as (m, 1)."""
    return np.linalg.norm(errors.reshape(-1, 3), axis=1, keepdims=True)
