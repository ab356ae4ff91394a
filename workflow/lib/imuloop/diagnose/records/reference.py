"""A sensor beside a reference: what a model leaves of known rotations, and of known places."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.pose_fits import Solution
from imuloop.calibrate.reference import spread, started
from imuloop.core.effect import Channels, Effect, FittedEffect
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import search_content
from imuloop.diagnose.evidence import Block, Evidence, Hypotheses
from imuloop.diagnose.records.pose_diagnosis import judged_residuals
from imuloop.diagnose.records.poses import Linearized, PoseProblem, _by_effect
from imuloop.diagnose.verdict import not_testable

# windows at least: three components each, for nine parameters and a part held out
LEAST_WINDOWS = 20
# variance of the errors that the reference has in common where attitudes are alike, as a share of
# all that is left
COMMON = (0.0, 0.3, 1.0, 3.0)
SLIPS = "a reference that slips on the device tilts gravity, and so looks like a changing bias"
# sessions from which on whole ones are held out: without two of them one is left to learn from
WHOLE = 3


@dataclass(frozen=True)
class ReferenceResult:
    """The diagnosis of a sensor beside a reference."""

    content: dict  # the contract's fields
    solution: Solution | None = None
    choices: Choices | None = None
    effects: tuple = ()  # FittedEffect each
    # by column: a row per window
    windows: dict = field(default_factory=dict)


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
        return found / np.diag(found).mean()

    @cached_property
    def floor(self):
        """Variance that the noise as estimated gives each row, (N,)."""
        return np.repeat(self.sensor.floor(self.recording), 3)

    @cached_property
    def measure(self):
        """What a held-out error is compared in: windows with an outlier say little."""
        return np.sqrt(1 / np.diag(self.linearized().evidence.blocks[0].noise.precision[0]))

    def _made(self, base):
        count, x = len(self.sensor.names), None
        if base:
            before = self.linearized(base[:-1])
            x, sensor = before.solution.fit.x, replace(self.sensor, weight=before.model.weight)
        else:
            sensor = self.sensor
        for _ in range(3):
            solution = sensor.fit(self.recording, base, x)
            model, x = sensor.model(solution, self.recording), solution.fit.x
            values, jacobian = model.residuals()
            variance = spread(values.reshape(-1, 3), self.floor[::3])
            sensor = replace(sensor, weight=1 / variance)
        own = _by_effect(jacobian[:, None, count:], base)

        white, size = np.diag(np.repeat(variance, 3)), np.median(variance)
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
            self._columns[effect] = model.residuals()[1][:, None, -len(effect.parameters) :]
        return self._columns[effect]

    def lost(self, base, out=frozenset()):
        """Return why the fit of all data is none, or None; parts are held out of many windows."""
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
    found, others = candidates(sensor, "poses", Channels(log.t, own, other, log.temperature))
    for cls in Effect.library.values():
        if sensor in cls.sensors and {"motion", "reference"} & {*cls.records}:
            found[cls] = tuple(cls.shapes(None))
            others.pop(cls, None)
            if cls.name == "lever_arm":
                found[cls] = (cls(marker=True),)
    if sensor == "accelerometer":
        for cls in [cls for cls in found if cls.timed]:
            del found[cls]
            others[cls] = ("not_observable", SLIPS)
    return found, others


def diagnose_reference(sensor, recording, settings, tests):
    """Return the ReferenceResult of a sensor, a `calibrate.reference.ReferenceSensor`.

    `tests` is the number of tests of the device's other records, which share the significance.
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
    )
    try:
        if reason := problem.lost(()):
            return ReferenceResult(not_testable(reason))
        return _diagnosed(Choices(problem), others, (session, first, last))
    except LinAlgError:
        return ReferenceResult(not_testable(SINGULAR))


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
    std, fitted, at = np.sqrt(np.diag(problem.covariance(added))), [], len(problem.sensor.names)
    for effect in added:
        own = range(at, at + len(effect.parameters))
        pair = (
            dict(zip(effect.parameters, map(float, v[own]), strict=True)) for v in (x, std)
        )
        fitted.append(FittedEffect(effect, *pair))
        at += len(own)
    content = judged | search_content(problem.sensor.sensor, choices, fitted, others, [])
    session, first, last = windows
    names, logs = np.array(problem.recording.names, dtype=object), problem.recording.logs
    place = {
        "session": names[session],
        "start_s": np.array([logs[s].t[i] for s, i in zip(session, first, strict=True)]),
        "end_s": np.array([logs[s].t[i] for s, i in zip(session, last, strict=True)]),
    }
    return ReferenceResult(content, solution, choices, tuple(fitted), place | columns)
