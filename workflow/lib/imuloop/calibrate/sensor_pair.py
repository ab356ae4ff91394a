"""The joint fit of both sensors to rests and the turns between: what is estimated, how well."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from imuloop.calibrate.accelerometer import AccelerometerModel, SpecificForce
from imuloop.calibrate.gyroscope import AngularRate, GyroscopeModel
from imuloop.calibrate.least_squares import Solution, chi_square, fit
from imuloop.calibrate.noise_components import Component, likely_sizes, total
from imuloop.calibrate.pair_covariance import PairCovariance
from imuloop.calibrate.pair_model import COUNT, FORCE, PairModel
from imuloop.calibrate.prior import BASES
from imuloop.calibrate.raw_units import in_raw_units
from imuloop.calibrate.recording import OWN
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Effect, effect_design
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS

OUTPUT = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
# kinds of residuals: SI unit, components, and the sensor whose they are
KINDS = {
    "gravity_norm": ("m/s^2", 1),
    "pose_rate": ("rad/s", 3),
    "rotation": ("rad", 2),
    "velocity_vertical": ("m/s", 1),
    "velocity_horizontal": ("m/s", 2),
}
OF_SENSOR = {"accelerometer": ("gravity_norm",), "gyroscope": ("pose_rate", "rotation")}
VELOCITY = ("velocity_vertical", "velocity_horizontal")
AT_POSES = ("gravity_norm", "pose_rate")
OWNER = {kind: sensor for sensor, kinds in OF_SENSOR.items() for kind in kinds}
OWNER |= dict.fromkeys(VELOCITY, "motion")
# standard deviation of the error that is foreseen of turns that were sampled too slowly, over it
ALIASED_TO = 0.2
# share of its standard deviation by which a parameter may move and the weights stay as they are
STILL = 0.01


@dataclass(frozen=True)
class Kind:
    """A kind of effect, a class of the library, on one sensor."""

    cls: type
    sensor: str

    def __getattr__(self, name):
        """Return an attribute of the class: its name, its limit, what hides it."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.cls, name)


