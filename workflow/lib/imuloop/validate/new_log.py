"""Residuals of a new log under an old calibration, and the changes that the log determines."""

from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import chdtrc

from imuloop.core.samples import SENSORS
from imuloop.core.sphere import count_attitudes
from imuloop.estimate.least_squares import chi_square, covariance_of, fit
from imuloop.factors.factors import KINDS, OF_SENSOR, Factors
from imuloop.model.raw_units import state_of

# condition number of the scaled Jacobian above which a set of parameters counts as undetermined
LARGEST_CONDITION = 100.0
# ratio of the standard errors of a parameter in the new and in the old log above which it is not
# tested
WORST = 10.0
BIASES = ("b0", "b1", "b2")
# angle between two attitudes, rad
APART = 0.35
# p-value of the fit of the new log below which its noise is enlarged
MISFIT = 0.01
# degrees of freedom below which a misfit cannot be judged
LEAST_DOF = 0.5


@dataclass(frozen=True)
class Testable:
    """The q directions in which a new log determines the parameters of one sensor.

    A direction is a single parameter, or a direction of the bias.

    Attributes
    ----------
    basis : ndarray, shape (p, q)
        The directions, a column each, as changes of the p parameters of both sensors.
    names, units : tuple of str
        Name and SI unit of each direction.
    untested, why : tuple of str, str or None
        Names of the parameters that the log does not determine, and the reason; None if it
        determines all.
    """

    basis: np.ndarray
    names: tuple
    units: tuple
    untested: tuple
    why: str | None


