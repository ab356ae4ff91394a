"""Diagnosis of static records: effects in means at rest, and the noise without these effects.

A static record has the means over n windows of a long rest; the N rows are the means of all records
of one sensor.
"""

from dataclasses import asdict, dataclass, field

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.core.noise_model import NoiseModel, without_weight
from imuloop.core.samples import SENSORS
from imuloop.diagnose.content import candidates, residuals_content, search_content, untried
from imuloop.diagnose.static_means import LONG_REST
from imuloop.diagnose.static_problem import (
    StaticProblem,
    cut_at_tilts,
    fitted_effects,
    information,
)
from imuloop.estimate.choice import Choices
from imuloop.estimate.held_out import held_out_covariance
from imuloop.estimate.least_squares import why_no_fit
from imuloop.estimate.noise_components import FARTHEST
from imuloop.estimate.verdict import (
    LEFT,
    MARGIN,
    ResidualGroup,
    compare_with_noise,
    not_testable,
)
from imuloop.model.effect import OUTPUT, Channels, Effect
from imuloop.model.effects import SensorEffect
from imuloop.noise.allan import session_curves
from imuloop.noise.noise import estimate_noise

# number of windows that is enough to tell noise from spectral lines
ENOUGH = 64
# reasons why a static record cannot show effects that poses can show
NOT_SHOWN = {
    "bias_drift": "in a static record it is called ramp",
    "turn_on_bias": "every static record has a level of its own: see its scatter over power cycles",
}
ONE_ATTITUDE = "in one attitude, without a turn, it cannot be told from the bias"


@dataclass(frozen=True)
class StaticFinding:
    """The result of the search for effects in the static records of one sensor.

    A static record has the means over windows of a long rest; all records together have N means.
    """

    choices: Choices  # the searches and the choice of effects
    reasons: dict  # status and reason of effects that cannot be tried
    effects: tuple  # FittedEffects that were added
    # `effects`, and then the best effect that passes the test, but fails cross-validation
    doubtful: tuple
    # held-out errors of a model without and with effects, (N, 3) each; the effects that predict a
    # fold are chosen by the rows outside it
    errors: tuple


@dataclass(frozen=True)
class StaticResult:
    """The diagnosis of the static records of a device, which are long rests."""

    content: dict  # content of diagnosis.json, by sensor
    effects: dict  # FittedEffects that a calibration can have, by sensor
    # noise estimated after subtracting the effects, doubtful ones too
    noise: NoiseModel
    # Allan table after subtracting the effects, by session; empty without effects
    allan: dict = field(default_factory=dict)
    # StaticFinding of each sensor that could be tested
    findings: dict = field(default_factory=dict)

    @property
    def sensor_effects(self):
        """Effects that a calibration can have, of both sensors, a list of SensorEffect.

        Effects that a device shows in one record only, such as a step, are left out.
        """
        return [SensorEffect(f.effect, s) for s, fitted in self.effects.items() for f in fitted]

    def information(self, effects):
        """Return the knowledge of static records about q parameters θ of effects, A and b.

        It is a part of the prior in the fit of the poses.

        Parameters
        ----------
        effects : sequence of SensorEffect
            Effects of both sensors, with q parameters together.

        Returns
        -------
        ndarray, shape (q, q), and ndarray, shape (q,)
            Fisher information A and moment b, SI: the logarithm of the likelihood of θ is
            ``-θᵀ A θ/2 + bᵀ θ``. The entries of a parameter are zero unless these records showed
            its effect or the effect depends on the temperature.
        """
        ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
        A, b = np.zeros((ends[-1],) * 2), np.zeros(ends[-1])
        of_temperature = [e for e in effects if "temperature" in e.needs and not e.timed]
        informative = {*self.sensor_effects, *of_temperature}
        for sensor, finding in self.findings.items():
            numbers = [k for k, e in enumerate(effects) if e.sensor == sensor and e in informative]
            if numbers:
                index = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in numbers])
                variants = tuple(effects[k].effect for k in numbers)
                base = tuple(e.effect for e in finding.effects)
                A[np.ix_(index, index)], b[index] = information(finding.choices, base, variants)
        return A, b


