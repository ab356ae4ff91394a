"""Static records: means at rest against their noise, the effects in them, the noise without."""

from dataclasses import asdict, dataclass, field

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.calibrate.least_squares import SINGULAR
from imuloop.core.noise_model import NoiseModel, without_weight
from imuloop.diagnose.static_correction import noise_again, with_found_noise
from imuloop.diagnose.static_find import find, static_candidates
from imuloop.diagnose.static_means import COLUMNS
from imuloop.diagnose.static_moves import separated
from imuloop.diagnose.static_noise import mean_covariance
from imuloop.diagnose.static_report import static_content
from imuloop.diagnose.static_search import SCANS
from imuloop.diagnose.verdict import NOTHING
from imuloop.effects.ramp import Ramp

# effects of a record, which the next record has not
PASSING = (Ramp, *SCANS)
# windows that tell noise from lines
ENOUGH = 64


@dataclass(frozen=True)
class StaticResult:
    """The diagnosis of the static records of a device.

    Attributes
    ----------
    content : dict of str to dict
        The contract's fields of each sensor.
    effects : dict of str to tuple of FittedEffect
        Effects of each sensor that belong into a calibration.
    noise : NoiseModel
        Noise without the effects, with the lines and processes that were found.
    allan : dict of str to dict of ndarray
        Allan table of each session without the effects; empty where nothing was taken out.
    """

    content: dict
    effects: dict
    noise: NoiseModel
    allan: dict = field(default_factory=dict)


def static_tests(data, calibration, settings):
    """Return how many tests the static records of both sensors add to a family."""
    total = 0
    for sensor in COLUMNS:
        records = usable(data, sensor, calibration, settings)
        if records:
            available, _ = static_candidates(sensor, records)
            total += len(available)
    return total


def usable(data, sensor, calibration, settings):
    """Return the records of a sensor that have means enough for blocks."""
    least = 2 * settings.blocks
    records = data.records(sensor, calibration, settings.mean_time)
    return [r for r in records if len(r.windows) >= least]


def diagnose_static(data, calibration, noise, settings, noise_settings, tests=None):
    """Diagnose both sensors in the static records of a device.

    Parameters
    ----------
    data : StaticData
        The records.
    calibration : Calibration
        Base calibration: effects add to its ``K (raw - b)``.
    noise : NoiseModel
        Noise of the device.
    settings : DiagnoseSettings
        Settings.
    noise_settings : NoiseSettings
        Settings of the noise stage, by which the noise is estimated again.
    tests : int, optional
        Number of tests that share the significance; those of the static records by default.

    Returns
    -------
    StaticResult
        Of both sensors.
    """
    tests = tests or static_tests(data, calibration, settings)
    findings, content, shared = {}, {}, None
    for sensor, axes in COLUMNS.items():
        records = whole = usable(data, sensor, calibration, settings)
        if sensor == "accelerometer" and records:
            records = separated(records, 2 * settings.blocks)
        reason = untestable(records, [noise.axes[name] for name in axes], settings)
        if reason:
            content[sensor] = {"verdict": "not_testable", "why": reason, **NOTHING}
            continue
        fine = data.records(sensor, calibration, 0.0)
        try:
            findings[sensor] = find(sensor, records, fine, settings, tests, shared)
        except LinAlgError:
            content[sensor] = {"verdict": "not_testable", "why": SINGULAR, **NOTHING}
            continue
        # both sensors have the same windows, unless the accelerometer was moved: a part of a record
        # that is too short is left out, so as many records may be left
        alike = len(records) == len(whole) and all(
            np.array_equal(own.windows, all_.windows)
            for own, all_ in zip(records, whole, strict=True)
        )
        shared = findings[sensor].model.noise if alike else None
    found = {sensor: finding.effects for sensor, finding in findings.items()}
    allan, floor = {}, noise
    if any(found.values()):
        floor, allan = noise_again(noise.device, data, calibration, found, noise_settings)
    whole = with_found_noise(floor, findings)
    lines_out = with_found_noise(floor, findings, lines=False)
    for sensor, finding in findings.items():
        changed = finding.added
        change = {
            name: {"before": asdict(noise.axes[name]), "after": asdict(whole.axes[name])}
            for name in (COLUMNS[sensor] if changed else ())
        }
        content[sensor] = static_content(sensor, finding, lines_out, change, settings)
    effects = {
        sensor: tuple(e for e in fitted if not isinstance(e.effect, PASSING))
        for sensor, fitted in found.items()
    }
    return StaticResult(
        {sensor: content[sensor] for sensor in COLUMNS},
        {sensor: effects.get(sensor, ()) for sensor in COLUMNS},
        whole,
        allan,
    )


def untestable(records, axes, settings):
    """Return why the records of a sensor cannot be diagnosed, or None."""
    if not records:
        return (
            f"no rest that gives {2 * settings.blocks} means: record at least a minute at rest, "
            "better two hours"
        )
    if not all(a.N.square or a.Q.square or a.B.square or a.K.square for a in axes):
        return "the noise of an axis is not known"
    if not all(np.ptp(r.values, axis=0).all() for r in records):
        return "an axis never changes"
    # some windows show it, and many take long
    covariances = np.stack([mean_covariance(a, records[0].windows[:ENOUGH]) for a in axes])
    if without_weight(covariances)[1].any():
        return "an axis shows lines and no noise beside them: its noise is not known"
    return None
