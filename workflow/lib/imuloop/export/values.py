"""The numbers and texts of a device by name, for the templates of all formats."""

from dataclasses import asdict, dataclass, field
from operator import attrgetter

import numpy as np

from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.core.units import DEGREE
from imuloop.effects.axes import AXES
from imuloop.export.bound import RANGE
from imuloop.export.densities import UNITS, estimated, for_filter, of_calibrated
from imuloop.model.calibration import Calibration

# the model of a calibration, which every file states
MODEL = "x = T (K (raw - b) - e)"
# effects that several formats have a place for
BIAS, G = "bias_temperature", "g_sensitivity"
VALUE = attrgetter("value")


@dataclass(frozen=True)
class Exported:
    """The results of a device from which the formats are written."""

    device: str
    label: str  # name to show; it may hold any characters
    calibration: Calibration
    noise: NoiseModel  # of the samples as logged, SI
    rate_hz: float | None  # sampling rate of the logs, if known
    notes: tuple[str, ...] = ()  # remarks on the noise
    temperature_range: tuple[float, float] | None = None  # of the logs, degC, if known
    # parameters of the effects that a reference showed, SI, by (sensor, effect)
    reference: dict = field(default_factory=dict)
    sensors: tuple[str, ...] = tuple(SENSORS)  # the sensors that the logs hold

    def sensor(self, name):
        """Return the `SensorCalibration` of the sensor `name`, such as ``accelerometer``."""
        return getattr(self.calibration, name)


def reasons(exported):
    """Return why a device lacks parts that formats may need, a dict: name of a part, and reason.

    `exported` is the Exported of the device. The parts are ``calibration`` (of at least one
    sensor); ``accelerometer`` and ``gyroscope``, the calibration of this sensor; ``rate``, the
    sampling rate; and ``N``, ``K`` and ``B``, this noise coefficient (white noise, random walk,
    flicker) of all axes. The noise of a sensor that the logs lack is not needed. The dict is empty
    if nothing is missing.
    """
    calibration, by_part = exported.calibration, {}
    if not calibration.measured:
        by_part["calibration"] = f"no calibration; {'; '.join(calibration.limits())}"
    for name in SENSORS:
        sensor = exported.sensor(name)
        if not sensor.measured:
            by_part[name] = f"no calibration ({sensor.not_testable})"
    if not exported.rate_hz:
        by_part["rate"] = "the rate of the logs is not known: no session could be used"
    for axis in [a for sensor in exported.sensors for a in SENSORS[sensor]][::-1]:
        noise = exported.noise.axes[axis]
        for term in (term for term in "NKB" if getattr(noise, term).size is None):
            by_part[term] = f"no noise: {term} of {axis} is neither known nor limited"
    return by_part


def values(exported):
    """Return the values of a device for the templates, a dict with a dict for each sensor.

    `exported` is the Exported of the device. A noise coefficient without a value or limit has no
    entry, and a sensor that the logs lack has none either. A format that uses such an entry lists
    it in its `needs`, and is then not written.
    """
    calibration = exported.calibration
    sensors = {name: sensor_values(exported, name) for name in exported.sensors}
    return sensors | {
        "sensors": [*sensors.values()],
        "device": exported.device,
        "label": exported.label,
        "model": MODEL,
        "gravity": float(calibration.gravity),
        "measured": calibration.measured,
        "limits": calibration.limits(*exported.sensors),
        "ids": calibration.log.get("sensor_ids", {}),
        "rate": exported.rate_hz and float(exported.rate_hz),
        "notes": exported.notes,
        "temperatures": exported.temperature_range,
        "common_temperatures": common([s["temperatures"] for s in sensors.values() if s[BIAS]]),
        "reference": exported.reference,
        "bounded": RANGE,
    }


def sensor_values(exported, name):
    """Return the values of one sensor of a device for the templates, a dict by key.

    `exported` is the Exported of the device, and `name` the name of the sensor. z is the raw value
    in nominal SI: raw readings with the offset and scale of the data sheet. Keys that need an
    explanation:

    - ``scale``, near 1, and ``offset``, SI, (3,) each: ``K (raw - b) = scale (z - offset)``.
    - ``temperatures``: range of the temperatures that ``bias_temperature`` was fitted to, degC, or
      the range of the logs if that is unknown.
    - ``logged`` and ``calibrated``: for each coefficient, the `Density` of each axis.
    - ``worst`` and ``worst_logged``: the largest N (white noise) and K (random walk) of the axes,
      raised so that a filter with them never assumes too little noise.
    - ``Tg``, (3, 3): Tg times the specific force on body axes is the rate that the force adds to z.
    - ``effects``, ``bias_temperature`` and ``g_sensitivity``: lists of `FittedEffect`.
    """
    sensor, axes = exported.sensor(name), SENSORS[name]
    scale, units = sensor.K / sensor.raw_unit.scale, UNITS[name]
    effects = {key: [e for e in sensor.effects if e.name == key] for key in (BIAS, G)}
    of_force = sum((e.vector.reshape(3, 3) for e in effects[G]), np.zeros((3, 3)))
    spans = [temperature_range(e) or exported.temperature_range for e in effects[BIAS]]
    content = {
        "name": name,
        "unit": units["B"],
        "units": units,
        "raw_unit": sensor.raw_unit.name,
        "method": sensor.method,
        **{key: getattr(sensor, key) for key in "TKb"},
        "scale": scale,
        "offset": sensor.raw_unit.to_si(sensor.b),
        "limits": exported.calibration.limits(name),
        "left_out": left_out(sensor, name),
        "effects": sensor.effects,
        **effects,
        "Tg": of_force / scale[:, None],
        "reference": effects[BIAS][0].effect.reference_temperature if effects[BIAS] else None,
        "temperatures": common(spans),
        "seen": {key: [s for e in effects[key] if (s := seen_words(e))] for key in (BIAS, G)},
    }
    return content | noise_values(sensor, {axis: exported.noise.axes[axis] for axis in axes})