def static_tests(records, settings):
    """Return the number of significance tests of the static records of both sensors, an int.

    It is a part of the number by which the significance level of each test is divided. There is one
    test for each kind of effect and sensor. `records` has a list of StaticRecords for each
    sensor: means over windows of long rests. `settings` are the DiagnoseSettings.
    """
    used = {sensor: usable_records(records[sensor], settings) for sensor in SENSORS}
    return sum(len(static_candidates(sensor, r)[0]) for sensor, r in used.items() if r)


def usable_records(records, settings):
    """Return those of the `records` that have at least two windows per fold, a list.

    They are StaticRecords, the means over windows of long rests. `settings.blocks` is the number of
    folds, which cross-validation holds out one at a time.
    """
    return [r for r in records if len(r.windows) >= 2 * settings.blocks]


def static_candidates(sensor, records):
    """Return the variants to try on a sensor in static records, and the effects that are not tried.

    Return two dicts, keyed by type of effect. The first holds a tuple of variants, which are the
    effect with values of its constants. The second holds the status of an effect that is not tried,
    and the reason. `sensor` is the name of the sensor, and `records` are its StaticRecords, the
    means over windows of long rests.
    """
    columns = []
    for name in ("t", "output", "other", "temperature"):
        parts = [getattr(record.channels, name) for record in records]
        columns.append(None if any(p is None for p in parts) else np.concatenate(parts))
    variants, reasons = candidates(sensor, "static_record", Channels(*columns))
    # variants with a price assume that the thermometer lags. They are left out: hours at rest show
    # the lag itself
    return {cls: tuple(s for s in tried if not s.price) for cls, tried in variants.items()}, reasons


def diagnose_static(data, records, calibration, noise, settings, noise_settings, tests):
    """Return the effects that static records show, for both sensors, and the noise without them.

    A static record has the means over windows of a long rest.

    Parameters
    ----------
    data : StaticData
        Samples at rest.
    records : dict of str to list of StaticRecord
        Means of these samples over windows, by sensor.
    calibration : Calibration
        The base model. Effects are errors of the output ``K (raw - b)`` by this calibration.
    noise : NoiseModel
        Noise of the device, which is estimated again after effects are subtracted.
    settings : DiagnoseSettings
        Number of folds, significance and power of the tests.
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
            # a disturbance that tilts the device changes the specific force, which is not an effect
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
        sessions = data.subtract(effects, calibration)
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
        sessions = data.subtract(doubtful, calibration)
        corrected = estimate_noise(noise.device, sessions, noise_settings, views=False).model
    lasting = {s: tuple(e for e in effects.get(s, ()) if e.effect.lasting) for s in SENSORS}
    return StaticResult(
        content=content, effects=lasting, noise=corrected, allan=allan, findings=findings
    )


def why_untestable(records, axes, settings):
    """Return the reason, text, why the records of a sensor cannot be diagnosed, or None.

    Possible reasons are: there is no record, the noise of an axis is not known, an axis never
    changes, or an axis has spectral lines without noise beside them. The result is None if the
    records can be diagnosed. `records` are the StaticRecords, the means over windows of long rests.
    `axes` has for each axis the AxisNoise, which are the coefficients of its noise.
    `settings.blocks` is the number of folds, which the first reason mentions.
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
    # enough windows are taken from the record, since all of them could take long
    covariances = np.stack([a.mean_covariance(records[0].windows[:ENOUGH]) for a in axes])
    if without_weight(covariances)[1].any():
        return "an axis shows lines and no noise beside them: its noise is not known"
    return None


