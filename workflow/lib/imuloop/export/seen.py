"""Over which inputs an effect was seen: what a format holds it to, or says of it."""

from imuloop.effects.axes import AXES
from imuloop.export.per_axis import BIAS


def common(spans):
    """Return the lowest and highest value that all these ranges have, None where there is none."""
    low, high = max(low for low, _ in spans), min(high for _, high in spans)
    return (low, high) if low <= high else None


def input_range(fitted, names):
    """Return the lowest and highest derivative by parameters that was seen, SI, None if unknown."""
    known = [fitted.seen[name] for name in names if name in fitted.seen]
    return common(known) if known else None


def temperature_range(fitted):
    """Return between which temperatures `bias_temperature` was seen, degC; None if unknown."""
    seen = input_range(fitted, [f"c1{axis}" for axis in AXES])
    return seen and tuple(fitted.effect.reference_temperature + end for end in seen)


def common_temperatures(device, *sensors):
    """Return between which temperatures the biases of sensors were all seen to follow them.

    Parameters
    ----------
    device : Exported
        The device.
    *sensors : {'accelerometer', 'gyroscope'}
        Those without `bias_temperature` do not count.

    Returns
    -------
    tuple of two floats, or None
        degC; of an effect without a range that of the logs. None where no sensor has the effect,
        a range is not known, or they have none in common.
    """
    found = [e for name in sensors for e in device.sensor(name).effects if e.name == BIAS]
    spans = [temperature_range(fitted) or device.temperature_range for fitted in found]
    return common(spans) if spans and None not in spans else None


def seen_lines(sensor, name, held):
    """Return a line on the range in which an effect of a sensor was seen; none where it has none.

    Parameters
    ----------
    sensor : SensorCalibration
        Of an accelerometer or gyroscope.
    name : {'bias_temperature', 'g_sensitivity'}
        The effect.
    held : str
        What the format does about the range.
    """
    lines = []
    for fitted in (e for e in sensor.effects if e.name == name):
        if name == BIAS:
            span = temperature_range(fitted)
            words = span and "from {:g} to {:g} degC".format(*span)
        else:
            forces = [input_range(fitted, [f"G{i}{j}" for i in range(3)]) for j in range(3)]
            each = zip(AXES, forces, strict=True)
            known = [f"f_{axis} from {f[0]:g} to {f[1]:g}" for axis, f in each if f]
            words = known and f"with {', '.join(known)} m/s^2"
        if words:
            lines.append(f"{name} was seen {words}; {held}")
    return lines