class NewLog:
    """A new log of a device, and its n residuals as a function of the p old parameters.

    Parameters
    ----------
    calibration : Calibration
        The old calibration of both sensors.
    recording : Recording
        Rests of the new log and turns between them. The calibration was not fitted to them.
    noise : NoiseModel
        Noise of the device.
    gravity : float, optional
        Gravity where the log was recorded, m/s^2; by default the gravity of the calibration.
    turns : bool
        Whether turns have residuals. They have none in any case if the calibration lacks estimated
        scale factors of a sensor, because gravity's direction after a turn is then not predicted.

    Attributes
    ----------
    prior : State, ndarray
        State of the old calibration, and its covariance, (p, p).
    untestable : dict of str to str
        For each sensor without residuals, the reason.
    noise_model : NoiseModel
        The argument `noise`. The attribute `noise` is something else: the covariance of the
        residuals.
    factors : Factors
        The factors that give the residuals of the sensors that are not in `untestable`.
    kinds, owners : ndarray of str, shape (n,)
        Kind of each residual, and name of the sensor that it belongs to.
    """

    def __init__(self, calibration, recording, noise, gravity=None, turns=True):
        # without estimated scale factors of both sensors no turn is predicted
        if not (turns and all("K0" in getattr(calibration, sensor).names for sensor in SENSORS)):
            none = np.zeros(len(recording.rotations), dtype=bool)
            recording = replace(recording, rotations=recording.rotations.select(none))
        self.recording, self.noise_model = recording.of_new_power_cycles(), noise
        self.calibration, self.prior = calibration, state_of(calibration)
        reasons = {s: recording.poses.unknown_noise(noise, SENSORS[s]) for s in SENSORS}
        for sensor in SENSORS:
            if not getattr(calibration, sensor).names:
                reasons[sensor] = "the calibration estimated nothing of it"
        self.untestable = {sensor: why for sensor, why in reasons.items() if why}
        tested = tuple(sensor for sensor in SENSORS if sensor not in self.untestable)
        self.factors = Factors(gravity or calibration.gravity, tested)
        self.owners = self.factors.owners(self.recording)
        _, self.kinds = self.factors.rows(self.recording)

    @cached_property
    def noise(self):
        """Covariance of the n residuals by the noise, (n, n).

        If the reduced χ² of a sensor's old calibration is above one, the noise model gives less
        noise than the residuals had. The covariance of the sensor's residuals is then multiplied by
        this reduced χ².
        """
        size = np.sqrt([getattr(self.calibration, owner).excess for owner in self.owners])
        return self.unchanged.noise.by(self.noise_model) * np.outer(size, size)

    @cached_property
    def unchanged(self):
        """Residuals with the old parameters, and their Jacobian, a Linearised."""
        return self.linearised_about(0.0)

    def linearised_about(self, change):
        """Return the residuals with changed parameters, and their Jacobian, a Linearised.

        `change` is added to the p old parameters: SI values, (p,), or one number for all.
        """
        old, _ = self.prior
        x = old.x + change
        return self.factors.linearised_about(self.recording, replace(old, x=x)).at(x)

    def places(self, sensor, names):
        """Return the indices in the state of the parameters `names` of a sensor, a list.

        `sensor` is the name of the sensor.
        """
        return [self.prior[0].names.index(f"{sensor}.{name}") for name in names]

    def describe_data(self, sensor):
        """Return a text on the data for a sensor: the number of rests, and of attitudes or turns.

        `sensor` is the name of the sensor. Attitudes are counted for the accelerometer, turns for
        the gyroscope.
        """
        rests = f"{len(self.recording.poses)} rest(s)"
        if sensor == "accelerometer":
            return f"{rests} in {count_attitudes(self.recording.poses.f, APART)} attitude(s)"
        # a turn has several residuals, its components
        _, components = KINDS["rotation"]
        turns = np.count_nonzero(self.kinds == "rotation") // components
        return f"{rests} and {turns} turn(s) between them"

    def testable(self, sensor):
        """Return the parameters of a sensor that its residuals determine, a Testable.

        `sensor` is the name of the sensor. Groups of parameters are tried in order: the bias, the
        scale factors, the misalignments, and each effect. A group is left out if the log does not
        determine it together with the groups chosen before. The log determines a group if the
        Jacobian is well conditioned (`LARGEST_CONDITION`), if there are enough residuals, and, but
        for the first group, if the standard errors are at most `WORST` times the standard errors of
        the calibration. Exception: if no group is determined, the result has single directions of
        the bias instead, those that the log determines.
        """
        (old, covariance), of_sensor = self.prior, self.owners == sensor
        root = cholesky(self.noise[np.ix_(of_sensor, of_sensor)], lower=True)
        # derivative of the residuals, in standard deviations of their noise
        whitened = solve_triangular(root, self.unchanged.jacobian[of_sensor], lower=True)
        # names such as K0, and effect.parameter of an effect
        groups = {"b": [], "K": [], "T": []}
        for name in getattr(self.calibration, sensor).names:
            groups.setdefault(name.partition(".")[0].rstrip("012"), []).append(name)
        determined, missed = [], []
        for group in filter(None, groups.values()):
            tried, new = (self.places(sensor, names) for names in ([*determined, *group], group))
            # the bias may have any error, and needs as many residuals as parameters; further groups
            # need one more
            largest = WORST * np.sqrt(np.diag(covariance)[new]) if determined else np.inf
            enough = len(whitened) >= len(tried) + bool(determined)
            if enough and np.all(_errors(whitened[:, tried])[-len(new) :] <= largest):
                determined += group
            else:
                missed += group
        why = f"not determined by {self.describe_data(sensor)}" if missed else None
        basis = np.eye(len(old.x))[:, self.places(sensor, determined or BIASES)]
        if not determined:
            why += ", but for its bias along gravity"
            directions = _determined_directions(whitened @ basis)
            # the sum with zero removes the sign of -0.0
            rounded = np.round(directions, 2) + 0.0
            determined = ["b along ({}, {}, {})".format(*u) for u in rounded]
            basis = basis @ directions.T
        # a change has the unit of any parameter that it changes
        units = tuple(old.units[k] for k in np.argmax(basis != 0, axis=0))
        return Testable(
            basis=basis, names=tuple(determined), units=units, untested=tuple(missed), why=why
        )

    def fit_change(self, basis, prior):
        """Return the change of the old parameters along q directions that fits the new log best.

        The directions are the columns of `basis`, (p, q), each a change of the p old parameters.
        The residuals are weighted by the inverse of S, their covariance with the old parameters. S
        has the noise of the new log and the errors of the old parameters, whose covariance is
        `prior`, (p, p). If the χ² test of the residuals of a sensor after the fit has a p-value
        below `MISFIT`, the covariance of the noise of this sensor is multiplied by the reduced χ²,
        and the fit is repeated. Exception: with at most `LEAST_DOF` degrees of freedom this is not
        done.

        Returns
        -------
        ndarray, shape (q,)
            The change along each direction.
        ndarray, shape (q, q)
            Its covariance.
        ndarray, shape (n, n)
            The covariance S of the n residuals, with the enlarged noise.
        """

        def linearise(change):
            """Return residuals, and their derivative with respect to the change along q directions.

            `change`, (q,), is the change at which they are computed.
            """
            factors = self.linearised_about(basis @ change)
            return SimpleNamespace(residual=factors.residual, jacobian=factors.jacobian @ basis)

        jacobian = self.unchanged.jacobian
        by_prior = jacobian @ prior @ jacobian.T
        start = fit(linearise, np.zeros(basis.shape[1]), self.noise + by_prior).x
        at_start = linearise(start)
        groups = [self.owners == sensor for sensor in self.factors.sensors]
        squares, _ = chi_square(at_start.residual, self.noise + by_prior, at_start.jacobian, groups)
        factor = np.ones(len(jacobian))
        for of_sensor, (square, dof) in zip(groups, squares, strict=True):
            if dof > LEAST_DOF and chdtrc(dof, square) < MISFIT:
                factor[of_sensor] = np.sqrt(square / dof)
        expected = self.noise * np.outer(factor, factor) + by_prior
        solution = fit(linearise, start, expected)
        return solution.x, solution.covariance, expected

    def sizes(self, sensor, expected):
        """Return the sizes of a sensor's residuals with the old parameters, a dict by their kind.

        `sensor` is the name of the sensor. The value for a kind, such as the residuals of turns, is
        a dict with four keys: ``rms`` is the root mean square of these residuals, and ``floor`` the
        one that the covariance `expected`, (n, n), of all n residuals predicts; ``unit`` is their
        SI unit, and ``n`` their number. If ``rms`` is well above ``floor``, the old parameters do
        not fit. A kind without residuals has no entry.
        """
        squares, result = np.stack([self.unchanged.residual**2, np.diag(expected)]), {}
        for kind in OF_SENSOR[sensor]:
            unit, _ = KINDS[kind]
            of_kind = squares[:, self.kinds == kind]
            if n := of_kind.shape[1]:
                rms, floor = np.sqrt(of_kind.mean(axis=1)).tolist()
                result[kind] = {"unit": unit, "n": n, "rms": rms, "floor": floor}
        return result


def _errors(whitened):
    """Return the standard errors of q parameters, (q,), all nan if the data determine too little.

    `whitened`, (n, q), is the Jacobian of n residuals with independent noise of variance 1. The
    data determine too little if a column is zero, or if the condition number of the matrix, with
    its columns scaled to the length 1, is above `LARGEST_CONDITION`.
    """
    size = np.linalg.norm(whitened, axis=0)
    if not size.all() or np.linalg.cond(whitened / size) > LARGEST_CONDITION:
        return np.full(len(size), np.nan)
    return np.sqrt(np.diag(covariance_of(whitened)))


def _determined_directions(whitened):
    """Return the directions along which residuals determine a bias, unit vectors, (d, 3).

    There are d directions, at most three. `whitened`, (n, 3), is the Jacobian of n residuals with
    respect to the bias, scaled so that their noise is independent with variance 1. Of the two signs
    of a direction the one is taken with which its largest component is positive.
    """
    _, size, axes = np.linalg.svd(whitened)
    axes = axes[: np.sum(size > size[0] / LARGEST_CONDITION)]
    return np.array([u * np.sign(u[np.argmax(np.abs(u))]) for u in axes])