def search_records(sensor, records, settings, tests):
    """Return the StaticFinding of a `sensor`: the effects that its StaticRecords show.

    Each of the `records` has the means over windows of a long rest. Cross-validation holds out one
    fold at a time: a stretch of time in every record. `settings` are the DiagnoseSettings, and
    `tests` is the number of tests that share the significance.
    """
    variants_by_kind, reasons = static_candidates(sensor, records)
    # steps have no variants: a scan finds their times
    variants = {cls: variants for cls, variants in variants_by_kind.items() if variants}
    problem = StaticProblem(
        records=tuple(records), variants=variants, settings=settings, tests=tests
    )
    choices = Choices(problem)
    choice = choices.choice()
    # held-out errors without effects, and with effects that are chosen again without each fold
    errors = choices.errors_with(()), choices.errors(choices.nested_choice)
    # `lasting`: a device that has the effect in one record has it in the next
    unconfirmed = [k for k in choice.failed if k.lasting]
    trial = choices.trial(choice.effects, unconfirmed[0]) if unconfirmed else None
    effects = fitted_effects(choices, choice.effects)
    doubtful = fitted_effects(choices, (*choice.effects, trial.effect)) if trial else effects
    # the memory of the fits is freed
    problem.evidence.release()
    # `doubtful` is None if these effects cannot be estimated together
    return StaticFinding(
        choices=choices,
        reasons=reasons,
        effects=effects,
        doubtful=doubtful or effects,
        errors=errors,
    )


def static_content(sensor, finding, noise, noise_change):
    """Return the fields of diagnosis.json about the static records of a sensor, a dict.

    Parameters
    ----------
    sensor : str
        Name of the sensor.
    finding : StaticFinding
        Result of the search.
    noise : NoiseModel
        Noise after the effects were subtracted. It gives the floor: the held-out error that the
        noise alone gives.
    noise_change : dict
        Coefficients of the noise before and after this subtraction, by axis; empty without effects.
    """
    axes, problem, effects = SENSORS[sensor], finding.choices.problem, finding.effects
    content = search_content(finding.choices, effects, finding.reasons, sensor)
    for entry, trial in zip(content["effects"], finding.choices.choice().added, strict=True):
        # a change of the errors of one axis only: the effect was judged on this axis
        entry["axis"] = axes[trial.axis] if trial.change.before.shape[1] == 1 else None
    names = {candidate["name"] for candidate in content["candidates"]}
    content["candidates"] += [
        untried(name, "not_observable", NOT_SHOWN.get(name, ONE_ATTITUDE))
        for name, cls in Effect.library.items()
        if sensor in cls.sensors and name not in names
    ]
    # alternatives of the noise: as estimated, and with the largest flicker and random walk
    sizes = {(axis, term): noise.value_and_std(axis, term) for axis in axes for term in "BK"}
    largest = noise.with_sizes({key: size + FARTHEST * std for key, (size, std) in sizes.items()})
    # by record, axis and alternative
    covariances = [
        [[model.axes[a].mean_covariance(r.windows) for model in (noise, largest)] for a in axes]
        for r in problem.records
    ]
    errors, floor = finding.errors, _floor(problem, covariances)
    # by record and axis, both covariances of the means, and those of their held-out errors
    by_noise = [
        [(c, [held_out_covariance(x, g.nuisance, g.row_folds) for x in c]) for c in by_axis]
        for g, by_axis in zip(problem.evidence.row_groups, covariances, strict=True)
    ]
    comparisons = []
    # without and with effects
    for added, heldout in zip(((), effects), errors, strict=True):
        groups = _residual_groups(problem, added, heldout, by_noise)
        # number of parameters of the effects, on all axes
        variants = [fitted.effect for fitted in added]
        fitted = sum(len(problem.evidence.columns_of(variants, axis)) for axis in range(3))
        # both alternatives of the noise are equally probable
        comparisons.append(compare_with_noise(groups, log_prior=(0.0, 0.0), fitted=fitted)[1])
    content |= residuals_content(problem, ("bias",), comparisons, errors, floor, bool(effects))
    residual = content["residuals"]["bias"]
    residual["unit"] = OUTPUT[sensor]
    # the noise was estimated from these residuals, so it may include a missing effect
    too_large = residual["after"] > MARGIN * residual["floor"]
    content["slow_noise"] = bool(too_large and content["verdict"] not in LEFT)
    residual["sessions"] = _errors_by_session(axes, problem, errors, floor)
    return content | {"noise": noise_change, "points": _points(problem, effects, errors, floor)}


