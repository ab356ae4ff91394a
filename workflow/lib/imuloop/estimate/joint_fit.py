"""The joint fit of accelerometer and gyroscope to the rests and moves of a recording."""

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

    Attributes
    ----------
    factors : Factors
        Measurements that the fit uses.
    noise : NoiseModel
        Noise of the device.
    units : dict of str to RawUnit
        Raw units of each sensor.
    start : ndarray, shape (21,)
        State x to start from, without effects.
    prior : Prior or None
        The data sheet or the device family, before the data.
    known : (ndarray, ndarray)
        Prior rows R, (k, 21), and z, (k,), of the state x: ``R x - z`` has mean zero and variance
        one. They include `prior`.
    method : str
        Kind of the sessions that were recorded; it is written into the calibrations.
    """

    factors: Factors
    noise: NoiseModel
    units: dict
    start: np.ndarray
    prior: Prior | None = None
    known: tuple = (np.zeros((0, COUNT)), np.zeros(0))
    method: str = "multi_position"

    # the same properties of the Factors
    estimated = property(attrgetter("factors.sensors"))
    kinds = property(attrgetter("factors.kinds"))
    rows = property(attrgetter("factors.rows"))

    @property
    def names(self):
        """Names of the parameters without effects."""
        return State(self.start).names

    def of_sensors(self, sensors):
        """Return the JointFit that estimates only the given sensors."""
        return replace(self, factors=replace(self.factors, sensors=tuple(sensors)))

    def measure(self, x, recording, effects=()):
        """Return the Measurements of a recording for the state x, (p,), and some effects."""
        return self.factors.about(recording, State(x, tuple(effects)))

    def linearise(self, solution, recording):
        """Return the Linearised factors of a recording at the parameters of a Fit."""
        return self.measure(solution.x, recording, solution.effects).at(solution.x)

    def noise_components(self, linearised, prior_rows):
        """Return the parts of the covariance of N residuals by noise of known and unknown size.

        The N rows are the residuals of the Linearised factors and then `prior_rows` rows of a
        prior, which have variance one.

        Returns
        -------
        ndarray, shape (N, N)
            Covariance by the noise of known size.
        list of Component
            Flicker and random walk of each channel, with the size that the noise model gives as
            prior, and the error of turns that were sampled too slowly.
        list of Component
            A white excess for each kind of residual, of unknown size: an error that the model
            lacks, or the motion of a hand, does not average out over a rest.
        """
        recording, covariance = linearised.measured.recording, linearised.noise
        # residuals of the gyroscope depend on the accelerometer, which gives gravity's direction
        sensors = SENSORS if "gyroscope" in self.estimated else self.estimated
        kind_of_channel = {c: OF_SENSOR[sensor][-1] for sensor in sensors for c in SENSORS[sensor]}
        sizes = {(c, term): self.noise.known(c, term) for c in kind_of_channel for term in "BK"}
        uncertain = {key: size for key, size in sizes.items() if size[1] > 0}
        aliased = "gyroscope" in self.estimated and recording.rotations.aliased.any()
        certain_noise = self.noise.with_sizes(dict.fromkeys(uncertain, 0.0))
        fixed = covariance.by(certain_noise, aliasing=not aliased)
        parts = [
            (std**2 * covariance.component(c, term), size / std, 1.0, kind_of_channel[c])
            for (c, term), (size, std) in uncertain.items()
        ]
        if aliased:
            parts.append((covariance.of_aliasing(), 1.0, ALIASED_TO, "rotation"))
        fixed = block_diag(fixed, np.eye(prior_rows))
        slow = [Component(np.pad(matrix, (0, prior_rows)), *prior) for matrix, *prior in parts]
        variance = np.diag(total_covariance(fixed, slow, [component.size for component in slow]))
        kinds = np.append(self.rows(recording)[1], np.full(prior_rows, ""))
        rows = {kind: kinds == kind for kind in self.kinds if kind in kinds}
        excess = [Component(np.diag(r * np.median(variance[r])), kind=k) for k, r in rows.items()]
        return fixed, slow, excess

    def fit(self, recording, effects=(), start=None, prior=None):
        """Fit the state to a recording by generalised least squares of all residuals.

        The weights come from the noise model, with an excess for each kind of residual that the
        residuals make likeliest.

        Parameters
        ----------
        recording : Recording
        effects : sequence of SensorEffect
            Effects that the model has.
        start : ndarray, optional
            Parameters of a fit with fewer effects; by default the attribute `start`.
        prior : (ndarray, ndarray), optional
            Rows R, (k, p), and z, (k,), of a prior, as in the attribute `known`, the default.

        Returns
        -------
        Fit

        References
        ----------
        Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
        without external equipments", ICRA 2014, section IV.
        """
        x, effects = self.start if start is None else start, tuple(effects)
        p = COUNT + sum(len(e.parameters) for e in effects)
        x, sizes = np.append(x, np.zeros(p - len(x))), None
        R, z = self.known if prior is None else prior
        R = np.pad(R, ((0, 0), (0, p - R.shape[1])))
        # the weights and the effects' derivatives depend on the calibrated output, which the start
        # gives to about 1 %
        for _ in range(3 if start is None else 2):
            measured = self.measure(x, recording, effects)
            linearised = measured.at(x)
            fixed, slow, excess = self.noise_components(linearised, len(z))
            estimated = total_covariance(fixed, slow, [component.size for component in slow])
            sizes = likely_sizes(*_with_prior(linearised, R, z), estimated, excess, sizes)
            n = len(fixed) - len(z)
            covariance = total_covariance(estimated, excess, sizes)[:n, :n]
            solution = fit(measured.at, x, covariance, (R, z), linearised)
            change, x = np.abs(solution.x - x), solution.x
            if np.all(change < STILL * np.sqrt(np.diag(solution.covariance))):
                break
        # χ² uses the covariance of the noise model, without the excess
        owner = np.append(self.factors.owners(recording), np.full(len(z), ""))
        owners, (values, jacobian) = np.unique(owner[:n]), _with_prior(measured.at(x), R, z)
        squares, _ = chi_square(values, estimated, jacobian, [owner == name for name in owners])
        reduced = (chi2 / dof if dof > 0 else None for chi2, dof in squares)
        reduced = dict(zip(owners.tolist(), reduced, strict=True))
        return replace(solution, effects=effects, reduced_chi2=reduced)

    def calibrations(self, solution, covariance=None):
        """Return a dict with the SensorCalibration of each estimated sensor, from a Fit.

        `covariance`, (p, p), is that of the parameters; by default `Fit.scaled_covariance`.
        """
        covariance = solution.scaled_covariance if covariance is None else covariance
        state, calibrations = State(solution.x.copy(), solution.effects), {}
        if self.factors.bias_held:
            state.x[BIAS], covariance[BIAS], covariance[:, BIAS] = self.start[BIAS], 0.0, 0.0
            covariance[BIAS, BIAS] = solution.covariance[BIAS, BIAS] * np.eye(3)
        for sensor in self.estimated:
            index = state.places(sensor)
            calibrations[sensor] = in_raw_units(
                *(sensor, self.units[sensor], state.x[index], covariance[np.ix_(index, index)]),
                [e.effect for e in solution.effects if e.sensor == sensor],
                self.prior,
                method=self.method,
                reduced_chi2=solution.reduced_chi2.get(sensor),
            )
        return calibrations


def _with_prior(linearised, R, z):
    """Return residuals, (N,), and Jacobian, (N, p), of Linearised factors and then of a prior.

    The prior has k rows ``R x - z`` with R, (k, p), and z, (k,).
    """
    values = np.append(linearised.residual, R @ linearised.state.x - z)
    return values, np.concatenate([linearised.jacobian, R])
