"""A prior from the other devices of a type, for one that has too little data of its own."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError

# a calibration may hold any effect of the library
import imuloop.effects  # noqa: F401
from imuloop.calibrate.least_squares import known_rows, why_no_fit
from imuloop.calibrate.raw_units import as_logged, si_factor
from imuloop.calibrate.sensor_pair import BASES, SensorPair, places
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.family import LEAST_OTHERS
from imuloop.family.estimates import of_calibrations
from imuloop.family.random_effects import fit

# methods whose data are not the poses of the fit
ELSEWHERE = ("six_position", "known_rotation")


@dataclass(frozen=True)
class Prior:
    """What the other devices of a type let expect of one more, parameter by parameter.

    Of the 21 base parameters, in the order of `imuloop.calibrate.sensor_pair.parameters`, SI as
    logged; a variance is infinite where too few devices determined the parameter.
    """

    mean: np.ndarray
    variance: np.ndarray

    @classmethod
    def of(cls, calibrations):
        """Return the prior from the Calibrations of the others, each made without a prior.

        Normal with the mean μ and the variance of a new device, ``τ² + var(μ)``, as wide as
        Student's t with n - 1 degrees of freedom is: times ``(n - 1)/(n - 3)``.

        References
        ----------
        J. Higgins, S. Thompson, D. Spiegelhalter, "A re-evaluation of random-effects
        meta-analysis", J. R. Stat. Soc. A 172 (2009), 137, section 5.
        """
        mean, variance = [], []
        for each in of_calibrations(calibrations):
            own, nominal = each.known, each.name.partition(".")[2][0] == "K"
            if own.sum() < LEAST_OTHERS:
                mean.append(np.nan)
                variance.append(np.inf)
                continue
            found = fit(each.values[own], each.std[own] ** 2)
            mean.append(found.beta[0, 0] + nominal)
            wide = found.dof[0] / (found.dof[0] - 2)
            variance.append((found.variance[0] + found.covariance[0, 0, 0]) * wide)
        return cls(np.array(mean), np.array(variance))

    def of_sensor(self, sensor):
        """Return mean and variance of one sensor's parameters."""
        own = places()[sensor]
        return self.mean[own], self.variance[own]


def with_prior(own, prior, recording=None, noise=None, settings=None):
    """Return a Calibration with the prior of its type.

    Information adds. A sensor's own estimate is weighed against the prior by both covariances.
    Where the poses of the recording do not determine a sensor by themselves, both are fitted to
    them anew, beside the prior, which makes up what they lack. That they lack it is still said.

    Parameters
    ----------
    own : Calibration
        By the device's own data.
    prior : Prior
        From other devices alone.
    recording, noise, settings : Recording, NoiseModel, CalibrateSettings, optional
        The device's own poses; without them the estimates alone count.
    """
    if not np.isfinite(prior.variance).any():
        raise ImuloopError(
            f"no prior: fewer than {LEAST_OTHERS} other devices of its type are calibrated"
        )
    made = {s: weighed(getattr(own, s), s, *prior.of_sensor(s)) for s in SENSORS}
    lacking = any({*BASES[s]} - {*getattr(own, s).names} for s in SENSORS)
    fits = recording is not None and len(recording.poses) and np.isfinite(prior.variance).all()
    if lacking and fits and not own.effects and not recording.poses.unknown_noise(noise, CHANNELS):
        made = fitted(own, made, prior, recording, noise, settings)
    for sensor, found in made.items():
        before = getattr(own, sensor)
        why = before.not_testable
        if why and found.method == "family":
            why += "; completed by the other devices of its type"
        made[sensor] = replace(found, not_testable=why, verdict=before.verdict)
    return replace(own, **made)


def without_prior(own, reason):
    """Return a device's calibration with the reason why it has no prior."""
    sensors = {s: getattr(own, s) for s in SENSORS}
    why = {s: "; ".join(filter(None, (c.not_testable, str(reason)))) for s, c in sensors.items()}
    return replace(own, **{s: replace(c, not_testable=why[s]) for s, c in sensors.items()})


