"""Diagnosis of static records: effects in means at rest, and the noise without these effects."""

from dataclasses import asdict, dataclass, field
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.core.noise_model import NoiseModel, without_weight
from imuloop.core.samples import SENSORS
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.records.correction import corrected_sessions
from imuloop.diagnose.records.moves import separate
from imuloop.diagnose.records.rests import LONG_REST
from imuloop.diagnose.records.static import StaticProblem, fitted_effects, information
from imuloop.diagnose.records.static_content import searched_content, static_content
from imuloop.estimate.choice import Choices
from imuloop.estimate.least_squares import why_no_fit
from imuloop.estimate.verdict import not_testable
from imuloop.model.effect import Channels
from imuloop.model.effects import SensorEffect
from imuloop.noise.allan import session_curves
from imuloop.noise.noise import estimate_noise

# number of windows that is enough to tell noise from spectral lines
ENOUGH = 64


@dataclass(frozen=True)
class StaticResult:
    """The diagnosis of the static records of a device."""

    content: dict  # content of diagnosis.json, by sensor
    effects: dict  # FittedEffects that a calibration can have, by sensor
    # noise estimated after subtracting the effects, doubtful ones too
    noise: NoiseModel
    # Allan table after subtracting the effects, by session; empty if there are none
    allan: dict = field(default_factory=dict)
    # StaticFinding of each sensor that could be tested
    findings: dict = field(default_factory=dict)

    def at_poses(self, warm):
        """Return the effects that the poses have too, and the `information` of PoseProblem.

        The effects are SensorEffects; the second result is a function or None. `warm` says whether
        the poses have a temperature.
        """
        found = tuple(
            SensorEffect(e.effect, sensor)
            for sensor, effects in self.effects.items()
            for e in effects
            if warm or "temperature" not in e.effect.needs
        )
        return found, partial(self.information, found) if self.findings else None

    def information(self, found, effects):
        """Return the information of static records about q parameters θ of effects.

        The result is A, (q, q), and b, (q,), SI: the logarithm of the likelihood of θ is
        ``-θᵀ A θ/2 + bᵀ θ``. `effects` are SensorEffects of both sensors, with q parameters
        together. Static records are used for the effects in `found` and for other effects of the
        temperature; the parameters of all other effects have zeros.
        """
        ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
        A, b = np.zeros((ends[-1],) * 2), np.zeros(ends[-1])
        for sensor, finding in self.findings.items():
            numbers = [
                k
                for k, e in enumerate(effects)
                if e.sensor == sensor and (e in found or ("temperature" in e.needs and not e.timed))
            ]
            if numbers:
                index = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in numbers])
                shapes = tuple(effects[k].effect for k in numbers)
                search, base = finding.choices.search(), tuple(e.effect for e in finding.effects)
                A[np.ix_(index, index)], b[index] = information(search, base, shapes)
        return A, b


@dataclass(frozen=True)
class StaticFinding:
    """The result of the search in the static records of one sensor."""

    choices: Choices  # the searches and the choice of effects
    others: dict  # status and reason of effects that cannot be tried
    effects: tuple  # FittedEffects that were added
    # the same plus the best effect that passes the test but that cross-validation does not confirm
    doubtful: tuple
    # held-out errors without and with effects, (N, 3) each; effects are chosen without each fold
    errors: tuple


def static_tests(records, settings):
    """Return the number of tests of the static records of both sensors.

    `records` has the StaticRecords of each sensor.
    """
    usable_ones = {sensor: usable(own, settings) for sensor, own in records.items()}
    return sum(len(static_candidates(s, own)[0]) for s, own in usable_ones.items() if own)


def usable(records, settings):
    """Return the records that have at least two windows for each fold."""
    return [r for r in records if len(r.windows) >= 2 * settings.blocks]


def static_candidates(sensor, records):
    """Return the shapes to try on a sensor in static records, and the effects that are not tried.

    Both are dicts by type of effect: a tuple of shapes, and a status with its reason.
    """

    def joined(name):
        parts = [getattr(r.channels, name) for r in records]
        return None if any(p is None for p in parts) else np.concatenate(parts)

    channels = Channels(*(joined(n) for n in ("t", "output", "other", "temperature")))
    found, others = candidates(sensor, "static_record", channels)
    # shapes with a price are for shorter records: hours at rest show the lag of a thermometer
    return {cls: tuple(e for e in own if not e.price) for cls, own in found.items()}, others


