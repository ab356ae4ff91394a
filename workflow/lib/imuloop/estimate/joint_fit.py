"""The joint fit of both sensors to rests and the moves between: what is estimated, how well."""

from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scipy.linalg import block_diag

from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.estimate.least_squares import chi_square, fit
from imuloop.estimate.noise_components import Component, likely_sizes, total
from imuloop.factors.factors import OF_SENSOR, Factors
from imuloop.model.prior import Prior
from imuloop.model.raw_units import in_raw_units
from imuloop.model.state import BIAS, COUNT, State

# standard deviation of the error that is foreseen of turns that were sampled too slowly, over it
ALIASED_TO = 0.2
# share of its standard deviation by which a parameter may move and the weights stay as they are
STILL = 0.01


@dataclass(frozen=True)
class JointFit:
    """Both sensors of a device as they are fitted to a recording.

    Attributes
    ----------
    factors : Factors
        Measurements that count.
    noise : NoiseModel
        Of the device.
    units : dict of str to RawUnit
        Of each sensor.
    start : ndarray, shape (21,)
        State to start from, without effects.
    prior : Prior or None
        What is known before the data.
    known : (ndarray, ndarray)
        Rows R, (k, 21), and z of what is known of the state, the prior among it: ``R x - z`` has
        variance one.
    method : str
        Name of the sessions that the recording is of, which the calibrations carry.
    """

    factors: Factors
    noise: NoiseModel
    units: dict
    start: np.ndarray
    prior: Prior | None = None
    known: tuple = (np.zeros((0, COUNT)), np.zeros(0))
    method: str = "multi_position"

    # of the Factors
    estimated = property(attrgetter("factors.sensors"))
    kinds = property(attrgetter("factors.kinds"))
    rows = property(attrgetter("factors.rows"))

    @property
    def names(self):
        """Names of the parameters without effects."""
        return State(self.start).names

    def of_sensors(self, sensors):
        """Return the fit of some sensors alone."""
        return replace(self, factors=replace(self.factors, sensors=tuple(sensors)))

    def measured(self, x, recording, effects=()):
        """Return the Measurements of a recording, effects seen with parameters x."""
        return self.factors.about(recording, State(x, tuple(effects)))

    def linearised(self, found, recording):
        """Return the Linearised factors of any recording about a Fit."""
        return self.measured(found.x, recording, found.effects).at(found.x)

    def noise_components(self, at, prior_rows):
        """Return the covariance of the noise that is known, (N, N), and Components of the rest.

        Of Linearised factors, and of some rows of a prior, of variance one, that come last. First
        flicker and walk of each channel as far as they are known, and what turns lose between two
        samples; then of each kind of residual an excess that is even: the residual of what a model
        lacks, or of a hand, is no smaller where a rest is long.
        """
        recording, covariance, components = at.measured.recording, at.noise, []
        # the residuals of a gyroscope have the accelerometer's noise too: gravity is by that
        sensors = SENSORS if "gyroscope" in self.estimated else self.estimated
        kinds = {c: OF_SENSOR[sensor][-1] for sensor in sensors for c in SENSORS[sensor]}
        terms = {(c, term): self.noise.known(c, term) for c in kinds for term in "BK"}
        loose = {term: known for term, known in terms.items() if known[1] > 0}
        aliased = "gyroscope" in self.estimated and recording.rotations.aliased.any()
        without = self.noise.with_sizes(dict.fromkeys(loose, 0.0))
        fixed = block_diag(covariance.by(without, aliasing=not aliased), np.eye(prior_rows))
        for (c, term), (size, spread) in loose.items():
            own = spread**2 * covariance.component(c, term)
            components.append((own, size / spread, 1.0, kinds[c]))
        if aliased:
            components.append((covariance.of_aliasing(), 1.0, ALIASED_TO, "rotation"))
        slow = [Component(np.pad(own, (0, prior_rows)), *known) for own, *known in components]
        expected = np.diag(total(fixed, slow, [part.size for part in slow]))
        kind = np.append(self.rows(recording)[1], np.full(prior_rows, ""))
        rows = {name: kind == name for name in self.kinds if name in kind}
        missing = [Component(np.diag(a * np.median(expected[a])), kind=k) for k, a in rows.items()]
        return fixed, slow, missing

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Fit to a recording: generalised least squares of all residuals.

        The weights are those of the noise as residuals make it likeliest, within what is known of
        it. `start` are parameters of a fit with fewer effects; `prior` are rows R and z of what is
        known of the parameters, ``R x - z`` of variance one, by default `known`.

        References
        ----------
        Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
        without external equipments", ICRA 2014, section IV.
        """
        x, sizes = self.start if start is None else start, None
        count = COUNT + sum(len(e.parameters) for e in effects)
        x = np.append(x, np.zeros(count - len(x)))
        R, z = self.known if prior is None else prior
        R = np.pad(R, ((0, 0), (0, count - R.shape[1])))

        def all_rows(at):
            """Return residuals and derivative with those of the prior."""
            return np.append(at.residual, R @ at.state.x - z), np.concatenate([at.jacobian, R])

        # weights and effects depend on the calibrated output, which the start gives to 1 %
        for _ in range(3 if start is None else 2):
            measured = self.measured(x, recording, effects)
            at = measured.at(x)
            fixed, slow, missing = self.noise_components(at, len(z))
            estimated = total(fixed, slow, [part.size for part in slow])
            sizes = likely_sizes(*all_rows(at), estimated, missing, sizes)
            n = len(fixed) - len(z)
            weights = total(estimated, missing, sizes)[:n, :n]
            found = fit(measured.at, x, weights, (R, z), at)
            moved, x = np.abs(found.x - x), found.x
            if np.all(moved < STILL * np.sqrt(np.diag(found.covariance))):
                break
        # by what the noise alone predicts
        owner = np.append(self.factors.owners(recording), np.full(len(z), ""))
        owners, (r, jacobian) = np.unique(owner[:n]).tolist(), all_rows(measured.at(x))
        squares, _ = chi_square(r, estimated, jacobian, [owner == each for each in owners])
        reduced = [square / dof if dof > 0 else None for square, dof in squares]
        reduced = dict(zip(owners, reduced, strict=True))
        return replace(found, effects=tuple(effects), reduced_chi2=reduced)

    def calibrations(self, found, covariance=None):
        """Return the SensorCalibration of each estimated sensor by a Fit.

        The covariance is by default that of the fit, scaled by its reduced χ² where that is above
        one.
        """
        whole = found.scaled_covariance if covariance is None else covariance
        state, made = State(found.x.copy(), found.effects), {}
        if self.factors.bias_held:
            state.x[BIAS], whole[BIAS], whole[:, BIAS] = self.start[BIAS], 0.0, 0.0
            whole[BIAS, BIAS] = found.covariance[BIAS, BIAS] * np.eye(3)
        for sensor in self.estimated:
            at = state.places(sensor)
            made[sensor] = in_raw_units(
                *(sensor, self.units[sensor], state.x[at], whole[np.ix_(at, at)]),
                [e.effect for e in found.effects if e.sensor == sensor],
                self.prior,
                method=self.method,
                reduced_chi2=found.reduced_chi2.get(sensor),
            )
        return made
