"""Static records: means at rest against their noise, the effects in them, the noise without."""

from dataclasses import asdict, dataclass, field, replace
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.calibrate.least_squares import why_no_fit
from imuloop.core.effect import Channels
from imuloop.core.noise_model import (
    AxisNoise,
    Coefficient,
    GaussMarkovTerm,
    NoiseModel,
    without_weight,
)
from imuloop.core.samples import SENSORS
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.records.moves import separated
from imuloop.diagnose.records.rests import LONG_REST
from imuloop.diagnose.records.slow_noise import prediction_errors
from imuloop.diagnose.records.static import StaticProblem, fitted_effects, fold_of, information
from imuloop.diagnose.records.static_content import static_content
from imuloop.diagnose.verdict import leaves, not_testable
from imuloop.effects.sinusoid import Sinusoid
from imuloop.noise.correction import noise_again, with_lines

# windows that tell noise from lines
ENOUGH = 64


@dataclass(frozen=True)
class StaticResult:
    """The diagnosis of the static records of a device."""

    content: dict  # the contract's fields, by sensor
    effects: dict  # FittedEffects that belong into a calibration, by sensor
    # noise without the effects, doubtful ones too, with the lines that were found
    noise: NoiseModel
    # Allan table without the effects, by session; empty where nothing was taken out
    allan: dict = field(default_factory=dict)
    # Finding of each sensor that could be tested
    findings: dict = field(default_factory=dict)

    def shown(self, sensor, with_temperature):
        """Return the effects of a sensor that the poses have too, and `information` of any effect.

        `with_temperature` is whether the poses have a temperature.
        """
        if sensor not in self.findings:
            return (), None
        shown = tuple(
            e.effect
            for e in self.effects[sensor]
            if with_temperature or "temperature" not in e.effect.needs
        )
        found = self.findings[sensor]
        return shown, partial(information, found.choices.search(), found.base)


@dataclass(frozen=True)
class Finding:
    """What was found in the static records of a sensor."""

    choices: Choices  # the searches, and what they added
    others: dict  # status and reason of effects that cannot be tried
    effects: tuple  # FittedEffects that were added, a formula of no library last
    # the same with the best that passes the test, but that no held-out part confirms
    doubtful: tuple
    # (N, 3): held-out errors, the whole search made again without each block
    before: np.ndarray
    after: np.ndarray
    further: object = None  # FormulaSearch of a search of what the library leaves

    def with_formula(self, further):
        """Return the same with what a search beyond the library found."""
        if not further.choices:
            return replace(self, further=further)
        effects = fitted_effects(self.choices.search(), further.choices.base)
        if effects is None:
            return replace(self, further=replace(further, choices=None))
        errors = further.choices.errors(further.choices.nested)
        return replace(self, further=further, effects=effects, doubtful=effects, after=errors)

    @property
    def base(self):
        """The effects that were added, in their shapes."""
        return tuple(e.effect for e in self.effects)


def static_tests(records, settings):
    """Return how many tests the static records of both sensors add to a family."""
    usable_ones = {sensor: usable(own, settings) for sensor, own in records.items()}
    return sum(len(static_candidates(s, own)[0]) for s, own in usable_ones.items() if own)


def usable(records, settings):
    """Return the records that have means enough for blocks."""
    return [r for r in records if len(r.windows) >= 2 * settings.blocks]


def static_candidates(sensor, records):
    """Return what `candidates` does for a sensor in static records."""

    def joined(name):
        parts = [getattr(r.channels, name) for r in records]
        return None if any(p is None for p in parts) else np.concatenate(parts)

    channels = Channels(*(joined(n) for n in ("t", "output", "other", "temperature")))
    found, others = candidates(sensor, "static_record", channels)
    # hours tell how the temperature changes, and so what a late thermometer leaves
    return {cls: tuple(e for e in own if not e.price) for cls, own in found.items()}, others


def diagnose_static(
    data, records, calibration, noise, curve_fit, settings, noise_settings, tests, beyond=None
):
    """Return the StaticResult of both sensors of a device.

    Takes StaticData, the StaticRecords of each sensor, the base calibration, to whose
    ``K (raw - b)`` effects add, the device's noise and, as of `NoiseResult`, its plain fits, both
    estimated again by the settings of their stage where effects are taken out; `tests` is the
    number of tests that share the significance, `beyond` as of `pose_diagnosis.diagnose_poses`.
    """
    findings, reasons = {}, {}
    for sensor, axes in SENSORS.items():
        own = usable(records[sensor], settings)
        if sensor == "accelerometer" and own:
            own = separated(own, 2 * settings.blocks)
        reason = untestable(own, [noise.axes[name] for name in axes], settings)
        if reason:
            reasons[sensor] = not_testable(reason)
            continue
        try:
            findings[sensor] = find(sensor, own, settings, tests)
        except LinAlgError as error:
            reasons[sensor] = not_testable(why_no_fit(error))

    def result():
        return _result(findings, reasons, data, calibration, (noise, curve_fit), noise_settings)

    made = result()
    for sensor, finding in findings.items() if beyond else ():
        own = made.content[sensor]
        if leaves(own) and (further := beyond("static_record", sensor, finding.choices)):
            findings[sensor] = finding.with_formula(further)
            own["discovered"] = findings[sensor].further.content
    # a formula changes the noise of both sensors
    named = any(f.further and f.further.choices for f in findings.values())
    return result() if named else made


