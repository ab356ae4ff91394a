"""One solution of what a reference shows of a sensor and what its other records do."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.determined import AXES
from imuloop.calibrate.gyroscope import cross_matrix
from imuloop.calibrate.raw_units import as_logged, in_raw_units
from imuloop.calibrate.reference.sensors import Accelerometer, Gyroscope
from imuloop.effects.other_sensor import LeverArm, SizeEffect

# of the set-up, not of the sensor
BESIDE = ("time_offset", "clock_drift", "lever_arm")
# sessions from which on whole ones are held out: without two of them one is left to learn from
WHOLE = 3
# what says nothing of axes and scale factors
UNFITTED = ("nominal", "static")
# probability beforehand of a bias as large that is none
BY_CHANCE = 0.05
# step of a derivative of what is nearly linear, 1
STEP = 1e-6


@dataclass(frozen=True)
class OfRecords:
    """What other records say of a sensor: parameters x, (p,), SI as logged, and covariance C.

    Of these the reference sees s(x), (k,): its own base model, then `effects`; A is ds/dx.
    """

    effects: tuple = ()
    x: np.ndarray | None = None
    covariance: np.ndarray | None = None
    seen: np.ndarray | None = None  # s
    gain: np.ndarray | None = None  # A, (k, p)

    def rows(self):
        """Return rows R and z of what they say of s: ``R s - z`` has variance one."""
        if self.x is None:
            return np.zeros((0, 6)), np.zeros(0)
        root = np.linalg.cholesky(self.gain @ self.covariance @ self.gain.T)
        return np.linalg.inv(root), np.linalg.solve(root, self.seen)

    def joined(self, joint, covariance):
        """Return x and C, given what s is by all records and the reference, and its covariance.

            G = C Aᵀ (A C Aᵀ)⁻¹,   x → x + G (joint - s),   C → C - G A C + G S Gᵀ

        More parameters, of what the reference alone shows, come after both.

        References
        ----------
        Rauch, Tung, Striebel, AIAA Journal 3 (1965) 1445.
        """
        A, C, k = self.gain, self.covariance, len(self.seen)
        G = np.linalg.solve(A @ C @ A.T, A @ C).T
        wide, more = block_diag(G, np.eye(len(joint) - k)), np.zeros(len(joint) - k)
        x = np.append(self.x - G @ self.seen, more) + wide @ joint
        return x, block_diag(C - G @ A @ C, np.diag(more)) + wide @ covariance @ wide.T


def of_records(sensor, own):
    """Return the OfRecords of a `calibrate.reference.sensors.ReferenceSensor`'s SensorCalibration.

    Effects that depend on time, on temperature or on how the reference sits are no part of s: their
    errors stay in those of x.
    """
    if own.method in UNFITTED:
        return OfRecords()
    names = own.names[: own.names.index("b2") + 1]
    count, values = len(names), {}
    for effect in own.effects:
        values |= {f"{effect.name}.{p}": v for p, v in effect.values.items()}
    x = np.append(as_logged(own, names), [values[n] for n in own.names[count:]])
    factor = np.ones(len(x))
    factor[count - 6 : count - 3] = own.raw_unit.scale
    factor[count - 3 : count] = 1 / own.raw_unit.scale
    effects, at = [], []
    for effect in (e.effect for e in own.effects):
        columns = [f"{effect.name}.{p}" for p in effect.parameters]
        unfit = effect.name in BESIDE or effect.timed or effect.needs
        if not unfit and set(columns) <= set(own.names):
            effects.append(effect)
            at += [own.names.index(c) for c in columns]
    base = symmetric if sensor.sensor == "gyroscope" else np.copy
    first = base(x[: count - 3])
    gain = np.zeros((len(first) + len(at), len(x)))
    for k, step in enumerate(STEP * np.eye(count - 3)):
        gain[: len(first), k] = (base(x[: count - 3] + step) - first) / STEP
    gain[range(len(first), len(gain)), at] = 1.0
    covariance = own.covariance / np.outer(factor, factor)
    return OfRecords(tuple(effects), x, covariance, np.append(first, x[at]), gain)


def symmetric(x):
    """Return S, symmetric, and K of a gyroscope's T and K: ``T K = R S K'``, R a rotation."""
    T, K = gyroscope.unpack(np.append(x, np.zeros(3)))[:2]
    turned, R = T * K, np.eye(3)
    for _ in range(10):
        own = R.T @ turned
        S = own / np.diag(own)
        skew = (S - S.T) / 2
        R = R @ Rotation.from_rotvec(skew[[2, 0, 1], [1, 2, 0]]).as_matrix()
    return np.append(S[[0, 0, 1], [1, 2, 2]], np.diag(own))


def with_reference(calibration, results):
    """Return the calibration by all records and what was found beside a reference, one solution.

    Takes ReferenceResults by sensor. Of a sensor whose axes other records do not show, it is that
    beside the reference, the gyroscope's turned onto the accelerometer's where places show these.
    T and K that predict held-out data no better than those that are known are not written, nor is
    a bias that chance could give, nor anything of few sessions that do not tell a sensor from the
    reference.
    Where the accelerometer stays unexplained beside the reference and nothing else shows its axes,
    it stays as it was, and turns no gyroscope: the data sheet says how its axes lie. Effects of
    where a marker sits and how late the reference is are not the sensor's: they are not
    in it; nor is what was held out within a session only.
    """
    known = {s: r for s, r in results.items() if r.solution is not None}
    solution, turned = {}, np.array([np.zeros(3), np.full(3, AXES**2)])
    force, beside = calibration.accelerometer, known.get("accelerometer")
    if beside and force.method in UNFITTED and beside.content["verdict"] == "unexplained":
        del known["accelerometer"]
        solution["accelerometer"] = replace(force, not_testable=_unexplained(beside))
    for sensor in [s for s, r in known.items() if r.within]:
        own, why = getattr(calibration, sensor), f"beside the reference, {known.pop(sensor).within}"
        solution[sensor] = replace(own, not_testable=why) if own.method in UNFITTED else own
    nominal = [r.no_axes for s, r in known.items() if getattr(calibration, s).method in UNFITTED]
    if len(known) == 2 and not any(nominal):
        off = known["gyroscope"].frame - known["accelerometer"].frame
        turned = np.array([off.mean(axis=0), sum(r.variance[3:] for r in known.values())])
    for sensor, result in known.items():
        own = getattr(calibration, sensor)
        kept, more = [], []
        for effect, columns in zip(result.effects, result.columns, strict=True):
            if effect.name not in BESIDE and len(result.bias) >= WHOLE:
                arms = isinstance(effect.effect, SizeEffect)
                kept.append(LeverArm() if arms else effect.effect)
                more += columns
        if own.method in UNFITTED:
            solution[sensor] = _alone(sensor, own, result, turned, kept, more)
        else:
            solution[sensor] = _together(sensor, own, result, kept, more)
    return replace(calibration, **solution)


def _unexplained(result):
    """Return why what was found beside a reference is no calibration."""
    ((kind, left),) = result.content["residuals"].items()
    return (
        f"{kind.replace('_', ' ')} stays at {left['after']:.3g} {left['unit']}, by the noise "
        f"{left['floor']:.3g}, and no effect explains it: a fit to it is no calibration"
    )


def _together(sensor, own, result, kept, more):
    """Return a SensorCalibration of other records with what the reference says of it."""
    records = of_records(Gyroscope if sensor == "gyroscope" else Accelerometer, own)
    count = len(records.seen)
    at = [*range(count), *more]
    joint = result.solution.fit.x[at], result.covariance[np.ix_(at, at)]
    if result.no_axes:
        # what others say of T and K stays as it is
        joint[1][:count] = joint[1][:, :count] = 0.0
        joint[1][:count, :count] = records.gain @ records.covariance @ records.gain.T
    x, covariance = records.joined(*joint)
    names = {name.partition(".")[0] for name in own.names}
    fitted = [e for e in own.effects if e.name in names]
    made = in_raw_units(
        own.raw_unit,
        own.names[: own.names.index("b2") + 1],
        x,
        covariance,
        method=own.method,
        effects=[*(e.effect for e in fitted), *kept],
        known=[e for e in own.effects if e not in fitted],
        reduced_chi2=own.reduced_chi2,
    )
    ranges = {e.name: e.ranges for e in fitted}
    held = tuple(replace(e, ranges=ranges.get(e.name, e.ranges)) for e in made.effects)
    return replace(made, effects=held)


def _alone(sensor, own, result, turned, kept, more):
    """Return the SensorCalibration by what was found beside the reference alone.

    `turned`, (2, 3), is the gyroscope's rotation against the accelerometer, and its variance.
    """
    x, count = result.solution.fit.x, 6
    names, model = accelerometer.NAMES, Accelerometer
    if sensor == "gyroscope":
        names, model = gyroscope.NAMES, Gyroscope
    T, K = model.unpack(x)
    if sensor == "gyroscope":
        T = T + cross_matrix(turned[:1])[0]
    at = [*range(count), *more]
    order = [(int(n[1]), int(n[2])) for n in names if n[0] == "T"]
    bias, known = result.bias.mean(axis=0), own.raw_unit.to_si(own.b)
    square = ((bias - known) ** 2 / result.variance[:3]).sum()
    if square < chi2.isf(BY_CHANCE, 3):
        bias = known
    values = [*(T[i] for i in order), *K, *bias]
    values = np.append(values, x[more])
    # what each parameter is of those of the fit; T of a gyroscope is symmetric but for the turn
    gain = np.zeros((len(values), len(at)))
    for row, (i, j) in enumerate(order):
        gain[row, [(0, 1), (0, 2), (1, 2)].index((min(i, j), max(i, j)))] = 1.0
    first = len(order)
    gain[range(first, first + 3), range(3, 6)] = 1.0
    gain[range(first + 6, len(values)), range(6, len(at))] = 1.0
    spread = gain @ result.covariance[np.ix_(at, at)] @ gain.T
    spread[range(first + 3, first + 6), range(first + 3, first + 6)] = result.variance[:3]
    if sensor == "gyroscope":
        # what turns T01 one way turns T10 the other
        off = np.array([cross_matrix(axis[None])[0] for axis in np.eye(3)])
        off = np.array([off[:, i, j] for i, j in order])
        spread[:6, :6] += off * turned[1] @ off.T
    made = in_raw_units(
        own.raw_unit, names, values, spread, method="reference_motion", effects=kept
    )
    if not result.no_axes:
        return made
    if bias is known and not kept:
        return replace(own, not_testable=result.no_axes)
    at = np.arange(first + 3, len(values))
    return replace(
        made,
        T=own.T,
        K=own.K,
        names=made.names[first + 3 :],
        covariance=made.covariance[np.ix_(at, at)],
        not_testable=result.no_axes,
    )
