"""Comparison to a reference: effects of the set-up, and the residuals that remain."""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, chdtri, chndtrinc

from imuloop.calibrate.reference import fit_set_up
from imuloop.calibrate.reference_windows import LEAST_WINDOWS, read_reference, windows_of
from imuloop.core.samples import SENSORS
from imuloop.core.tables import joined
from imuloop.diagnose.tables import no_tables
from imuloop.estimate.held_out import ratio_interval, rms_norm
from imuloop.estimate.verdict import not_testable, verdict
from imuloop.model.effect import OUTPUT

FEW = f"fewer than {LEAST_WINDOWS} windows in which a reference is compared"


def diagnose_reference(sessions, noise, gravity, settings, tests, calibration):
    """Return the comparison of a device with the reference of the sessions that have one.

    A reference is a measurement of the motion by other means, such as tracked markers. The
    comparison says whether errors remain that the `calibration` does not explain.

    Parameters
    ----------
    sessions : dict of str to dict
        ``kind``, ``samples`` and ``segments`` of each session by name.
    noise : NoiseModel
        Noise of the device.
    gravity : float
        Local gravity, m/s^2.
    settings : DiagnoseSettings
        Number of folds, significance and power of the tests.
    tests : int
        Number of tests of the other records, which share the significance.
    calibration : Calibration
        The calibration from the other records.

    Returns
    -------
    dict
        Fields of diagnosis.json by sensor. The dict is empty if no session has a reference. A
        sensor has the verdict ``not_testable`` if too few windows can be compared.
    dict of str to ndarray
        Columns of reference.parquet.
    """
    content, tables = dict.fromkeys(SENSORS, not_testable(FEW)), [no_tables()["reference"]]
    if "reference_motion" not in [session["kind"] for session in sessions.values()]:
        return {}, *tables
    logs = read_reference(sessions, calibration)
    windows_by_sensor = windows_of([*logs.values()], gravity, calibration)
    if not windows_by_sensor:
        return content, *tables
    set_up, (log, *other_logs) = fit_set_up(windows_by_sensor, noise), windows_by_sensor[0].logs
    tests += settings.family * sum(len(w.effects) for w in windows_by_sensor)
    # a fold is a whole session, or a stretch of time where there is one session
    count = settings.folds
    folds = set_up.of_windows(lambda w: w.session if other_logs else count * w.first // len(log.t))
    for windows in windows_by_sensor:
        sensor, session = windows.sensor, windows.session
        content[sensor], columns = _diagnose_sensor(set_up, windows, folds, settings, tests)
        sensor_calibration = getattr(calibration, sensor)
        content[sensor]["set_up"] = _by_session(set_up, windows, logs, sensor_calibration)
        number = np.arange(len(session)) - np.searchsorted(session, session)
        columns |= {"session": np.array([*logs], object)[session], "pose": number}
        columns |= {"start_s": windows.t[:, 0], "end_s": windows.t[:, -1]}
        tables.append(dict.fromkeys(tables[0], np.full(len(session), np.nan)) | columns)
    return content, joined(tables)


def _diagnose_sensor(set_up, windows, folds, settings, tests):
    """Return the tested effects of the set-up on one sensor, and its residuals with their floor.

    The set-up is the offset of the clock, the mounting, the place of the marker and the biases. The
    residuals are the differences from the reference, a measurement of the motion by other means.
    The floor is the root mean square held-out error that noise alone gives.

    Parameters
    ----------
    set_up : SetUp
        The fit of the set-up, with N rows (scalar residuals) of all sensors.
    windows : Windows
        Stretches of time in which the sensor is compared with the reference.
    folds : ndarray, shape (N,)
        Fold of each row; the rows of a fold are held out together.
    settings : DiagnoseSettings
        Number of folds, significance and power of the tests.
    tests : int
        Number of tests that share the significance.

    Returns
    -------
    dict
        Fields of diagnosis.json.
    dict of str to ndarray
        Columns of reference.parquet with an entry per window.
    """
    rows = set_up.of_windows(lambda w: np.full(len(w.session), w is windows))
    after, scale = set_up.errors(folds)[rows, None], np.sqrt(set_up.variance[rows, None])
    # `added` has the indices of the parameters of added effects; `chance` is the p-value at which
    # an effect passes its test
    effects, candidates, added, chance = [], [], [], settings.significance / tests
    for name, units in windows.effects.items():
        index = windows.shared[[[*windows.units].index(name) for name in units]].tolist()
        covariance = set_up.covariance[np.ix_(index, index)]
        # held-out errors of a fit without these parameters
        before = set_up.errors(folds, index)[rows, None]
        interval = ratio_interval(folds[rows], before / scale, after / scale)
        values, q = set_up.x[index], len(index)
        p_value = chdtrc(q, values @ np.linalg.solve(covariance, values))
        entry = {"name": name, "p_value": float(p_value), "residual": windows.kind}
        entry |= _parameters(units, values, covariance) | {"heldout_after": _size(after)}
        passed = p_value < chance and interval[1] < 1
        if passed:
            added = added + index
            effects.append(entry | {"heldout_before": _size(before), "ratio_ci95": interval})
        # size, in standard errors, at which χ² passes the test with the wanted power
        deviations = chndtrinc(chdtri(q, chance), q, 1 - settings.power) ** 0.5
        entry["detection_limit"] = {name: deviations * std for name, std in entry["std"].items()}
        entry["why"] = "fitted; ratio of held-out errors {:.3f} to {:.3f}".format(*interval)
        entry |= {"status": "added" if passed else "rejected", "confounded_with": None}
        candidates.append(entry)
    floor, above = np.sqrt(set_up.floor[rows]), []
    residual = {"unit": windows.unit, "n": len(windows.session), "floor": _size(floor)}
    columns = {"residual": np.full(len(windows.session), windows.kind, object)}
    columns[f"{windows.kind}_floor"] = _norm(floor)
    dof = max(len(floor) - len(windows.shared) - windows.places.size, 1)
    for key, without in (("before", added), ("after", [])):
        heldout = set_up.errors(folds, without)[rows]
        # with all rows in no fold, -1, the residuals of a fit to all rows
        in_sample = set_up.errors(np.full_like(folds, -1), without)[rows]
        chi2 = ((in_sample / floor) ** 2).sum()
        residual |= {key: _size(heldout), f"chi2_{key}": float(chi2 / dof)}
        columns[f"{windows.kind}_{key}"] = _norm(heldout)
        too_large = chdtrc(dof, chi2) < settings.residual_significance
        above.append(too_large and residual[key] > residual["floor"])
    content = {"verdict": verdict(*above, bool(added)), "residuals": {windows.kind: residual}}
    content |= {"effects": effects, "candidates": candidates, "confounded": []}
    return content, columns


def _by_session(set_up, windows, logs, calibration):
    """Return the bias and the mounting of a sensor in each session, a dict by session.

    Each value of the dict has the fields of diagnosis.json. The bias b is in nominal SI: raw
    readings by the nominal scale. The mounting is a rotation vector m, rad, which rotates from the
    axes of the IMU to the axes of the tracked body. `set_up` is the fit of the set-up, `windows`
    are the Windows of the sensor, `logs` has the ReferenceLog of each session, and `calibration` is
    the SensorCalibration.
    """
    names, units = ("bx", "by", "bz", "mx", "my", "mz"), [OUTPUT[windows.sensor]] * 3 + ["rad"] * 3
    content, units = {}, dict(zip(names, units, strict=True))
    to_nominal = np.linalg.inv(calibration.T * calibration.K / calibration.raw_unit.scale)
    for (name, log), index in zip(logs.items(), windows.places[:, :6], strict=True):
        bias = calibration.raw_unit.to_si(calibration.b) + to_nominal @ set_up.x[index[:3]]
        mounting = Rotation.from_matrix(log.frame) * Rotation.from_rotvec(set_up.x[index[3:]])
        values = np.append(bias, mounting.as_rotvec())
        content[name] = _parameters(units, values, set_up.covariance[np.ix_(index, index)])
    return content


def _parameters(units, values, covariance):
    """Return the fields of diagnosis.json for p parameters: values, standard errors and units.

    `units` has the unit of each parameter by name; `values`, (p,), and `covariance`, (p, p), are in
    these units.
    """
    std = np.sqrt(np.diag(covariance))
    values, std = (dict(zip(units, x.tolist(), strict=True)) for x in (values, std))
    return {"parameters": values, "std": std, "units": units, "constants": {}}


def _norm(errors):
    """Return the norms, (m,), of m residuals; `errors`, (3 m,), has three components of each."""
    return np.linalg.norm(errors.reshape(-1, 3), axis=1)


def _size(errors):
    """Return the root mean square norm of m residuals, a float.

    `errors`, (3 m,) or (3 m, 1), has the three components of one residual after the other.
    """
    return rms_norm(errors.reshape(-1, 3))
