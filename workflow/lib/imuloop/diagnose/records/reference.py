"""A sensor beside a reference: what a model leaves of known rotations, and of known places."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, block_diag
from scipy.stats import chi2

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.gyroscope import cross_matrix
from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.pose_fits import Solution, in_raw_units
from imuloop.calibrate.reference import Accelerometer, Gyroscope, read_reference, spread, started
from imuloop.core.effect import Channels, Effect, FittedEffect
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import search_content
from imuloop.diagnose.evidence import Block, Evidence, Hypotheses
from imuloop.diagnose.records.carried import carried, errors_over, series
from imuloop.diagnose.records.pose_diagnosis import judged_residuals
from imuloop.diagnose.records.pose_tables import no_tables
from imuloop.diagnose.records.poses import Linearized, PoseProblem, by_effect
from imuloop.diagnose.verdict import not_testable

# windows at least: three components each, for nine parameters and a part held out
LEAST_WINDOWS = 20
# variance of the errors that the reference has in common where attitudes are alike, as a share of
# all that is left
COMMON = (0.0, 0.3, 1.0, 3.0)
SLIPS = "a reference that slips on the device tilts gravity, and so looks like a changing bias"
# median square of what is left, over that of the noise, from which on a reference may err itself
ABOVE = 1.5
WITHIN = (
    "in fewer than three sessions, what a reference gets wrong with attitude could look the same: "
    "more is left than its noise"
)
# of the set-up, not of the sensor
BESIDE = ("time_offset", "clock_drift", "lever_arm")
# sessions from which on whole ones are held out: without two of them one is left to learn from
WHOLE = 3


@dataclass(frozen=True)
class ReferenceResult:
    """The diagnosis of a sensor beside a reference."""

    content: dict  # the contract's fields
    solution: Solution | None = None
    choices: Choices | None = None
    effects: tuple = ()  # FittedEffect each
    columns: tuple = ()  # of each effect the places of its parameters in the solution
    covariance: np.ndarray | None = None  # of the solution's parameters
    # of each session, and the variance of their mean, SI as logged
    bias: np.ndarray | None = None
    bias_variance: np.ndarray | None = None
    frame: np.ndarray | None = None  # rad, what is left of the rotation between both bodies, too
    windows: dict = field(default_factory=dict)  # by column: a row per window


class ReferenceProblem(PoseProblem):
    """Windows of one sensor beside a reference, of noise that is white with heavy tails.

    How large its excess and its tails are is found again beside the effects of each fit. A
    reference sees some markers in one attitude and others in the next: hypotheses are how much of
    what is left goes with the attitude.
    """

    @cached_property
    def common(self):
        """Correlation of what goes with the attitude, (N, N), its mean variance one."""
        found = self.sensor.common(self.recording)
        return block_diag(found / np.diag(found).mean(), np.zeros((len(self.base_rows[1]),) * 2))

    @cached_property
    def floor(self):
        """Variance that the noise as estimated gives each row, (N,)."""
        own = np.repeat(self.sensor.floor(self.recording), 3)
        return np.append(own, np.ones(len(self.base_rows[1])))

    @cached_property
    def measure(self):
        """What a held-out error is compared in: windows with an outlier say little."""
        return np.sqrt(1 / np.diag(self.linearized().evidence.blocks[0].noise.precision[0]))

    def _made(self, base):
        count, sensor, model = len(self.sensor.names), self.sensor, None
        if base:
            before = self.linearized(base[:-1])
            sensor = replace(sensor, weight=before.model.weight)
            model = sensor.model_at(before.solution.fit.x, self.recording, base)
        rows, z = self.base_rows
        more = sum(len(e.parameters) for e in base)
        known = np.hstack([rows.reshape(len(z), count), np.zeros((len(z), more))])
        for _ in range(2 if base else 3):
            solution, model = sensor.fit(self.recording, base, model, (known, z))
            values, jacobian = model.residuals()
            variance = spread(values.reshape(-1, 3), self.floor[: len(values) : 3])
            sensor = replace(sensor, weight=1 / variance)
        values = np.append(values, known @ model.x - z)
        jacobian = np.concatenate([jacobian, known])
        own = by_effect(jacobian[:, None, count:], base)

        size = np.median(variance)
        white = np.diag(np.append(np.repeat(variance, 3), np.ones(len(z))))
        noise = Hypotheses.of(white + k * size * self.common for k in COMMON)

        def hypotheses(_):
            return noise

        def design(effect):
            return own[effect] if effect in own else self.added(effect)

        block = Block(-values[:, None], jacobian[:, :count], noise, self.ends)
        evidence = Evidence([block], np.zeros(len(COMMON)), design)
        known = [(0.0, np.diag(self.floor))]
        return Linearized(solution, model, values, jacobian, known, evidence, hypotheses)

    def added(self, effect):
        """Return what an effect adds to the residuals about the fit without any, (N, 1, p)."""
        if effect not in self._columns:
            solution = self.linearized(()).solution
            model = self.sensor.model(solution, self.recording, (effect,))
            own = model.residuals()[1][:, -len(effect.parameters) :]
            none = np.zeros((len(self.base_rows[1]), own.shape[1]))
            self._columns[effect] = np.concatenate([own, none])[:, None]
        return self._columns[effect]

    def nearest(self, base):
        """Return the residuals about the fit with these very effects.

        Without an offset in time the windows of fast turns are those of the tails: by their weights
        a part would be predicted from the slow ones alone.
        """
        return self.linearized(base)

    def lost(self, base, out=frozenset()):
        """Return why effects do not count, or the fit of all data is none; None if they do.

        A reference that leaves more than its noise may err with attitude, as effects of the sensor
        do: one session, or two, cannot tell.
        """
        own = any(effect.name not in BESIDE for effect in base)
        if own and len(self.recording.logs) < WHOLE:
            values = self.linearized(base).values
            if np.median(values**2 / self.floor) > ABOVE * chi2.ppf(0.5, 1):
                return WITHIN
        return None if out else super().lost(base)

    def slow(self, effect):
        """Return whether noise could be larger for an effect: it is known by what is left."""
        return False

    def shows(self, search, base, trial):
        """Return kind and rows in which a trial changes most: there is one kind."""
        (kind,) = self.sensor.kinds
        return kind, self.of_kind(kind)


def shapes_beside(sensor, recording):
    """Return the shapes of each effect to try on a sensor beside a reference, and the others."""
    log = recording.logs[0]
    own, other = (log.f, log.w) if sensor == "accelerometer" else (log.w, log.f)
    channels = Channels(log.t, own, other, log.temperature)
    found, others = candidates(sensor, "poses", channels)
    for cls in Effect.library.values():
        if sensor in cls.sensors and {"motion", "reference"} & {*cls.records}:
            found[cls] = tuple(cls.shapes(channels))
            others.pop(cls, None)
            if cls.name == "lever_arm":
                found[cls] = (cls(marker=1),)
    if sensor == "accelerometer":
        for cls in [cls for cls in found if cls.timed]:
            del found[cls]
            others[cls] = ("not_observable", SLIPS)
    return found, others


def diagnose_reference(sensor, recording, settings, tests, poses=None):
    """Return the ReferenceResult of a sensor, a `calibrate.reference.ReferenceSensor`.

    `tests` is the number of tests of the device's other records, which share the significance,
    `poses` the Solution that the poses give, None without one.
    """
    session, first, _, last = sensor.windows(recording)
    if len(session) < LEAST_WINDOWS:
        why = f"{len(session)} windows with a reference, at least {LEAST_WINDOWS} needed"
        return ReferenceResult(not_testable(why))
    shapes, others = shapes_beside(sensor.sensor, recording)
    parts = _parts(recording, session, first, settings.folds)
    problem = ReferenceProblem(
        started(sensor, recording),
        recording,
        shapes,
        settings,
        tests + settings.family * len(shapes),
        parts,
        base_rows=_of_poses(sensor, poses),
    )
    try:
        if reason := problem.lost(()):
            return ReferenceResult(not_testable(reason))
        return _diagnosed(Choices(problem), others, (session, first, last))
    except LinAlgError:
        return ReferenceResult(not_testable(SINGULAR))


def _of_poses(sensor, poses):
    """Return rows R and z of what the poses say of the base model's parameters.

    The gyroscope's T refers to the accelerometer there, and to the reference here: its
    antisymmetric part, a rotation, is open.
    """
    if poses is None:
        return np.zeros((0, len(sensor.names))), np.zeros(0)
    count = 9 if sensor.sensor == "gyroscope" else 6
    x, covariance = poses.fit.x[:count], poses.fit.scaled_covariance[:count, :count]
    if sensor.sensor == "gyroscope":
        # of T01 T02 T10 T12 T20 T21 the symmetric part
        part = np.zeros((6, 9))
        part[[0, 1, 2], [0, 1, 3]] = part[[0, 1, 2], [2, 4, 5]] = 0.5
        part[[3, 4, 5], [6, 7, 8]] = 1.0
        x, covariance = part @ x, part @ covariance @ part.T
    information = np.linalg.inv(covariance)
    size = np.sqrt(np.diag(information))
    values, axes = np.linalg.eigh(information / np.outer(size, size))
    shown = values > 1e-9 * values.max()
    rows = np.sqrt(values[shown])[:, None] * axes[:, shown].T * size
    return rows, rows @ x


def _parts(recording, session, first, count):
    """Return the part of each window: its session, or one of few sessions' blocks of time."""
    number = len(recording.logs)
    if number >= WHOLE:
        return session
    blocks = count // number
    length = [len(log.t) for log in recording.logs]
    return session * blocks + np.minimum(blocks * first // np.array(length)[session], blocks - 1)


def _diagnosed(choices, others, windows):
    """Return the ReferenceResult of a problem that can be tested."""
    problem, added = choices.problem, choices.choice().base
    (kind,) = problem.sensor.kinds
    judged, columns = judged_residuals(choices, (kind,), len(problem.sensor.kinds) * 2)
    solution, x = problem.linearized(added).solution, problem.linearized(added).solution.fit.x
    covariance, at = problem.covariance(added), len(problem.sensor.names)
    std, fitted, columns_of = np.sqrt(np.diag(covariance)), [], []
    for effect in added:
        own = [*range(at, at + len(effect.parameters))]
        pair = (dict(zip(effect.parameters, map(float, v[own]), strict=True)) for v in (x, std))
        fitted.append(FittedEffect(effect, *pair))
        columns_of.append(own)
        at += len(own)
    content = judged | search_content(problem.sensor.sensor, choices, fitted, others, [])
    content["sessions"] = len(problem.recording.logs)
    if problem.sensor.sensor == "gyroscope":
        parts = carried(choices)
        content["by_duration"] = errors_over(parts)
        if shown := series(parts, problem.recording.names):
            content["series"] = shown
    session, first, last = windows
    names, logs = np.array(problem.recording.names, dtype=object), problem.recording.logs
    place = {
        "session": names[session],
        "start_s": np.array([logs[s].t[i] for s, i in zip(session, first, strict=True)]),
        "end_s": np.array([logs[s].t[i] for s, i in zip(session, last, strict=True)]),
    }
    model = problem.linearized(added).model
    bias = problem.sensor.bias + model.nuisances[:, :3]
    # of one session by its windows, of several also by how they differ
    root = np.sqrt(model.weight)[:, None, None] * model.nuisance
    variance = np.diag(np.linalg.pinv(np.einsum("mai,maj->ij", root, root)))[:3]
    if len(bias) > 1:
        variance = np.maximum(variance, bias.var(axis=0, ddof=1) / len(bias))
    return ReferenceResult(
        content,
        solution,
        choices,
        tuple(fitted),
        tuple(columns_of),
        covariance,
        bias,
        variance,
        model.nuisances[:, 3:6],
        place | {"residual": np.full(len(session), kind, object)} | columns,
    )


def diagnose_references(sessions, noise, gravity, settings, tests, solutions):
    """Return the ReferenceResult of each sensor, empty of a device without such a session.

    Takes sessions as `calibrate.calibrate.usable` does, the NoiseModel, local gravity, m/s^2, the
    number of tests of the other records and the Solutions of the poses, by sensor.
    """
    kinds = [session["kind"] for session in sessions.values()]
    if "reference_motion" not in kinds:
        return {}
    recording = read_reference(sessions)
    found = {}
    for sensor in (Accelerometer(noise, gravity), Gyroscope(noise, gravity)):
        poses = solutions[sensor.sensor]
        found[sensor.sensor] = diagnose_reference(sensor, recording, settings, tests, poses)
    return found


def windows_table(results):
    """Return the columns of reference.parquet: a row a window, not-a-number where not its kind."""
    table = no_tables()["reference"]
    for result in results.values():
        count = len(result.windows.get("session", ()))
        for name, column in table.items():
            missing = np.full(count, np.nan, column.dtype)
            own = result.windows.get(name, missing)
            table[name] = np.concatenate([column, np.asarray(own, column.dtype)])
    return table


def with_reference(calibration, results):
    """Return the calibration; of a sensor that no poses determine, that beside the reference.

    Effects of where a marker sits and how late the reference is are not the sensor's: they are not
    in it; nor is what was held out within a session only. The gyroscope's axes are turned onto the
    accelerometer's where places show these.
    """
    known = {s: r for s, r in results.items() if r.solution is not None}
    solution, turned = {}, np.zeros((1, 3))
    if len(known) == 2:
        turned = known["gyroscope"].frame - known["accelerometer"].frame
    for sensor, result in known.items():
        own = getattr(calibration, sensor)
        if own.method not in ("nominal", "static"):
            continue
        x, covariance, count = result.solution.fit.x, result.covariance, 6
        names, model = accelerometer.NAMES, Accelerometer
        if sensor == "gyroscope":
            names, model = gyroscope.NAMES, Gyroscope
        T, K = model.unpack(x)
        if sensor == "gyroscope":
            T = T + cross_matrix(turned.mean(axis=0)[None])[0]
        at, kept = [*range(count)], []
        for effect, columns in zip(result.effects, result.columns, strict=True):
            if effect.name not in BESIDE and len(result.bias) >= WHOLE:
                kept.append(effect.effect)
                at += columns
        order = [(int(n[1]), int(n[2])) for n in names if n[0] == "T"]
        values = [*(T[i] for i in order), *K, *result.bias.mean(axis=0)]
        values = np.append(values, x[at[count:]])
        # what each parameter is of those of the fit; T of a gyroscope is symmetric but for the turn
        gain = np.zeros((len(values), len(at)))
        for row, (i, j) in enumerate(order):
            gain[row, [(0, 1), (0, 2), (1, 2)].index((min(i, j), max(i, j)))] = 1.0
        first = len(order)
        gain[range(first, first + 3), range(3, 6)] = 1.0
        gain[range(first + 6, len(values)), range(6, len(at))] = 1.0
        spread_ = gain @ covariance[np.ix_(at, at)] @ gain.T
        spread_[range(first + 3, first + 6), range(first + 3, first + 6)] = result.bias_variance
        if sensor == "gyroscope" and len(turned) > 1:
            own_turn = (turned.var(axis=0, ddof=1) / len(turned))[[2, 1, 2, 0, 1, 0]]
            spread_[range(6), range(6)] += own_turn
        made = in_raw_units(
            own.raw_unit, names, values, spread_, method="reference_motion", effects=kept
        )
        solution[sensor] = made
    return replace(calibration, **solution)
