"""The joint fit of accelerometer and gyroscope to the rests and moves of a recording.

A rest is a pose at rest, a move is what lies between two rests. The state x has the 21 parameters
of both sensors and then the parameters of the effects, in nominal SI: raw readings minus the
offset, times the scale of the data sheet.
"""

from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scipy.linalg import block_diag

from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.estimate.least_squares import chi_square, fit
from imuloop.estimate.noise_components import Component, likely_sizes, total_covariance
from imuloop.factors.factors import OF_SENSOR, Factors
from imuloop.model.prior import Prior
from imuloop.model.raw_units import in_raw_units
from imuloop.model.state import BIAS, COUNT, State

# relative standard deviation of the predicted error of turns that were sampled too slowly
ALIASED_TO = 0.2
# the weights are computed again if a parameter moves by more than this share of its standard error
STILL = 0.01


@dataclass(frozen=True)
class JointFit:
    """The set-up of a joint fit of both sensors to a recording.

    The fit estimates the state x. It has the 21 parameters of both sensors and then the parameters
    of effects, in nominal SI: raw readings minus the offset, times the scale of the data sheet.

    Attributes
    ----------
    factors : Factors
        Choice of the kinds of residuals that the fit uses, and of the sensors that it estimates.
    noise : NoiseModel
        Noise of the device.
    units : dict of str to RawUnit
        Raw unit of each sensor, its scale and offset by the data sheet.
    start : ndarray, shape (21,)
        State x to start from, without effects.
    prior : Prior or None
        The distribution of x before the data, by the data sheet or the device family. It is only
        written into the calibrations; the fit uses `prior_rows`.
    prior_rows : (ndarray, ndarray)
        All knowledge about x before the fit: R, (k, 21), and z, (k,). ``R x - z`` has mean zero and
        independent components of variance one. These rows include `prior` and the turns by known
        angles.
    method : str
        Kind of the sessions that were recorded, which is written into the calibrations.
    """

    factors: Factors
    noise: NoiseModel
    units: dict
    start: np.ndarray
    prior: Prior | None = None
    prior_rows: tuple = (np.zeros((0, COUNT)), np.zeros(0))
    method: str = "multi_position"

    # taken from `factors`: names of the estimated sensors; kinds of residuals that count; and a
    # function that takes a recording and returns the rests and the kind of each residual
    estimated = property(attrgetter("factors.sensors"))
    kinds = property(attrgetter("factors.kinds"))
    rows = property(attrgetter("factors.rows"))

    @property
    def names(self):
        """Names of the 21 parameters without effects, such as ``gyroscope.K0``, a tuple."""
        return State(self.start).names

    def of_sensors(self, sensors):
        """Return the JointFit that estimates only the sensors with the names in `sensors`."""
        return replace(self, factors=replace(self.factors, sensors=tuple(sensors)))

    def measure(self, x, recording, effects=()):
        """Return the Measurements: the rests and moves of a `recording`, as the fit uses them.

        Effects are linearised about the state `x`, (p,): the 21 parameters of both sensors, and
        then the parameters of `effects`, a sequence of SensorEffect.
        """
        return self.factors.linearised_about(recording, State(x, tuple(effects)))

    def linearise(self, solution, recording):
        """Return the residuals of a `recording` and their Jacobian, a Linearised.

        They are taken at the estimates of `solution`, a Fit, with its effects.
        """
        return self.measure(solution.x, recording, solution.effects).at(solution.x)

    def noise_components(self, linearised, prior_count):
        """Return the covariance of N residuals as noise of known size plus variance components.

        A variance component is noise whose size has to be estimated. The first residuals come from
        the Linearised factors `linearised`. The last `prior_count` residuals come from a prior:
        they are independent and have variance one.

        Returns
        -------
        ndarray, shape (N, N)
            Covariance by the noise of known size.
        list of Component
            Slow noise of uncertain size. Flicker is one component for each channel, and random walk
            another, if the noise model gives the standard error of its size. The size and the
            standard error in the noise model are the prior of the component. If rotations were
            sampled too slowly, the last component is the error of these rotations.
        list of Component
            For each kind of residual an excess, independent noise of unknown size. It stands for
            errors that the model lacks and for the motion of a hand, which do not average out over
            a rest.
        """
        recording, covariance = linearised.measured.recording, linearised.noise
        # residuals of the gyroscope depend on the accelerometer, which gives gravity's direction
        sensors = SENSORS if "gyroscope" in self.estimated else self.estimated
        # the kind of residual that the slow noise of each channel contributes to most
        kind_of_channel = {c: OF_SENSOR[sensor][-1] for sensor in sensors for c in SENSORS[sensor]}
        sizes = {
            (c, term): self.noise.value_and_std(c, term) for c in kind_of_channel for term in "BK"
        }
        uncertain = {key: size for key, size in sizes.items() if size[1] > 0}
        aliased = "gyroscope" in self.estimated and recording.rotations.aliased.any()
        certain_noise = self.noise.with_sizes(dict.fromkeys(uncertain, 0.0))
        # noise of uncertain size is left out here, as it is among the components
        fixed = covariance.by(certain_noise, aliasing=not aliased)
        # (covariance at size one, prior size, standard deviation of the size, kind of residual):
        # the unit of the size is the standard error, so that sizes of all terms are of the same
        # order
        parts = [
            (std**2 * covariance.component(c, term), size / std, 1.0, kind_of_channel[c])
            for (c, term), (size, std) in uncertain.items()
        ]
        if aliased:
            parts.append((covariance.of_aliasing(), 1.0, ALIASED_TO, "rotation"))
        fixed = block_diag(fixed, np.eye(prior_count))
        slow = [
            Component(np.pad(matrix, (0, prior_count)), size=size, deviation=deviation, kind=kind)
            for matrix, size, deviation, kind in parts
        ]
        variance = np.diag(total_covariance(fixed, slow, [component.size for component in slow]))
        kinds = np.append(self.rows(recording)[1], np.full(prior_count, ""))
        rows = {kind: kinds == kind for kind in self.kinds if kind in kinds}
        # an excess of size one has about the variance of the noise of its kind
        excess = [Component(np.diag(r * np.median(variance[r])), kind=k) for k, r in rows.items()]
        return fixed, slow, excess

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Fit of the state to a recording, by generalised least squares.

        The weights of the residuals are the inverse of a covariance: the noise model gives it, plus
        an excess of variance for each kind of residual. The size of each excess is the likeliest by
        the residuals.

        Parameters
        ----------
        recording : Recording
            Rests and moves.
        effects : sequence of SensorEffect
            Effects that the model has.
        start : ndarray, optional
            Parameters to start from, the result of an earlier fit. That fit had the first of
            `effects`, or no effects. By default the fit starts from the attribute `start`.
        prior : (ndarray, ndarray), optional
            R, (k, p), and z, (k,), such that ``R x - z`` has mean zero and independent components
            of variance one before the fit; by default the attribute `prior_rows`.

        Returns
        -------
        Fit
            The estimates of the p parameters, with the effects and the reduced χ² by sensor.

        References
        ----------
        Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
        without external equipments", ICRA 2014, section IV.
        """
        x, effects = self.start if start is None else start, tuple(effects)
        p = COUNT + sum(len(e.parameters) for e in effects)
        # effects that the start lacks start at zero, and the prior does not depend on them
        x, sizes = np.append(x, np.zeros(p - len(x))), None
        R, z = self.prior_rows if prior is None else prior
        R = np.pad(R, ((0, 0), (0, p - R.shape[1])))
        # the weights and the derivatives of the effects depend on the calibrated output, which is
        # known to about 1 % at the start: so the fit is repeated twice at most, or once if it
        # starts from an earlier fit
        for _ in range(3 if start is None else 2):
            measured = self.measure(x, recording, effects)
            linearised = measured.at(x)
            fixed, slow, excess = self.noise_components(linearised, len(z))
            estimated = total_covariance(fixed, slow, [component.size for component in slow])
            values, jacobian = append_prior(linearised, x, (R, z))
            sizes = likely_sizes(values, jacobian, estimated, excess, start=sizes)
            n = len(fixed) - len(z)
            covariance = total_covariance(estimated, excess, sizes)[:n, :n]
            solution = fit(measured.at, x, covariance, prior=(R, z), first=linearised)
            change, x = np.abs(solution.x - x), solution.x
            if np.all(change < STILL * np.sqrt(np.diag(solution.covariance))):
                break
        # χ² uses the covariance of the noise model, without the excess
        owner = np.append(self.factors.owners(recording), np.full(len(z), ""))
        owners, (values, jacobian) = np.unique(owner[:n]), append_prior(measured.at(x), x, (R, z))
        squares, _ = chi_square(values, estimated, jacobian, [owner == name for name in owners])
        reduced = (chi2 / dof if dof > 0 else None for chi2, dof in squares)
        reduced = dict(zip(owners.tolist(), reduced, strict=True))
        return replace(solution, effects=effects, reduced_chi2=reduced)

    def calibrations(self, solution, covariance=None):
        """Return the calibration of each estimated sensor by a Fit, a dict of SensorCalibration.

        `solution` is the Fit. `covariance`, (p, p), is the covariance of its p estimates. By
        default it is the covariance in the Fit, times the reduced χ² if that is above one.
        Exception: a bias of the gyroscope that the fit holds at its value before the fit keeps the
        variance by the prior, and has no covariance with other parameters.
        """
        covariance = solution.scaled_covariance if covariance is None else covariance
        state, calibrations = State(solution.x.copy(), solution.effects), {}
        # if the bias of the gyroscope is held at its value before the fit, it has the variance by
        # the prior, and no covariance with other parameters
        if self.factors.bias_held:
            state.x[BIAS], covariance[BIAS], covariance[:, BIAS] = self.start[BIAS], 0.0, 0.0
            covariance[BIAS, BIAS] = solution.covariance[BIAS, BIAS] * np.eye(3)
        for sensor in self.estimated:
            index = state.places(sensor)
            calibrations[sensor] = in_raw_units(
                sensor,
                self.units[sensor],
                x=state.x[index],
                covariance=covariance[np.ix_(index, index)],
                effects=[e.effect for e in solution.effects if e.sensor == sensor],
                prior=self.prior,
                method=self.method,
                reduced_chi2=solution.reduced_chi2.get(sensor),
            )
        return calibrations


def append_prior(linearised, x, prior):
    """Return all N residuals of a fit, (N,), and their Jacobian with p parameters, (N, p).

    The residuals of the recording come first, then the residuals of the prior. `linearised` has the
    residuals and the Jacobian of the recording at the parameters `x`, (p,). `prior` is R, (k, p),
    and z, (k,): its residuals are ``R x - z``.
    """
    R, z = prior
    values = np.append(linearised.residual, R @ x - z)
    return values, np.concatenate([linearised.jacobian, R])
