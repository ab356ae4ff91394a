"""The prior of a device from a file: an earlier calibration of it, or the family of its type."""

import numpy as np

# a calibration may hold any effect of the library
import imuloop.effects  # noqa: F401
from imuloop.calibrate.sessions import hashes, layout
from imuloop.core.errors import ImuloopError, nearest
from imuloop.core.files import read_json
from imuloop.effects.turn_on_bias import turn_on_std
from imuloop.family import LEAST_OTHERS
from imuloop.family.random_effects import fit
from imuloop.model.calibration import Calibration
from imuloop.model.prior import DATA_SHEET
from imuloop.model.raw_units import state_of
from imuloop.model.state import BASE, NAMES

# eigenvalue of a correlation matrix below which it is singular
_SMALLEST = 1e-13


def read_prior(sheet, file, device, sessions, type=None):
    """Return the Prior of a device by a file: mean and covariance of its parameters.

    A parameter that is not in the file keeps the prior of the data sheet.

    Parameters
    ----------
    sheet : Prior
        Prior by the data sheet.
    file : path-like
        An earlier calibration.json of the device, or the family.json of its type.
    device : str
        Name of the device, which is left out of the family.
    sessions : dict of str to dict
        For each session that is to be calibrated, by name, its ``kind`` and the path of its
        ``samples``.
    type : str, optional
        Name of the device's type; needed if a family.json holds several types.

    Raises
    ------
    ImuloopError
        If the file gives no prior for this device.
    """
    try:
        content = read_json(file)
        if isinstance(content, dict) and "types" in content:
            prior = _of_family(sheet, _content_on_type(content, type), device, str(file))
        elif isinstance(content, dict) and "accelerometer" in content:
            calibration = Calibration.from_json(file)
            _refuse_same_logs(calibration, sessions)
            prior = of_calibration(sheet, calibration, str(file))
        else:
            raise ImuloopError("neither a calibration.json nor a family.json")
    except OSError as error:
        raise ImuloopError(f"prior: {file}: cannot be read: {error.strerror}") from error
    except ImuloopError as error:
        why = str(error).removeprefix(f"{file}: ")
        raise ImuloopError(f"prior: {file}: {why}") from error
    return prior


def of_calibration(prior, calibration, source):
    """Return the Prior of a device by its Calibration from earlier logs.

    The misalignments, scale factors and biases that `calibration`, the Calibration, estimated have
    the mean and the covariance of this estimate. All others keep the values of `prior`, a Prior.
    The variance of a bias includes the scatter between power cycles. `source` is the name of the
    calibration's file.
    """
    if not calibration.measured:
        raise ImuloopError("nothing was measured there")
    # parameters without effects in nominal SI, and their covariance
    state, state_covariance = state_of(calibration, ())
    for sensor, names in NAMES.items():
        earlier, part = getattr(calibration, sensor), BASE[sensor]
        estimated = np.isin(names, earlier.names)
        if not estimated.any():
            continue
        mean, covariance = (values.copy() for values in prior.of(sensor))
        # the biases, the last three parameters, also scatter between power cycles
        scatter = np.append(np.zeros(len(names) - 3), np.square(turn_on_std(earlier, sensor)))
        mean[estimated] = state.x[part][estimated]
        block = np.ix_(estimated, estimated)
        covariance[block] = (state_covariance[part, part] + np.diag(scatter))[block]
        std = np.sqrt(np.diag(covariance))
        if not std.all() or np.linalg.eigvalsh(covariance / np.outer(std, std))[0] < _SMALLEST:
            raise ImuloopError(f"{sensor}: the covariance is singular")
        prior = prior.with_sensor(sensor, source, mean, covariance)
    return prior