def _floor(problem, covariances):
    """Return the floor: the variance of the held-out errors by the noise alone, (N, 3).

    `problem` is the StaticProblem, with N means over windows on three axes. A held-out error is the
    mean over a window minus the level of its record. The level is the mean of the training rows,
    weighted with the length of each window. `covariances` has a pair for each record and axis: two
    covariances that the noise of the n means may have, (n, n) each. The floor comes from the first
    one, the noise as estimated. The second one is not used.
    """
    floors = []
    groups = zip(problem.records, problem.evidence.row_groups, covariances, strict=True)
    for record, rows, by_axis in groups:
        weights = np.diag(record.length)
        of_errors = [
            held_out_covariance(estimated, rows.nuisance, rows.row_folds, weights)
            for estimated, _ in by_axis
        ]
        floors.append(np.column_stack([np.diag(covariance) for covariance in of_errors]))
    return np.concatenate(floors)


def _residual_groups(problem, effects, errors, by_noise):
    """Return the residuals that remain after some effects, a list for the comparison with noise.

    The list has a ResidualGroup for each record and each of its axes. `problem` is the
    StaticProblem, with N means over windows on three axes. `effects` are FittedEffects. `errors`,
    (N, 3), are the held-out errors with these effects. `by_noise` has two lists for each record and
    each axis. The first has two covariances that the noise of the n means of the record may have,
    (n, n) each. The second has the two covariances of the held-out errors that follow from them.
    """
    split, groups = problem.evidence.split, problem.evidence.row_groups
    by_record = zip(groups, split(problem.subtract(effects)), split(errors), strict=True)
    return [
        ResidualGroup(
            values=values[:, axis],
            errors=errors_of_record[:, [axis]],
            jacobian=rows.nuisance,
            covariances=covariances,
            error_covariances=error_covariances,
            kinds=[np.ones(len(values), dtype=bool)],
        )
        for (rows, values, errors_of_record), by_axis in zip(by_record, by_noise, strict=True)
        for axis, (covariances, error_covariances) in enumerate(by_axis)
    ]


def _errors_by_session(axes, problem, errors, floor):
    """Return the root mean square held-out errors of each session, and their floor, SI.

    The result is a dict by session, then by axis, then by ``before`` (without effects), ``after``
    (with effects) and ``floor``. `problem` is the StaticProblem, and `axes` are the names of its
    axes. The floor is the error that the noise alone gives. `errors` has the held-out errors of the
    N means without and with effects, and `floor` their variance by the noise alone, (N, 3) each.
    """
    squares = {"before": errors[0] ** 2, "after": errors[1] ** 2, "floor": floor}
    # session of each of the N means
    names = np.concatenate([np.repeat(r.session, len(r.windows)) for r in problem.records])
    content = {}
    for session in dict.fromkeys(names):
        sizes = {key: np.sqrt(x[names == session].mean(axis=0)) for key, x in squares.items()}
        content[str(session)] = {
            axis: {key: float(size[k]) for key, size in sizes.items()}
            for k, axis in enumerate(axes)
        }
    return content


def _points(problem, effects, errors, floor):
    """Return the points of a plot of the held-out errors over time, a list with a dict per window.

    The dict of a window has its ``session``, ``index`` and start, s. It has three norms over the
    axes: of the held-out error without effects (``before``), with effects (``after``), and by the
    noise alone (``floor``). It has the ``values`` of the three axes and, if there are effects, the
    ``corrected`` values, from which the effects are subtracted. All are SI. `problem` is the
    StaticProblem. `effects` are the added FittedEffects. `errors` has the held-out errors of the N
    means without and with effects, and `floor` their variance by the noise alone, (N, 3) each.
    """
    split, points = problem.evidence.split, []
    norms = [np.linalg.norm(e, axis=1) for e in (*errors, np.sqrt(floor))]
    by_record = zip(*map(split, (problem.values, problem.subtract(effects), *norms)), strict=True)
    for record, (values, corrected, before, after, noise) in zip(
        problem.records, by_record, strict=True
    ):
        columns = {"start_s": record.windows[:, 0], "before": before, "after": after}
        columns |= {"values": values - values.mean(axis=0), "floor": noise}
        columns |= {"corrected": corrected - corrected.mean(axis=0)} if effects else {}
        for k, row in enumerate(zip(*(x.tolist() for x in columns.values()), strict=True)):
            point = {"residual": "bias", "index": k, "session": record.session}
            points.append(point | dict(zip(columns, row, strict=True)))
    return points