def weighed(own, sensor, mean, variance):
    """Return a SensorCalibration with a prior of its base parameters.

    ``x + C Hᵀ (H C Hᵀ + V)⁻¹ (m - H x)`` with the estimate x and its covariance C, effects
    included, of which H takes those that the prior m, V knows. What was not estimated is the prior.
    """
    base, known = BASES[sensor], np.isfinite(variance)
    names = tuple(n for n, k in zip(base, known, strict=True) if k or n in own.names)
    names += tuple(n for n in own.names if n not in base)
    factor = si_factor(names, own.raw_unit)
    values = dict(zip(base, as_logged(own, base), strict=True))
    values |= {f"{e.name}.{p}": v for e in own.effects for p, v in e.values.items()}
    x, C = np.array([values[n] for n in names]), np.zeros((len(names),) * 2)
    at = [names.index(n) for n in own.names]
    if at:
        C[np.ix_(at, at)] = own.covariance * np.outer(factor[at], factor[at])
    new = [i for i, n in enumerate(names) if n not in own.names]
    expected = dict(zip(base, zip(mean, variance, strict=True), strict=True))
    for i in new:
        x[i], C[i, i] = expected[names[i]]
    both = [i for i, n in enumerate(names) if n in own.names and n in base and known[base.index(n)]]
    m, v = np.array([expected[names[i]] for i in both]).reshape(-1, 2).T
    gain = np.linalg.solve(C[np.ix_(both, both)] + np.diag(v), C[both]).T
    x, C = x + gain @ (m - x[both]), C - gain @ C[both]
    return _changed(own, names, x, (C + C.T) / 2, "family" if new else own.method)


def _changed(own, names, x, covariance, method):
    """Return a SensorCalibration with other values, SI as logged, of some parameters."""
    values = dict(zip(names, x.tolist(), strict=True))
    std = dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    T, K, b, unit = own.T.copy(), own.K.copy(), own.b.copy(), own.raw_unit
    for name in (n for n in names if "." not in n):
        i = int(name[1])
        if name[0] == "T":
            T[i, int(name[2])] = values[name]
        elif name[0] == "K":
            K[i] = values[name] * unit.scale
        else:
            b[i] = unit.from_si(values[name])
    effects = tuple(
        replace(
            e,
            values={p: values.get(f"{e.name}.{p}", v) for p, v in e.values.items()},
            std={p: std.get(f"{e.name}.{p}", s) for p, s in e.std.items()},
        )
        for e in own.effects
    )
    factor = si_factor(names, unit)
    return replace(
        own,
        T=T,
        K=K,
        b=b,
        names=names,
        covariance=covariance / np.outer(factor, factor),
        effects=effects,
        method=method,
    )


def fitted(own, made, prior, recording, noise, settings):
    """Return both sensors fitted to poses with rows of what is known beside them.

    That is the prior; of a sensor that other sessions determine, `made`, the two together.
    """
    known = {}
    for sensor in SENSORS:
        mean, variance = prior.of_sensor(sensor)
        known[sensor] = mean, np.diag(variance)
        if getattr(own, sensor).method in ELSEWHERE:
            given = made[sensor]
            factor = si_factor(given.names, given.raw_unit)
            covariance = given.covariance * np.outer(factor, factor)
            known[sensor] = as_logged(given, BASES[sensor]), covariance
    base = np.concatenate([mean for mean, _ in known.values()])
    units = {s: getattr(own, s).raw_unit for s in SENSORS}
    pair = SensorPair(noise, own.gravity, units, settings, tuple(SENSORS), base)
    for sensor, (mean, covariance) in known.items():
        rows = known_rows(covariance)
        pair = pair.knowing(sensor, rows, rows @ mean)
    try:
        solution = pair.fit(recording)
    except LinAlgError as error:
        raise ImuloopError(f"with the prior of its type: {why_no_fit(error)}") from error
    return {s: replace(f, method="family") for s, f in pair.calibrations(solution).items()}