def _result(findings, reasons, data, calibration, logged, noise_settings):
    """Return the StaticResult of Findings, and of the reasons why there are none, by sensor.

    `logged` is the noise with its plain fits, as of `diagnose_static`.
    """
    content = dict(reasons)
    found = {sensor: finding.effects for sensor, finding in findings.items()}
    allan, (noise, _), (floor, curve_fit) = {}, logged, logged
    if any(found.values()):
        again, allan = noise_again(noise.device, data, calibration, found, noise_settings)
        floor, curve_fit = again.model, again.curve_fit
    whole = with_lines(floor, found)
    for sensor, finding in findings.items():
        change = {
            name: {"before": asdict(noise.axes[name]), "after": asdict(whole.axes[name])}
            for name in (SENSORS[sensor] if finding.effects else ())
        }
        fine = data.records(sensor, calibration, 0.0)
        processes = find_processes(sensor, finding, fine, floor, curve_fit)
        content[sensor] = static_content(sensor, finding, floor, change, processes)
    names = {e.name for own in found.values() for e in own}
    doubtful = {sensor: finding.doubtful for sensor, finding in findings.items()}
    if doubtful != found:
        # a warm-up that no second start confirms is no random walk either
        without, _ = noise_again(noise.device, data, calibration, doubtful, noise_settings)
        rest = with_lines(without.model, found)
    else:
        # a line is noise elsewhere, and the noise as logged has it
        rest = noise if names <= {Sinusoid.name} else whole
    return StaticResult(
        {sensor: content[sensor] for sensor in SENSORS},
        {s: tuple(e for e in found.get(s, ()) if e.effect.lasting) for s in SENSORS},
        rest,
        allan,
        findings,
    )


def untestable(records, axes, settings):
    """Return why the records of a sensor cannot be diagnosed, or None."""
    if not records:
        return (
            f"no static session, and no rest of {LONG_REST / 60:g} minutes, with the "
            f"{2 * settings.blocks} means needed: record a static session, better two hours"
        )
    if not all(a.N.square or a.Q.square or a.B.square or a.K.square for a in axes):
        return "the noise of an axis is not known"
    if not all(np.ptp(r.values, axis=0).all() for r in records):
        return "an axis never changes"
    # some windows show it, and many take long
    covariances = np.stack([a.mean_covariance(records[0].windows[:ENOUGH]) for a in axes])
    if without_weight(covariances)[1].any():
        return "an axis shows lines and no noise beside them: its noise is not known"
    return None


def find(sensor, records, settings, tests):
    """Return the Finding of a sensor in its means."""
    available, others = static_candidates(sensor, records)
    shapes = {cls: s for cls, s in available.items() if s}
    choices = Choices(StaticProblem(tuple(records), shapes, settings, tests))
    choice, search = choices.choice(), choices.search()
    before, after = choices.following(()), choices.errors(choices.nested)
    unconfirmed = [cls for cls in choice.failed if isinstance(cls, type) and cls.lasting]
    trial = search.trial(choice.base, unconfirmed[0]) if unconfirmed else None
    effects = fitted_effects(search, choice.base)
    doubtful = fitted_effects(search, (*choice.base, *trial.effects)) if trial else effects
    return Finding(choices, others, effects, doubtful or effects, before, after)


@dataclass(frozen=True)
class AxisProcess:
    """Noise with a correlation time that the noise stage found on an axis, and what it foretells.

    `before` and `after`, shape (n,), SI, are errors of means that are foretold without it and with
    it, as of `slow_noise.prediction_errors`, each block of time from its own beginning on.
    """

    term: GaussMarkovTerm
    fold: np.ndarray  # (n,): the block of time of each mean
    before: np.ndarray
    after: np.ndarray


def find_processes(sensor, finding, fine, noise, curve_fit):
    """Return the AxisProcess of each axis of a sensor that has one, by axis.

    Takes the StaticRecords of means over the shortest windows, from which the effects that were
    found are taken out here, the NoiseModel of what is left, and its plain fits without processes.
    """
    problem, found = finding.choices.problem, {}
    for place, axis in enumerate(SENSORS[sensor]):
        own = noise.axes[axis]
        if not own.gauss_markov:
            continue
        plain = {term: Coefficient(curve_fit[axis][term]) for term in "QNBK"}
        models, parts = (AxisNoise(**plain, sinusoid=own.sinusoid), own), []
        for record in fine:
            taken = sum((record.derivative(e.effect) @ e.vector for e in finding.effects), 0.0)
            values, fold = (record.values - taken)[:, place], fold_of(record, problem)
            for block in set(fold.tolist()) - {-1}:
                seen = fold == block
                errors = [prediction_errors(values[seen], record.windows[seen], m) for m in models]
                parts.append((np.repeat(block, seen.sum()), *errors))
        if parts:
            largest = max(own.gauss_markov, key=lambda p: p.q.square * p.tc.value)
            found[axis] = AxisProcess(largest, *map(np.concatenate, zip(*parts, strict=True)))
    return found
