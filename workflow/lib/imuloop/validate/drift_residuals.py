"""Residuals of a new log under an old calibration, and the changes that the log determines."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.calibrate.recording import Recording
from imuloop.core.samples import SENSORS
from imuloop.core.sphere import count_attitudes
from imuloop.factors.factors import KINDS, Factors
from imuloop.model.raw_units import state_of
from imuloop.model.state import State

# condition number, each parameter in units of what the log shows of it, beyond which a set of
# parameters is called undetermined, as in the calibration
LARGEST_CONDITION = 100.0
# a parameter that the new log shows so many times worse than the old one is not tested
WORST = 10.0
BIASES = ("b0", "b1", "b2")
# angle between two attitudes, rad
APART = 0.35


@dataclass(frozen=True)
class DriftResiduals:
    """Residuals of a new log, n of both sensors, as a function of the old parameters.

    Attributes
    ----------
    old : State
        That of the old calibration.
    covariance : ndarray, shape (p, p)
        That of the old calibration.
    factors : Factors
        Measurements in the new log.
    recording : Recording
        Rests, and turns between them, of the new log.
    counted : ndarray of bool
        Which of all residuals count.
    kinds, owners : ndarray of str, shape (n,)
        Kind of each that counts, and whose it is.
    noise : ndarray, shape (n, n)
        Covariance of their noise, grown with the reduced chi square that the old calibration had.
    estimated : dict of str to tuple
        Names of what the old calibration estimated, by sensor.
    untestable : dict of str to str
        Why a sensor has no residuals.
    """

    old: State
    covariance: np.ndarray
    factors: Factors
    recording: Recording
    counted: np.ndarray
    kinds: np.ndarray
    owners: np.ndarray
    noise: np.ndarray
    estimated: dict
    untestable: dict

    @classmethod
    def of(cls, calibration, recording, noise, gravity):
        """Return those of a Calibration, a Recording, a NoiseModel, and gravity, m/s^2.

        Turns do not count where misalignment and scale factor of a sensor were not estimated: there
        is no direction of gravity.
        """
        (old, covariance), factors, untestable = state_of(calibration), Factors(gravity), {}
        estimated = {sensor: getattr(calibration, sensor).names for sensor in SENSORS}
        for sensor, axes in SENSORS.items():
            if not estimated[sensor]:
                untestable[sensor] = "the calibration estimated nothing of it"
            elif unknown := recording.poses.unknown_noise(noise, axes):
                untestable[sensor] = unknown
        kinds, owners = factors.rows(recording)[1], factors.owners(recording)
        counted = ~np.isin(owners, [*untestable])
        if not all("K0" in names for names in estimated.values()):
            counted &= kinds != "rotation"
        kinds, owners = kinds[counted], owners[counted]
        excess = {s: max(1.0, getattr(calibration, s).reduced_chi2 or 1.0) for s in SENSORS}
        size = np.sqrt([excess[owner] for owner in owners])
        predicted = factors.about(recording, old).at(old.x).noise.by(noise)
        predicted = predicted[np.ix_(counted, counted)] * np.outer(size, size)
        how = counted, kinds, owners, predicted, estimated, untestable
        return cls(old, covariance, factors, recording, *how)

    @property
    def tested(self):
        """The sensors that have residuals."""
        return [sensor for sensor in SENSORS if sensor not in self.untestable]

    def at(self, x):
        """Return the residuals, (n,), with parameters x, and their derivative, (n, p)."""
        at = self.factors.about(self.recording, State(x, self.old.effects)).at(x)
        return at.residual[self.counted], at.jacobian[self.counted]

    def places(self, sensor, names):
        """Return where parameters of a sensor are among all."""
        return [self.old.names.index(f"{sensor}.{name}") for name in names]

    def groups(self, sensor):
        """Return indices of the parameters that are tested together: b, K, T, each effect."""
        groups = {}
        for name in self.estimated[sensor]:
            [place] = self.places(sensor, [name])
            groups.setdefault(name.partition(".")[0].rstrip("012"), []).append(place)
        order = {"b": 0, "K": 1, "T": 2}
        return [groups[key] for key in sorted(groups, key=lambda key: order.get(key, 3))]

    def data(self, sensor):
        """Return in words what the log holds for a sensor."""
        rests = f"{len(self.recording.poses)} rest(s)"
        if sensor == "accelerometer":
            return f"{rests} in {count_attitudes(self.recording.poses.f, APART)} attitude(s)"
        turns = np.count_nonzero(self.kinds == "rotation") // KINDS["rotation"][1]
        return f"{rests} and {turns} turn(s) between them"

    def summary(self, sensor, r, expected):
        """Return the size of a sensor's residuals and the size expected, for each kind."""
        return {
            kind: {
                "unit": unit,
                "n": int(np.count_nonzero(at)),
                "rms": float(np.sqrt(np.mean(r[at] ** 2))),
                "floor": float(np.sqrt(np.mean(expected[at]))),
            }
            for kind, (unit, _) in KINDS.items()
            if (at := (self.kinds == kind) & (self.owners == sensor)).any()
        }


