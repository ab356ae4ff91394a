"""A sensor beside a reference: what a model leaves of known rotations, and of known places."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, block_diag
from scipy.special import chdtri

from imuloop.calibrate.least_squares import Solution, why_no_fit
from imuloop.calibrate.noise_components import Component
from imuloop.calibrate.recording import OWN
from imuloop.calibrate.reference.recording import read_reference
from imuloop.calibrate.reference.sensors import SENSORS, ReferenceSensor, started
from imuloop.calibrate.reference.tails import spread
from imuloop.core.effect import Channels, Effect, FittedEffect
from imuloop.core.precision import precision
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import search_content
from imuloop.diagnose.evidence import Evidence, Hypotheses, RowGroup
from imuloop.diagnose.records.carried import carried, errors_over, series
from imuloop.diagnose.records.one_solution import WHOLE
from imuloop.diagnose.records.pose_diagnosis import judged_residuals
from imuloop.diagnose.records.pose_problem import Linearized, PoseProblem, by_effect
from imuloop.diagnose.records.pose_tables import no_tables
from imuloop.diagnose.records.set_up import fixed, prior_rows, set_up, set_up_content
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
    windows: dict = field(default_factory=dict)  # by column: a row per window
    sensor: ReferenceSensor | None = None
    # of the sensor's state, the set-up and what the search adds; None where nothing was tested
    solution: Solution | None = None
    covariance: np.ndarray | None = None
    # why nothing of it is of the sensor alone; None if it is
    within: str | None = None
    # why T and K beside the reference are no better than those that are known; None if they are
    no_axes: str | None = None
    # of each session bias, SI as logged, and rotation between both bodies, (s, 6), and variance of
    # the mean, (6,)
    sessions: np.ndarray | None = None
    variance: np.ndarray | None = None


class ReferenceProblem(PoseProblem):
    """Windows of one sensor beside a reference, of noise that is white with heavy tails.

    How large its excess and its tails are is found again beside the effects of each fit. A
    reference sees some markers in one attitude and others in the next: hypotheses are how much of
    what is left goes with the attitude.
    """

    # the tails, found again beside an effect, hide some of it, as they do not in drawn records:
    # effects as large as these ask for were found 82 times of 100
    limit_correction = 1.05

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
    def error_scale(self):
        """What a held-out error is compared in: windows with an outlier say little."""
        return np.sqrt(1 / np.diag(self.linearized().evidence.row_groups[0].noise.precision[0]))

    def _made(self, base):
        effects, sensor, x = (*self.found, *base), self.sensor, self.sensor.state
        if base:
            before = self.linearized(base[:-1]).model
            sensor, x = replace(sensor, weight=before.weight), before.x
        rows, z = self.base_rows
        count, more = rows.shape[1], sum(len(e.parameters) for e in base)
        known, x = np.pad(rows, ((0, 0), (0, more))), np.append(x, np.zeros(count + more - len(x)))
        for _ in range(2 if base else 3):
            solution = sensor.fit(self.recording, effects, x, (known, z))
            x, model = solution.fit.x, sensor.model(solution, self.recording)
            values, jacobian = model.residuals()
            variance = spread(values.reshape(-1, 3), self.floor[: len(values) : 3])
            sensor = replace(sensor, weight=1 / variance)
        values = np.append(values, known @ x - z)
        jacobian = np.concatenate([jacobian, known])
        own = by_effect(jacobian[:, None, count:], base)

        size = np.median(variance)
        white = np.diag(np.append(np.repeat(variance, 3), np.ones(len(z))))
        common = size * self.common
        alternatives = Hypotheses.of(precision(white + k * common) for k in COMMON)

        def hypotheses(_):
            return alternatives

        def design(effect):
            return own[effect] if effect in own else self.added(effect)

        rows = RowGroup(-values[:, None], jacobian[:, :count], alternatives, self.row_parts)
        evidence = Evidence([rows], np.zeros(len(COMMON)), design)
        known = [(0.0, np.diag(self.floor))]
        noise = white, [Component(common)]
        return Linearized(solution, model, values, jacobian, known, noise, evidence, hypotheses)

    def nearest(self, base):
        """Return the residuals about the fit with these very effects.

        Without an offset in time the windows of fast turns are those of the tails: by their weights
        a part would be predicted from the slow ones alone.
        """
        return self.linearized(base)

    def rejection_reason(self, base, held_out=frozenset()):
        """Return why effects do not count, or the fit of all data is none; None if they do.

        A reference that leaves more than its noise may err with attitude, as effects of the sensor
        do: one session, or two, cannot tell.
        """
        if base and (reason := self.within(base)):
            return reason
        if held_out:
            return None
        return self.sensor.rejection_reason(self.linearized(base).solution, self.recording)

    def within(self, base):
        """Return why a reference in few sessions does not tell the sensor from itself, or None."""
        if len(self.recording.logs) < WHOLE:
            values = self.linearized(base).values
            if np.median(values**2 / self.floor) > ABOVE * chdtri(1, 0.5):
                return WITHIN
        return None

    def slow(self, effect):
        """Return whether noise could be larger for an effect: it is known by what is left."""
        return False


def shapes_beside(sensor, recording):
    """Return the shapes of each effect to try on a sensor beside a reference, and the others."""
    log = recording.logs[0]
    channels = Channels(log.t, *(getattr(log, n) for n in OWN[sensor]), log.temperature)
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


def diagnose_reference(sensor, recording, settings, tests, search_formulas=None):
    """Return the ReferenceResult of a sensor, a `calibrate.reference.sensors.ReferenceSensor`.

    `tests` is the number of tests of the device's other records, which share the significance;
    `search_formulas` as of `pose_diagnosis.diagnose_poses`.
    """
    windows = sensor.windows(recording)
    if len(windows) < LEAST_WINDOWS:
        why = f"{len(windows)} windows with a reference, at least {LEAST_WINDOWS} needed"
        return ReferenceResult(not_testable(why))
    shapes, others = shapes_beside(sensor.sensor, recording)
    beside, known = set_up(sensor.sensor, recording), [e.effect for e in sensor.shown]
    fitted = set(kinds_of((*known, *beside)))
    shapes = {c: s for c, s in shapes.items() if c not in fitted}
    others |= {e.kind: ("added", "found in other records") for e in known}
    problem = ReferenceProblem(
        started(sensor, recording),
        recording,
        shapes,
        settings,
        tests + settings.family * (len(shapes) + len(beside)),
        _parts(windows, settings.folds),
        beside,
        base_rows=prior_rows(sensor, beside),
    )
    try:
        if reason := problem.rejection_reason(()):
            return ReferenceResult(not_testable(reason))
        return _diagnosed(Choices(problem), others, search_formulas)
    except LinAlgError as error:
        return ReferenceResult(not_testable(why_no_fit(error)))


def _parts(windows, count):
    """Return the part of each window: its session, or one of few sessions' stretches of time."""
    number = len(windows.logs)
    if number >= WHOLE:
        return windows.session
    blocks = count // number
    length = np.array([len(log.t) for log in windows.logs])[windows.session]
    return windows.session * blocks + np.minimum(blocks * windows.first // length, blocks - 1)


def _diagnosed(choices, others, search_formulas):
    """Return the ReferenceResult of a problem that can be tested."""
    sensor, (result, added) = choices.problem.sensor.sensor, _result(choices)
    found = search_content(choices, added, others, [], sensor)
    if (
        search_formulas
        and leaves(result.content)
        and (more := search_formulas("reference", sensor, choices))
    ):
        found["discovered"] = more.content
        if more.choices:
            result, added = _result(more.choices)
            found |= more.joined(found["effects"], found["candidates"], added)
    of_set_up = {key: result.content[key] + found[key] for key in ("effects", "candidates")}
    return replace(result, content=result.content | found | of_set_up)


def _result(choices):
    """Return the ReferenceResult by Choices, of effects those of the set-up, and FittedEffects.

    T and K are as they are known without the reference where they predict no worse so; they are
    free where nobody can tell.
    """
    problem, base, no_axes = choices.problem, choices.choice().base, None
    sensor, names = problem.sensor, problem.recording.names
    windows, count = sensor.windows(problem.recording), len(sensor.state)
    within = problem.within(base)
    if not within:
        known = Choices(fixed(problem, np.arange(count), sensor.state), choices)
        if no_axes := _no_better(choices, known):
            choices, problem = known, known.problem
    solution, model = problem.linearized(base).solution, problem.linearized(base).model
    covariance = problem.covariance(base)
    pairs = np.array([solution.fit.x, np.sqrt(np.diag(covariance))])[:, count:]
    fitted = {
        e: FittedEffect(e, *(dict(zip(e.parameters, v.tolist(), strict=True)) for v in pair))
        for e, pair in by_effect(pairs, solution.effects).items()
    }
    errors = choices.errors(choices.nested)
    beside, before = set_up_content(choices, covariance, fitted, errors)
    content, columns = judged_residuals(choices, tuple(sensor.kinds), errors, before=before)
    content |= beside | {"sessions": len(names)}
    if sensor.sensor == "gyroscope":
        parts = carried(choices, before)
        content["by_duration"] = errors_over(parts)
        if shown := series(parts, names):
            content["series"] = shown
    table = {
        "session": np.array(names, dtype=object)[windows.session],
        "start_s": windows.of_logs("t", windows.first),
        "end_s": windows.of_logs("t", windows.last),
        "residual": np.full(len(windows), *sensor.kinds, object),
    }
    sessions = model.nuisances[:, :6] + np.pad(sensor.bias, ((0, 0), (0, 3)))
    # as the windows show, and as sessions differ
    variance = np.diag(model.covariance_of_mean(covariance))[:6]
    if len(sessions) > 1:
        variance = np.maximum(variance, sessions.var(axis=0, ddof=1) / len(sessions))
    fit = sensor, solution, covariance, within, no_axes, sessions, variance
    return ReferenceResult(content, table | columns, *fit), [fitted[e] for e in base]


def _no_better(choices, known):
    """Return why T and K are no better fitted than as `known`, other Choices, has them, or None.

    Effects are the same; held-out errors are compared in the deviations of the windows by both.
    """
    count, each = 3 * len(choices.problem.part_of_pose), (known, choices)
    size = np.sqrt(sum(c.problem.error_scale[:count] ** 2 for c in each) / 2)[:, None]
    errors = (c.errors(c.nested)[:count] / size for c in each)
    ratio = choices.ratio(choices.problem.part_of_row[:count], *errors)
    return None if ratio[1] < 1 else f"{NO_BETTER}: ratio {ratio[0]:.3f} to {ratio[1]:.3f}"


def diagnose_references(
    sessions, noise, gravity, settings, tests, calibration, search_formulas=None
):
    """Return the ReferenceResult of each sensor, empty of a device without such a session.

    Takes sessions as `calibrate.calibrate.usable` does, the NoiseModel, local gravity, m/s^2, the
    number of tests of the other records, the Calibration by these, and `search_formulas` as of
    `pose_diagnosis.diagnose_poses`.
    """
    kinds = [session["kind"] for session in sessions.values()]
    if "reference_motion" not in kinds:
        return {}
    recording = read_reference(sessions)
    each = (cls(noise, gravity, getattr(calibration, name)) for name, cls in SENSORS.items())
    return {
        s.sensor: diagnose_reference(s, recording, settings, tests, search_formulas) for s in each
    }


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