def _refuse_same_logs(calibration, sessions):
    """Raise an ImuloopError if a Calibration cannot be the prior of a fit to the `sessions`.

    `calibration` is the Calibration. There are two cases. In the first, it was fitted to one of the
    sessions' logs, which would count twice, as prior and as data. Exception: a static log may be in
    both, because only its noise is used. In the second case, the same columns of the log are
    assigned to the axes in another order or with other signs than in the sessions. `sessions` has
    for each session, by name, its ``kind`` and the path of its ``samples``.
    """
    with_poses = {name: s for name, s in sessions.items() if s["kind"] != "static"}
    if {*hashes(with_poses)} & {*calibration.sha256}:
        raise ImuloopError(
            "the calibration is from one of these logs (the same SHA-256), which would count "
            "twice: leave out that log, or the prior"
        )
    earlier, now = (log.get("columns", {}) for log in (calibration.log, layout(sessions)))
    for quantity in ("acceleration", "angular_rate"):
        axes = [columns.get(quantity) for columns in (earlier, now)]
        # the same columns in another order, or with other signs, are other axes
        names = [[str(name).lstrip("-") for name in columns or ()] for columns in axes]
        if axes[0] != axes[1] and sorted(names[0]) == sorted(names[1]):
            before, after = (", ".join(map(str, columns)) for columns in axes)
            raise ImuloopError(
                f"its axes are others: columns.{quantity} was [{before}] and is [{after}]; name "
                "the columns as there"
            )


def _content_on_type(content, type):
    """Return the part of a family.json that is about one type of device, a dict.

    `content` is the content of the file. `type` is the name of the type, or None if the file has a
    single type. Raises an ImuloopError if there is no such type.
    """
    types = content["types"] if isinstance(content["types"], dict) else {}
    if type is None and len(types) == 1:
        (type,) = types
    if type is None:
        raise ImuloopError(f"of which type, {' or '.join(types)}? In a config name the device's")
    if type not in types:
        raise ImuloopError(f"there is no type '{type}'{nearest(type, types)}")
    return types[type]


def _of_family(prior, content, device, source):
    """Return the Prior of a device by the n other devices of its type.

    `content` is the part of family.json on the type, `device` the name of the device, and `source`
    the name of the file. A parameter that fewer than `LEAST_OTHERS` others determined keeps the
    values of `prior`, a Prior. Every other parameter has a normal prior with the mean μ of the n
    devices. Its variance is ``τ² + var(μ)``, the variance of a new device, where τ is the spread
    between devices, times ``(n - 1)/(n - 3)``, the variance of Student's t with n - 1 degrees of
    freedom.

    References
    ----------
    J. Higgins, S. Thompson, D. Spiegelhalter, "A re-evaluation of random-effects meta-analysis", J.
    R. Stat. Soc. A 172 (2009), 137, section 5.
    """
    for sensor, names in NAMES.items():
        mean, covariance = (values.copy() for values in prior.of(sensor))
        has_values = False
        for k, name in enumerate(names):
            y, std = _others(content, f"{sensor}.{name}", device)
            if len(y) >= LEAST_OTHERS:
                model, has_values = fit(y, std**2), True
                # the family has scale factors minus 1
                mean[k] = model.mean[0] + (name[0] == "K")
                variance_of_t = model.dof[0] / (model.dof[0] - 2)
                variance_of_new_device = model.variance[0] + model.mean_variance[0]
                covariance[k, k] = variance_of_new_device * variance_of_t
        if has_values:
            prior = prior.with_sensor(sensor, source, mean, covariance)
    if set(prior.sources.values()) == {DATA_SHEET}:
        raise ImuloopError(f"fewer than {LEAST_OTHERS} other devices determined any parameter")
    return prior


def _others(content, name, device):
    """Return the values of a parameter in all n devices but `device`, and their errors, (n,) each.

    `content` is the part of family.json on the type of the device, and `name` the name of the
    parameter there. The errors are standard errors. Raises an ImuloopError if the content is
    damaged.
    """
    try:
        entry = content["parameters"].get(name, {"devices": (), "values": (), "std": ()})
        triples = zip(entry["devices"], entry["values"], entry["std"], strict=True)
        rows = np.array([(y, std) for other, y, std in triples if other != device], dtype=float)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ImuloopError(f"damaged: {name}: {error!r}") from error
    y, std = rows.reshape(-1, 2).T
    if not (np.isfinite(rows).all() and (std > 0).all()):
        raise ImuloopError(f"damaged: {name} has a value or a standard error that is not valid")
    return y, std
