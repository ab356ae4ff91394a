"""Diagnosis of static records: effects in means at rest, and the noise without these effects."""

from dataclasses import asdict, dataclass, field
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.core.noise_model import NoiseModel, without_weight
from imuloop.core.samples import SENSORS
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.records.correction import corrected_sessions
from imuloop.diagnose.records.moves import cut_at_tilts
from imuloop.diagnose.records.rests import LONG_REST
from imuloop.diagnose.records.static import StaticProblem, fitted_effects, information
from imuloop.diagnose.records.static_content import static_content
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

    def effects_at_poses(self, has_temperature):
        """Return the effects of the static records that the poses have too, and their information.

        The effects are a tuple of SensorEffects. The second result is the attribute `information`
        of PoseProblem: a function, or None if no static record could be tested. `has_temperature`
        says whether the poses have a temperature.
        """
        effects = tuple(
            SensorEffect(fitted.effect, sensor)
            for sensor, of_sensor in self.effects.items()
            for fitted in of_sensor
            if has_temperature or "temperature" not in fitted.effect.needs
        )
        return effects, partial(self.information, effects) if self.findings else None

    def information(self, shown, effects):
        """Return the information of static records about the q parameters θ of some effects.

        Parameters
        ----------
        shown : tuple of SensorEffect
            Effects that the static records showed.
        effects : sequence of SensorEffect
            Effects of both sensors, with q parameters together.

        Returns
        -------
        ndarray, shape (q, q), and ndarray, shape (q,)
            Fisher information A and moment b, SI: the logarithm of the likelihood of θ is
            ``-θᵀ A θ/2 + bᵀ θ``. Parameters have zeros unless their effect is in `shown` or is an
            effect of the temperature.
        """
        ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
        A, b = np.zeros((ends[-1],) * 2), np.zeros(ends[-1])
        for sensor, finding in self.findings.items():
            numbers = [
                k
                for k, e in enumerate(effects)
                if e.sensor == sensor and (e in shown or ("temperature" in e.needs and not e.timed))
            ]
            if numbers:
                index = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in numbers])
                variants = tuple(effects[k].effect for k in numbers)
                search, base = finding.choices.search(), tuple(e.effect for e in finding.effects)
                A[np.ix_(index, index)], b[index] = information(search, base, variants)
        return A, b


@dataclass(frozen=True)
class StaticFinding:
    """The result of the search in the static records of one sensor.

    A record has the means over windows of a long rest; the N rows are the means of all records.
    """

    choices: Choices  # the searches and the choice of effects
    reasons: dict  # status and reason of effects that cannot be tried
    effects: tuple  # FittedEffects that were added
    # the same plus the best effect that passes the test but that cross-validation does not confirm
    doubtful: tuple
    # held-out errors without and with effects, (N, 3) each; effects are chosen without each fold
    errors: tuple


def static_tests(records, settings):
    """Return the number of tests of the static records of both sensors.

    `records` has a list of StaticRecords for each sensor.
    """
    used = {sensor: usable_records(records[sensor], settings) for sensor in SENSORS}
    return sum(len(static_candidates(sensor, r)[0]) for sensor, r in used.items() if r)


def usable_records(records, settings):
    """Return the StaticRecords that have at least two windows for each fold, a list."""
    return [r for r in records if len(r.windows) >= 2 * settings.blocks]


def static_candidates(sensor, records):
    """Return the variants to try on a sensor in static records, and the effects that are not tried.

    A variant is an effect with values of its constants. Both results are dicts by type of effect:
    a tuple of variants, and a status with its reason. `records` are the StaticRecords.
    """
    columns = []
    for name in ("t", "output", "other", "temperature"):
        parts = [getattr(record.channels, name) for record in records]
        columns.append(None if any(p is None for p in parts) else np.concatenate(parts))
    variants, reasons = candidates(sensor, "static_record", Channels(*columns))
    # variants with a price assume that the thermometer lags; they are for shorter records, as hours
    # at rest show the lag itself
    return {cls: tuple(s for s in tried if not s.price) for cls, tried in variants.items()}, reasons


def diagnose_static(data, records, calibration, noise, settings, noise_settings, tests):
    """Search the static records of both sensors of a device for effects.

    A static record has the means over windows of a long rest.

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

    Returns
    -------
    StaticResult
    """
    findings, content = {}, {}
    for sensor, axes in SENSORS.items():
        used = usable_records(records[sensor], settings)
        if sensor == "accelerometer" and used:
            # a disturbance that tilts the device changes the specific force: it is no effect
            used = cut_at_tilts(used, 2 * settings.blocks)
        reason = why_untestable(used, [noise.axes[name] for name in axes], settings)
        try:
            if not reason:
                findings[sensor] = search_records(sensor, used, settings, tests)
        except LinAlgError as error:
            reason = why_no_fit(error)
        content[sensor] = not_testable(reason)
    effects = {sensor: finding.effects for sensor, finding in findings.items()}
    doubtful = {sensor: finding.doubtful for sensor, finding in findings.items()}
    corrected, allan = noise, {}
    if any(effects.values()):
        sessions = corrected_sessions(data, calibration, effects)
        corrected = estimate_noise(noise.device, sessions, noise_settings, views=False).model
        curves = {s.name: session_curves(s, noise_settings, "corrected") for s in sessions}
        allan = {name: table for name, table in curves.items() if len(table["tau_s"])}
        # the samples are freed before those without doubtful effects are computed
        del sessions
    for sensor, finding in findings.items():
        change = {
            name: {"before": asdict(noise.axes[name]), "after": asdict(corrected.axes[name])}
            for name in (SENSORS[sensor] if finding.effects else ())
        }
        content[sensor] = static_content(sensor, finding, corrected, change)
    if doubtful != effects:
        # a warm-up in one record only is not confirmed, but it must not count as random walk
        sessions = corrected_sessions(data, calibration, doubtful)
        corrected = estimate_noise(noise.device, sessions, noise_settings, views=False).model
    lasting = {s: tuple(e for e in effects.get(s, ()) if e.effect.lasting) for s in SENSORS}
    return StaticResult(
        content=content, effects=lasting, noise=corrected, allan=allan, findings=findings
    )


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


def search_records(sensor, records, settings, tests):
    """Search the StaticRecords of a sensor for effects; return a StaticFinding.

    `tests` is the number of tests that share the significance.
    """
    variants_by_kind, reasons = static_candidates(sensor, records)
    # steps have no variants: a scan finds their times
    variants = {cls: variants for cls, variants in variants_by_kind.items() if variants}
    problem = StaticProblem(
        records=tuple(records), variants=variants, settings=settings, tests=tests
    )
    choices = Choices(problem)
    choice, search = choices.choice(), choices.search()
    # held-out errors without effects, and with effects that are chosen again without each fold
    errors = choices.errors_with(()), choices.errors(choices.nested_choice)
    unconfirmed = [k for k in choice.failed if k.lasting]
    trial = search.trial(choice.effects, unconfirmed[0]) if unconfirmed else None
    effects = fitted_effects(search, choice.effects)
    doubtful = fitted_effects(search, (*choice.effects, trial.effect)) if trial else effects
    # the memory of the fits is freed
    problem.evidence.release()
    # the doubtful effects cannot always be estimated together
    return StaticFinding(
        choices=choices,
        reasons=reasons,
        effects=effects,
        doubtful=doubtful or effects,
        errors=errors,
    )