def noise_values(sensor, noise):
    """Return the noise coefficients of logged and of calibrated samples, a dict.

    `sensor` is a SensorCalibration, and `noise` a dict with the AxisNoise of each channel. The
    result has four keys, and the value of each is a dict by the letter of a coefficient: N (white
    noise), B (flicker) or K (random walk). ``logged`` and ``calibrated`` have for each letter a
    list, the Density of each axis; a coefficient that is neither known nor limited on some axis has
    no entry. ``worst`` (calibrated) and ``worst_logged`` have for N and K the largest Density of
    the axes, raised so that a filter with both never assumes too little noise. They are empty if N
    or K has no entry.
    """
    terms = [t for t in "NKB" if all(getattr(fit, t).size is not None for fit in noise.values())]
    both = "NK" if {*"NK"} <= {*terms} else ""
    logged = {t: [estimated(fit, axis, t) for axis, fit in noise.items()] for t in terms}
    needed = {t: [for_filter(fit, axis, t) for axis, fit in noise.items()] for t in both}
    return {
        "logged": logged,
        "calibrated": {t: of_calibrated(sensor, axes) for t, axes in logged.items()},
        "worst": {t: max(of_calibrated(sensor, axes), key=VALUE) for t, axes in needed.items()},
        "worst_logged": {t: max(axes, key=VALUE) for t, axes in needed.items()},
    }


def left_out(sensor, name):
    """Return the parts of a sensor's calibration that some formats cannot hold, a list of dict.

    `sensor` is the SensorCalibration, and `name` the name of the sensor. Each part has a ``name``.
    The first part is the misalignment; its ``angle``, deg, is the largest magnitude in the matrix T
    off the diagonal. Exception: it is not listed if T is the identity. All other parts are effects.
    An effect has its ``equation``, its ``constants``, and ``largest``, a dict with the largest
    magnitude of its parameters of each unit.
    """
    angle = np.abs(sensor.T - np.eye(3)).max() / DEGREE
    parts = [{"name": "misalignment", "angle": angle}] if angle else []
    for fitted in sensor.effects:
        units, largest = fitted.effect.units(name), {}
        for key, value in fitted.values.items():
            largest[units[key]] = max(abs(value), largest.get(units[key], 0.0))
        shape = {"equation": fitted.effect.equation, "constants": asdict(fitted.effect)}
        parts.append({"name": fitted.name, "largest": largest} | shape)
    return parts


def common(spans):
    """Return the intersection of the ranges `spans`, (low, high) each; None if it is empty.

    It is also None if there are no ranges, or if a range is None.
    """
    if not spans or None in spans:
        return None
    low, high = max(low for low, _ in spans), min(high for _, high in spans)
    return (low, high) if low <= high else None


def seen_range(fitted, names, offset=0.0):
    """Return the range of the input of an effect in the data that it was fitted to, or None.

    `fitted` is a FittedEffect. It has a range for each parameter: the range of the factor by which
    the parameter is multiplied, such as the temperature less a reference. The result, (low, high),
    is the intersection of the known ranges of the parameters `names`, with `offset` added to both
    ends. It is None if no range is known, or if the intersection is empty.
    """
    span = common([fitted.ranges[name] for name in names if name in fitted.ranges])
    return span and (offset + span[0], offset + span[1])


def temperature_range(fitted):
    """Return the range of temperatures that an effect was fitted to, degC, (low, high), or None.

    `fitted` is the FittedEffect, a `bias_temperature`. The result is None if the range is not
    known.
    """
    return seen_range(fitted, [f"c1{axis}" for axis in AXES], fitted.effect.reference_temperature)


def seen_words(fitted):
    """Return the range of the data that an effect was fitted to, a text, or None if unknown.

    `fitted` is the FittedEffect, a `bias_temperature` or a `g_sensitivity`.
    """
    if fitted.name == BIAS:
        span = temperature_range(fitted)
        return span and f"{BIAS} was seen from {span[0]:g} to {span[1]:g} degC"
    ranges = []
    for j, axis in enumerate(AXES):
        if force := seen_range(fitted, [f"G{i}{j}" for i in range(3)]):
            ranges.append(f"f_{axis} from {force[0]:g} to {force[1]:g}")
    return f"{G} was seen with {', '.join(ranges)} m/s^2" if ranges else None