def testable(residuals, sensor, jacobian):
    """Return which changes of a sensor's parameters its own residuals in a log determine.

    The bias first, then scale factors, misalignments and each effect, as long as what is taken in
    stays determined. What is left out is taken as the calibration has it, with its errors. Takes
    the derivative of all residuals, (n, p). Gives changes of all p parameters, a column each,
    (p, q), their names and SI units, the names of the parameters that are not determined, and the
    reason.
    """
    old, groups = residuals.old, residuals.groups(sensor)
    own = residuals.owners == sensor
    root = cholesky(residuals.noise[np.ix_(own, own)], lower=True)
    shown = solve_triangular(root, jacobian[own], lower=True)
    std = np.sqrt(np.diag(residuals.covariance))
    taken, missed = [], []
    for group in groups:
        tried = [*taken, *group]
        # beyond the bias a check is asked for: one residual more than parameters
        enough = len(shown) >= len(tried) + bool(taken)
        if enough and _determined(shown[:, tried], std[tried], len(group) if taken else 0):
            taken = tried
        else:
            missed += group
    names = [name.removeprefix(f"{sensor}.") for name in old.names]
    untested = tuple(names[k] for k in missed)
    why = f"not determined by {residuals.data(sensor)}" if missed else None
    if taken:
        own_names, units = zip(*((names[k], old.units[k]) for k in taken), strict=True)
        return np.eye(len(names))[:, taken], own_names, units, untested, why
    # not even the bias: the directions of it that the log does show
    biases = groups[0]
    _, size, directions = np.linalg.svd(shown[:, biases])
    directions = directions[: np.sum(size > size[0] / LARGEST_CONDITION)]
    largest = np.argmax(np.abs(directions), axis=1)[:, None]
    directions = directions * np.sign(np.take_along_axis(directions, largest, axis=1))
    basis = np.zeros((len(names), len(directions)))
    basis[biases] = directions.T
    along = tuple("b along ({}, {}, {})".format(*(np.round(d, 2) + 0.0)) for d in directions)
    units = (old.units[biases[0]],) * len(along)
    return basis, along, units, untested, f"{why}, but for its bias along gravity"


def _determined(shown, old, new):
    """Return whether data determine parameters, the last `new` hardly worse than before."""
    size = np.linalg.norm(shown, axis=0)
    if not np.all(size > 0):
        return False
    _, values, directions = np.linalg.svd(shown / size, full_matrices=False)
    if values[-1] * LARGEST_CONDITION < values[0]:
        return False
    std = np.linalg.norm(directions.T / values, axis=1) / size
    return bool(np.all((std <= WORST * old)[len(old) - new :]))
