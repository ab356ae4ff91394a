"""A sensor beside a reference: what a model leaves of known rotations, and of known places."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, block_diag
from scipy.stats import chi2

from imuloop.calibrate.least_squares import Solution, why_no_fit
from imuloop.calibrate.noise_components import Component
from imuloop.calibrate.reference.recording import read_reference
from imuloop.calibrate.reference.sensors import Accelerometer, Gyroscope, started
from imuloop.calibrate.reference.tails import spread
from imuloop.core.effect import Channels, Effect, FittedEffect
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import search_content
from imuloop.diagnose.evidence import Block, Evidence, Hypotheses
from imuloop.diagnose.records.carried import carried, errors_over, series
from imuloop.diagnose.records.one_solution import WHOLE, of_records
from imuloop.diagnose.records.pose_diagnosis import judged_residuals
from imuloop.diagnose.records.pose_tables import no_tables
from imuloop.diagnose.records.poses import Linearized, PoseProblem, by_effect
from imuloop.diagnose.records.set_up import Adopted, clamped, loose, set_up, set_up_content
from imuloop.diagnose.search import kinds_of
from imuloop.diagnose.verdict import leaves, not_testable
from imuloop.effects.steps import Steps

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
NO_BETTER = (
    "T and K fitted beside the reference do not lower the error of held-out data for certain"
)


@dataclass(frozen=True)
class ReferenceResult:
    """The diagnosis of a sensor beside a reference."""

    content: dict  # the contract's fields
    solution: Solution | None = None
    choices: Choices | None = None
    effects: tuple = ()  # FittedEffect each
    columns: tuple = ()  # of each effect the places of its parameters in the solution
    covariance: np.ndarray | None = None  # of the solution's parameters
    # why nothing of it is of the sensor alone; None if it is
    within: str | None = None
    # why T and K beside the reference are no better than those that are known; None if they are
    no_axes: str | None = None
    # of each session, (s, 3): SI as logged, and what is left of the rotation between both bodies
    bias: np.ndarray | None = None
    frame: np.ndarray | None = None
    variance: np.ndarray | None = None  # of the mean of both, (6,)
    windows: dict = field(default_factory=dict)  # by column: a row per window


class ReferenceProblem(PoseProblem):
    """Windows of one sensor beside a reference, of noise that is white with heavy tails.

    How large its excess and its tails are is found again beside the effects of each fit. A
    reference sees some markers in one attitude and others in the next: hypotheses are how much of
    what is left goes with the attitude.
    """

    # the tails, found again beside an effect, hide some of it, as they do not in drawn records:
    # effects as large as these ask for were found 82 times of 100
    enough = 1.05

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
        effects, sensor, model = (*self.found, *base), self.sensor, None
        if base:
            before = self.linearized(base[:-1])
            sensor = replace(sensor, weight=before.model.weight)
            model = sensor.model_at(before.solution.fit.x, self.recording, effects)
        rows, z = self.base_rows
        count, more = rows.shape[1], sum(len(e.parameters) for e in base)
        known = np.hstack([rows, np.zeros((len(z), more))])
        for _ in range(2 if base else 3):
            solution, model = sensor.fit(self.recording, effects, model, (known, z))
            values, jacobian = model.residuals()
            variance = spread(values.reshape(-1, 3), self.floor[: len(values) : 3])
            sensor = replace(sensor, weight=1 / variance)
        values = np.append(values, known @ model.x - z)
        jacobian = np.concatenate([jacobian, known])
        own = by_effect(jacobian[:, None, count:], base)

        size = np.median(variance)
        white = np.diag(np.append(np.repeat(variance, 3), np.ones(len(z))))
        common = size * self.common
        alternatives = Hypotheses.of(white + k * common for k in COMMON)

        def hypotheses(_):
            return alternatives

        def design(effect):
            return own[effect] if effect in own else self.added(effect)

        block = Block(-values[:, None], jacobian[:, :count], alternatives, self.ends)
        evidence = Evidence([block], np.zeros(len(COMMON)), design)
        known = [(0.0, np.diag(self.floor))]
        noise = white, [Component(common)]
        return Linearized(solution, model, values, jacobian, known, noise, evidence, hypotheses)

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
        if base and (reason := self.within(base)):
            return reason
        return None if out else super().lost(base)

    def within(self, base):
        """Return why a reference in few sessions does not tell the sensor from itself, or None."""
        if len(self.recording.logs) < WHOLE:
            values = self.linearized(base).values
            if np.median(values**2 / self.floor) > ABOVE * chi2.ppf(0.5, 1):
                return WITHIN
        return None

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
    # a scan of the poses finds its time
    found.pop(Steps)
    for cls in Effect.library.values():
        if sensor in cls.sensors and {"motion", "reference"} & {*cls.records}:
            found[cls] = tuple(cls.shapes(channels))
            others.pop(cls, None)
    if sensor == "accelerometer":
        for cls in [cls for cls in found if cls.timed]:
            del found[cls]
            others[cls] = ("not_observable", SLIPS)
    return found, others


def diagnose_reference(sensor, recording, settings, tests, own, beyond=None):
    """Return the ReferenceResult of a sensor, a `calibrate.reference.sensors.ReferenceSensor`.

    `tests` is the number of tests of the device's other records, which share the significance,
    `own` the SensorCalibration by these; `beyond` as of `pose_diagnosis.diagnose_poses`.
    """
    session, first, _, last = sensor.windows(recording)
    if len(session) < LEAST_WINDOWS:
        why = f"{len(session)} windows with a reference, at least {LEAST_WINDOWS} needed"
        return ReferenceResult(not_testable(why))
    shapes, others = shapes_beside(sensor.sensor, recording)
    known, beside = of_records(sensor, own), set_up(sensor.sensor, recording)
    fitted = set(kinds_of((*known.effects, *beside)))
    shapes = {c: s for c, s in shapes.items() if c not in fitted}
    others |= {e.kind: ("added", "found in other records") for e in known.effects}
    parts = _parts(recording, session, first, settings.folds)
    problem = ReferenceProblem(
        started(sensor, recording),
        recording,
        shapes,
        settings,
        tests + settings.family * (len(shapes) + len(beside)),
        parts,
        (*known.effects, *beside),
        base_rows=loose(known.rows(), beside),
    )
    try:
        if reason := problem.lost(()):
            return ReferenceResult(not_testable(reason))
        axes = sensor.first if known.seen is None else known.seen
        return _diagnosed(Choices(problem), axes, others, (session, first, last), beyond)
    except LinAlgError as error:
        return ReferenceResult(not_testable(why_no_fit(error)))


def _parts(recording, session, first, count):
    """Return the part of each window: its session, or one of few sessions' blocks of time."""
    number = len(recording.logs)
    if number >= WHOLE:
        return session
    blocks = count // number
    length = [len(log.t) for log in recording.logs]
    return session * blocks + np.minimum(blocks * first // np.array(length)[session], blocks - 1)


def _diagnosed(choices, axes, others, windows, beyond):
    """Return the ReferenceResult of a problem that can be tested.

    `axes` are T, K and effects as they are known without the reference.
    """
    (kind,), sensor = choices.problem.sensor.kinds, choices.problem.sensor.sensor
    final = _Final.of(choices, axes)
    content = final.judged | search_content(choices, final.fitted, others, [], sensor)
    if beyond and leaves(final.judged) and (more := beyond("reference", sensor, choices)):
        content["discovered"] = more.content
        if more.choices:
            final = _Final.of(more.choices, axes)
            content |= final.judged
            content |= more.joined(content["effects"], content["candidates"], final.fitted)
    choices, columns, covariance = final.choices, final.columns, final.covariance
    content["effects"] = [*final.beside["effects"], *content["effects"]]
    content["candidates"] = [*content["candidates"], *final.beside["candidates"]]
    problem, added = choices.problem, choices.choice().base
    content["sessions"] = len(problem.recording.logs)
    if problem.sensor.sensor == "gyroscope":
        parts = carried(choices, final.before)
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
    about = problem.linearized(added)
    solution, model = about.solution, about.model
    bias = problem.sensor.bias + model.nuisances[:, :3]
    # as the windows show, and as sessions differ
    variance = np.diag(model.mean_covariance(covariance))[:6]
    if len(bias) > 1:
        found = np.hstack([bias, model.nuisances[:, 3:6]])
        variance = np.maximum(variance, found.var(axis=0, ddof=1) / len(bias))
    return ReferenceResult(
        content,
        solution,
        choices,
        tuple(final.fitted),
        tuple(final.places),
        covariance,
        final.within,
        final.no_axes,
        bias,
        model.nuisances[:, 3:6],
        variance,
        place | {"residual": np.full(len(session), kind, object)} | columns,
    )


@dataclass(frozen=True)
class _Final:
    """A model as it is reported and written."""

    choices: Choices
    before: Choices  # without what was found of the set-up
    within: str | None  # both as of ReferenceResult
    no_axes: str | None
    beside: dict  # effects and candidates of the set-up
    judged: dict
    columns: dict
    covariance: np.ndarray
    fitted: list
    places: list

    @classmethod
    def of(cls, choices, axes):
        """Return the model with the effects of Choices.

        T and K are as they are known without the reference where they predict no worse so; they are
        free where nobody can tell.
        """
        why, within = None, choices.problem.within(choices.choice().base)
        if not within:
            known = Adopted(clamped(choices.problem, np.arange(len(axes)), axes), choices)
            if why := _no_better(choices, known):
                choices = known
        covariance, fitted, places = _fitted(choices)
        beside, before = set_up_content(choices, covariance)
        kinds = tuple(choices.problem.sensor.kinds)
        errors = choices.errors(choices.nested)
        judged, columns = judged_residuals(choices, kinds, errors, before=before)
        return cls(
            choices, before, within, why, beside, judged, columns, covariance, fitted, places
        )


def _no_better(choices, known):
    """Return why T and K are no better fitted than as `known`, other Choices, has them, or None.

    Effects are the same; held-out errors are compared in the deviations of the windows by both.
    """
    problem, count = choices.problem, choices.problem.of_kind(*choices.problem.sensor.kinds).sum()
    each = known, choices
    size = np.sqrt(sum(c.problem.measure[:count] ** 2 for c in each) / 2)[:, None]
    errors = (c.errors(c.nested)[:count] / size for c in each)
    ratio = choices.ratio(problem.fold[:count], *errors)
    return None if ratio[1] < 1 else f"{NO_BETTER}: ratio {ratio[0]:.3f} to {ratio[1]:.3f}"


def _fitted(choices):
    """Return covariance of the parameters, FittedEffects, and the places of their parameters."""
    problem, added = choices.problem, choices.choice().base
    x, covariance = problem.linearized(added).solution.fit.x, problem.covariance(added)
    std, fitted, columns = np.sqrt(np.diag(covariance)), [], []
    at = len(x) - sum(len(e.parameters) for e in added)
    for effect in added:
        own = [*range(at, at + len(effect.parameters))]
        pair = (dict(zip(effect.parameters, map(float, v[own]), strict=True)) for v in (x, std))
        fitted.append(FittedEffect(effect, *pair))
        columns.append(own)
        at += len(own)
    return covariance, fitted, columns


def diagnose_references(sessions, noise, gravity, settings, tests, calibration, beyond=None):
    """Return the ReferenceResult of each sensor, empty of a device without such a session.

    Takes sessions as `calibrate.calibrate.usable` does, the NoiseModel, local gravity, m/s^2, the
    number of tests of the other records, the Calibration by these, and `beyond` as of
    `pose_diagnosis.diagnose_poses`.
    """
    kinds = [session["kind"] for session in sessions.values()]
    if "reference_motion" not in kinds:
        return {}
    recording = read_reference(sessions)
    found = {}
    for sensor in (Accelerometer(noise, gravity), Gyroscope(noise, gravity)):
        own = getattr(calibration, sensor.sensor)
        found[sensor.sensor] = diagnose_reference(sensor, recording, settings, tests, own, beyond)
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