@dataclass(frozen=True)
class OfSensor:
    """An effect of one of two sensors, which are fitted together and may both have it."""

    effect: Effect
    sensor: str

    def __getattr__(self, name):
        """Return an attribute of the effect: its name, its parameters, what it needs."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.effect, name)

    @property
    def kind(self):
        """The class of the effect, of this sensor."""
        return Kind(type(self.effect), self.sensor)

    def moved(self, factor):
        """Return the same of the effect that is moved."""
        return replace(self, effect=self.effect.moved(factor))


@dataclass(frozen=True)
class SensorPair:
    """Both sensors of a device as they are fitted to a recording.

    Attributes
    ----------
    noise : NoiseModel
        Of the device.
    gravity : float
        Local gravity, m/s^2.
    units : dict of str to RawUnit
        Of each sensor.
    settings : CalibrateSettings
        Settings.
    estimated : tuple of str
        The sensors that the recording holds data of.
    base : ndarray, shape (21,)
        All base parameters to start from, SI as logged; those that are not estimated stay.
    known : (ndarray, ndarray)
        Rows R, (k, 21), and z of what is known of the base parameters, the prior first: ``R x - z``
        has variance one.
    priors : dict of str to SensorPrior
        The prior of each sensor, the rows of which `known` holds.
    method : str
        Name of the sessions that the recording is of, which the calibrations carry.
    bias : (ndarray, ndarray) or None
        Bias of the gyroscope and its variance, SI as logged, where it is held.
    quiet : ndarray of bool, shape (m,), or None
        Whether the velocity of a move counts; None where none does.
    of_rotation : ndarray or None
        Of PairModel.
    """

    noise: NoiseModel
    gravity: float
    units: dict
    settings: CalibrateSettings
    estimated: tuple
    base: np.ndarray
    known: tuple = (np.zeros((0, COUNT)), np.zeros(0))
    priors: dict = field(default_factory=dict)
    method: str = "multi_position"
    bias: tuple | None = None
    quiet: np.ndarray | None = None
    of_rotation: np.ndarray | None = None

    @cached_property
    def free(self):
        """Places of the base parameters that are estimated, among all."""
        free = np.zeros(COUNT, dtype=bool)
        free[:FORCE] = "accelerometer" in self.estimated
        free[FORCE:] = "gyroscope" in self.estimated
        if self.bias is not None:
            free[-3:] = False
        return np.flatnonzero(free)

    @cached_property
    def names(self):
        """Names of the base parameters that are estimated."""
        every = parameters()
        return tuple("{}.{}".format(*every[k]) for k in self.free)

    @cached_property
    def kinds(self):
        """Kinds of residuals that count, with SI unit and number of components."""
        own = [kind for sensor in self.estimated for kind in OF_SENSOR[sensor]]
        if "accelerometer" not in self.estimated:
            # a rotation carries the direction of gravity
            own.remove("rotation")
        own += VELOCITY if self.quiet is not None else ()
        return {kind: KINDS[kind] for kind in KINDS if kind in own}

    def _table(self, recording):
        """Return start, end, kind and whether it counts of each residual of a PairModel, (4, N)."""
        poses, first = np.arange(len(recording.poses)), recording.rotations.first
        table, velocity = [], () if self.quiet is None else VELOCITY
        for kind in ("gravity_norm", "pose_rate", "rotation", *velocity):
            start, ends = (poses, 0) if kind in AT_POSES else (first, 1)
            counts = self.quiet if kind in VELOCITY else kind in self.kinds
            place = [*self.kinds].index(kind) if kind in self.kinds else -1
            rows = np.broadcast_arrays(start, start + ends, place, counts)
            table.append(np.repeat(rows, KINDS[kind][1], axis=1))
        return np.hstack(table)

    def rows(self, recording):
        """Return the poses where each residual starts and ends, (N, 2), and its kind, (N,)."""
        start, end, kinds, counts = self._table(recording)
        return np.column_stack([start, end])[counts > 0], kinds[counts > 0]

    def kinds_of_rows(self, recording):
        """Return the kind of each residual, and its `OWNER`, (N,) of str."""
        kinds = np.array([*self.kinds])[self.rows(recording)[1]]
        return kinds, np.array([OWNER[kind] for kind in kinds.tolist()], dtype=str)

    def knowing(self, sensor, rows, z):
        """Return the same with rows, (k, p), and z of what is known of one sensor's base model."""
        own = np.zeros((len(z), COUNT))
        own[:, places()[sensor]] = rows
        return replace(self, known=(np.vstack([self.known[0], own]), np.append(self.known[1], z)))

    def prior_rows(self):
        """Return rows R, (k, p), and z of what is known of the base parameters beforehand."""
        rows, z = self.known
        fixed = np.delete(np.arange(COUNT), self.free)
        counts = rows[:, self.free].any(axis=1)
        return rows[counts][:, self.free], (z - rows[:, fixed] @ self.base[fixed])[counts]

    def all_parameters(self, x, effects=()):
        """Return the places of what is estimated among all parameters, and all of these.

        `x` are the first of what is estimated; the others are those to start from, effects zero.
        """
        count = sum(len(e.parameters) for e in effects)
        at = np.append(self.free, np.arange(COUNT, COUNT + count))
        found = np.append(self.base, np.zeros(count))
        found[at[: len(x)]] = x
        return at, found

    def model_at(self, x, recording, effects=()):
        """Return the PairModel of a recording, effects seen with parameters x."""
        own, (free, values) = places(effects), self.all_parameters(x, effects)
        if "rotation" not in self.kinds:
            # no move counts
            recording = replace(recording, rotations=recording.rotations.select([]))
        poses, rotations, along = recording.poses, recording.rotations, None
        if "accelerometer" not in self.estimated:
            # nor a direction of gravity, which a dead accelerometer does not have
            poses = replace(poses, f=np.tile([0.0, 0.0, self.gravity], (len(poses), 1)))
        of_force, of_turn = (values[at] for at in own.values())
        force, turn = SpecificForce.functions(of_force), AngularRate.functions(of_turn)
        # what takes values as logged to the sensor's own output, and to what it sees of the other
        functions = {"accelerometer": (force[0], turn[1]), "gyroscope": (turn[0], force[1])}

        def design(sensor, channels, table):
            """Return the derivative of e of a sensor, (..., 3, p), with what gives its channels."""
            y, other = (getattr(table, name) for name in OWN[sensor])
            chosen = [e for e in effects if e.sensor == sensor]
            of_effects = values[own[sensor]][len(BASES[sensor]) :]
            if not (chosen and len(y)):
                return np.zeros((*y.shape, len(of_effects)))
            output, see = functions[sensor]
            found = effect_design(chosen, channels(sensor, output, see(other), see), of_effects)
            return found.reshape(*y.shape, found.shape[-1])

        if self.quiet is not None:
            moving = design("accelerometer", recording.rotation_channels, rotations)
            along = SpecificForce(rotations.f, moving)
        nothing = np.zeros((len(rotations), 3, 2))
        T, K, _ = AngularRate.unpack(of_turn)
        return PairModel(
            AccelerometerModel(
                poses.f, design("accelerometer", recording.pose_channels, poses), self.gravity
            ),
            GyroscopeModel(
                poses.w,
                design("gyroscope", recording.pose_channels, poses),
                rotations,
                design("gyroscope", recording.rotation_channels, rotations),
                # by the parameters at which residuals are asked for
                directions=np.zeros_like(poses.f),
                # small turns, so those that the sensor gives are scaled and aligned as rates are
                to_start=poses.to_start @ (T * K).T,
                to_end=poses.to_end @ (T * K).T,
            ),
            own,
            free,
            values,
            self._table(recording)[3] > 0,
            along,
            nothing if self.of_rotation is None else self.of_rotation,
        )

    def model(self, solution, recording, shapes=()):
        """Return the model of any recording about a solution, with more effects."""
        return self.model_at(solution.fit.x, recording, (*solution.effects, *shapes))

    def derivative(self, solution, recording, shapes, base):
        """Return what more effects, of size zero, add to the residuals of a recording, (N, q).

        Takes the model about the solution without them: what a move leaves is the same with them.
        """
        count = sum(len(e.parameters) for e in shapes)
        x = np.append(solution.fit.x, np.zeros(count))
        model = self.model(solution, recording, shapes)
        model.know_moves(base.moves_at(solution.fit.x), x)
        _, jacobian = model.residuals(x)
        return jacobian[:, -count:]

    def given_rotation(self, recording, effects, x):
        """Return the same, its velocities less what the noise has in common with rotations.

        Takes the effects, and the parameters at which that is found.
        """
        model = replace(self, of_rotation=None).model_at(x, recording, effects)
        model = replace(model, counted=np.ones(len(model.counted), dtype=bool))
        covariance, at = PairCovariance(x, model, recording).by(self.noise), model.moves
        own = covariance[at[:, :, None], at[:, None]]
        shared = np.linalg.solve(own[:, :2, :2], own[:, :2, 2:]).swapaxes(1, 2)
        return replace(self, of_rotation=shared)

    def covariance_at(self, x, recording, effects=()):
        """Return the PairCovariance of a recording with parameters x."""
        return PairCovariance(x, self.model_at(x, recording, effects), recording)

    def noise_components(self, x, recording, model):
        """Return the covariance of the noise that is known, (N, N), and Components of the rest.

        Takes the PairModel of the recording at parameters x.
        First flicker and walk of each channel as far as they are known, and what turns lose between
        two samples; then of each kind of residual an excess that is even: the residual of what a
        model lacks, or of a hand, is no smaller where a rest is long.
        """
        noise = self.noise
        # the residuals of a gyroscope have the accelerometer's noise too: gravity is by that
        sensors = SENSORS if "gyroscope" in self.estimated else self.estimated
        kinds = {c: OF_SENSOR[sensor][-1] for sensor in sensors for c in SENSORS[sensor]}
        terms = {(c, term): noise.known(c, term) for c in kinds for term in "BK"}
        loose = {term: known for term, known in terms.items() if known[1] > 0}
        without = noise.with_sizes(dict.fromkeys(loose, 0.0))
        covariance = PairCovariance(x, model, recording)
        aliased = "gyroscope" in self.estimated and recording.rotations.aliased.any()
        fixed = covariance.by(without, aliasing=not aliased)
        slow = [
            Component(spread**2 * covariance.component(c, term), size / spread, 1.0, kinds[c])
            for (c, term), (size, spread) in loose.items()
        ]
        if aliased:
            slow.append(Component(covariance.of_aliasing(), 1.0, ALIASED_TO, "rotation"))
        expected = np.diag(total(fixed, slow, [part.size for part in slow]))
        each = self.kinds_of_rows(recording)[0]
        own = {kind: each == kind for kind in self.kinds if kind in each}
        missing = [Component(np.diag(a * np.median(expected[a])), kind=k) for k, a in own.items()]
        return fixed, slow, missing

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Solution for a recording: generalised least squares of all residuals.

        The weights are those of the noise as residuals make it likeliest, within what is known of
        it. `start` are parameters of a fit with fewer effects; `prior` are rows R and z of what is
        known of the parameters, ``R x - z`` of variance one, by default `prior_rows`.

        References
        ----------
        Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
        without external equipments", ICRA 2014, section IV.
        """
        count = len(self.names) + sum(len(e.parameters) for e in effects)
        x = self.base[self.free] if start is None else start
        x = np.append(x, np.zeros(count - len(x)))
        known, z = self.prior_rows() if prior is None else prior
        known = np.pad(known, ((0, 0), (0, count - known.shape[1])))
        sizes = None
        # weights and effects depend on the calibrated output, which the start gives to 1 %
        for _ in range(3 if start is None else 2):
            model = self.model_at(x, recording, effects)
            fixed, slow, missing = self.noise_components(x, recording, model)
            r, jacobian = model.residuals(x)
            estimated = total(fixed, slow, [part.size for part in slow])
            sizes = likely_sizes(r, jacobian, estimated, missing, (known, known @ x - z), sizes)
            found = fit(model.residuals, x, total(estimated, missing, sizes), (known, z))
            moved, x = np.abs(found.x - x), found.x
            if np.all(moved < STILL * np.sqrt(np.diag(found.covariance))):
                break
        r, jacobian = model.residuals(x)
        owner = self.kinds_of_rows(recording)[1]
        owners = np.unique(owner)
        groups = [np.append(owner == each, np.zeros(len(z), dtype=bool)) for each in owners]
        # the prior takes part in the fit
        r, jacobian = np.append(r, known @ x - z), np.concatenate([jacobian, known])
        squares, _ = chi_square(r, block_diag(estimated, np.eye(len(z))), jacobian, groups)
        reduced = [square / dof if dof > 0 else None for square, dof in squares]
        return Solution(tuple(effects), found, dict(zip(owners.tolist(), reduced, strict=True)))

    def calibrations(self, solution, covariance=None):
        """Return the SensorCalibration of each estimated sensor.

        The covariance is by default the covariance of the fit, scaled by its reduced chi square
        where that is above one.
        """
        own = places(solution.effects)
        at, x = self.all_parameters(solution.fit.x, solution.effects)
        whole = np.zeros((len(x),) * 2)
        whole[np.ix_(at, at)] = solution.fit.scaled_covariance if covariance is None else covariance
        if self.bias is not None:
            whole[range(COUNT - 3, COUNT), range(COUNT - 3, COUNT)] = self.bias[1]
        return {
            sensor: in_raw_units(
                self.units[sensor],
                BASES[sensor],
                x[own[sensor]],
                whole[np.ix_(own[sensor], own[sensor])],
                method=self.method,
                prior=self.priors.get(sensor),
                effects=[e.effect for e in solution.effects if e.sensor == sensor],
                reduced_chi2=solution.reduced_chi2.get(sensor),
            )
            for sensor in self.estimated
        }


def parameters(effects=()):
    """Return sensor, name and SI unit of each parameter: both base models', then the effects'."""
    found = []
    for sensor, names in BASES.items():
        units = {"T": "rad", "K": "1", "b": OUTPUT[sensor]}
        found += [(sensor, name, units[name[0]]) for name in names]
    for effect in effects:
        units = effect.units(effect.sensor).items()
        found += [(effect.sensor, f"{effect.name}.{name}", unit) for name, unit in units]
    return found


def places(effects=()):
    """Return the numbers of the parameters of each sensor among all, by sensor, ints (k,)."""
    owners = np.array([sensor for sensor, _, _ in parameters(effects)])
    return {sensor: np.flatnonzero(owners == sensor) for sensor in SENSORS}