def diagnose_static(data, records, calibration, noise, settings, noise_settings, tests):
    """Return the StaticResult of both sensors of a device.

    Parameters
    ----------
    data : StaticData
        Samples at rest.
    records : dict of str to list of StaticRecord
        Their means, by sensor.
    calibration : Calibration
        The base model. Effects are errors of its output ``K (raw - b)``.
    noise : NoiseModel
        Noise of the device. It is estimated again after effects are subtracted.
    settings : DiagnoseSettings
    noise_settings : NoiseSettings
        Settings of the noise stage.
    tests : int
        Number of tests that share the significance.
    """
    findings, reasons = {}, {}
    for sensor, axes in SENSORS.items():
        own = usable(records[sensor], settings)
        if sensor == "accelerometer" and own:
            own = separate(own, 2 * settings.blocks)
        reason = why_untestable(own, [noise.axes[name] for name in axes], settings)
        try:
            if not reason:
                findings[sensor] = find(sensor, own, settings, tests)
        except LinAlgError as error:
            reason = why_no_fit(error)
        reasons[sensor] = reason

    def without(found):
        """Return the noise after subtracting FittedEffects, by sensor, and the corrected sessions.

        Without effects they are the noise as given and an empty list.
        """
        if not any(found.values()):
            return noise, []
        sessions = corrected_sessions(data, calibration, found)
        return estimate_noise(noise.device, sessions, noise_settings, views=False).model, sessions

    found = {sensor: finding.effects for sensor, finding in findings.items()}
    (whole, sessions), made = without(found), {}
    curves = {s.name: session_curves(s, noise_settings, "corrected") for s in sessions}
    del sessions
    for sensor, finding in findings.items():
        change = {
            name: {"before": asdict(noise.axes[name]), "after": asdict(whole.axes[name])}
            for name in (SENSORS[sensor] if finding.effects else ())
        }
        searched = searched_content(sensor, finding)
        made[sensor] = static_content(sensor, finding, searched, whole, change)
    doubtful = {sensor: finding.doubtful for sensor, finding in findings.items()}
    if doubtful != found:
        # a warm-up in one record only is not confirmed, but it must not count as random walk
        whole = without(doubtful)[0]
    lasting = {s: tuple(e for e in found.get(s, ()) if e.effect.lasting) for s in SENSORS}
    content = {s: made.get(s) or not_testable(reasons[s]) for s in SENSORS}
    allan = {name: table for name, table in curves.items() if len(table["tau_s"])}
    return StaticResult(content, lasting, whole, allan, findings)


def why_untestable(records, axes, settings):
    """Return the reason, text, why the records of a sensor cannot be diagnosed, or None.

    `records` are its StaticRecords and `axes` the AxisNoise of its axes.
    """
    if not records:
        return (
            f"no static session, and no rest of {LONG_REST / 60:g} minutes, with the "
            f"{2 * settings.blocks} means needed: record a static session, better two hours"
        )
    if not all(a.N.square or a.Q.square or a.B.square or a.K.square for a in axes):
        return "the noise of an axis is not known"
    if not all(np.ptp(r.values, axis=0).all() for r in records):
        return "an axis never changes"
    # some of the windows are enough, and all could take long
    covariances = np.stack([a.mean_covariance(records[0].windows[:ENOUGH]) for a in axes])
    if without_weight(covariances)[1].any():
        return "an axis shows lines and no noise beside them: its noise is not known"
    return None


def find(sensor, records, settings, tests):
    """Return the StaticFinding of a sensor: search its StaticRecords for effects."""
    available, others = static_candidates(sensor, records)
    shapes = {cls: s for cls, s in available.items() if s}
    choices = Choices(StaticProblem(tuple(records), shapes, settings, tests))
    choice, search = choices.choice(), choices.search()
    errors = choices.errors_with(()), choices.errors(choices.nested_choice)
    unconfirmed = [k for k in choice.failed if k.lasting]
    trial = search.trial(choice.base, unconfirmed[0]) if unconfirmed else None
    effects = fitted_effects(search, choice.base)
    doubtful = fitted_effects(search, (*choice.base, trial.effect)) if trial else effects
    choices.problem.release()
    return StaticFinding(choices, others, effects, doubtful or effects, errors)
