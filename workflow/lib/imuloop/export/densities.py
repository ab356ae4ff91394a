"""What the formats share that take one noise density and one bias random walk per sensor."""

from imuloop.core.samples import SENSORS
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.export.exported import comment, number
from imuloop.noise.filters import RANGE

# SI units of the coefficients
UNITS = {
    "accelerometer": {"N": "m/s^2/sqrt(Hz)", "B": "m/s^2", "K": "m/s^3/sqrt(Hz)"},
    "gyroscope": {"N": "rad/s/sqrt(Hz)", "B": "rad/s", "K": "rad/s^2/sqrt(Hz)"},
}
NAMES = {"N": "N, white noise", "K": "K, random walk of the bias"}
# keys of Kalibr's imu.yaml, which others have taken over
KALIBR = {
    "accelerometer_noise_density": ("accelerometer", "N"),
    "accelerometer_random_walk": ("accelerometer", "K"),
    "gyroscope_noise_density": ("gyroscope", "N"),
    "gyroscope_random_walk": ("gyroscope", "K"),
}


def heading(device, tool, *lines):
    """Return the comments that a file begins with: whose it is and for whom."""
    return comment(
        f"{device.label} ({device.device}) for {tool}; from imuloop's calibration.json, noise.json",
        *lines,
    )


def density_fields(device, keys, indent=""):
    """Return a line per key with the worst axis' continuous density, what it is in a comment.

    Parameters
    ----------
    device : Exported
        The device.
    keys : dict of str to (str, str)
        Key to sensor and coefficient, ``N`` or ``K``.
    indent : str
        Before each key.
    """
    lines = ""
    for key, (sensor, term) in keys.items():
        density = device.worst(sensor, term)
        words = f"{NAMES[term]}, {UNITS[sensor][term]}, continuous; worst axis: {density.words}"
        lines += f"{indent}{key}: {number(density.value)}  {comment(words)}"
    return lines


def noise_left_out(device):
    """Return comments on what N and K of the worst axis stand for, and on a filter's first bias."""
    turn_on = []
    for sensor, units in UNITS.items():
        for fitted in (e for e in device.sensor(sensor).effects if e.name == TurnOnBias.name):
            std, _ = fitted.effect.run_to_run(fitted.values)
            sizes = ", ".join(f"{each:.3g}" for each in std)
            turn_on.append(
                f"{sensor}: turn-on bias, run to run {sizes} {units['B']} (1 sigma of x, y, z; "
                f"{fitted.effect.runs} runs): start a filter's bias with this standard deviation"
            )
    return comment(
        f"From {RANGE}, N^2/tau + K^2 tau/3 is nowhere below the Allan variance of any axis,",
        "lines left out; N and K are raised for flicker, Gauss-Markov processes, Q and R.",
        "Not carried: lines, the other axes' own noise, the intervals of all, dependence on",
        "temperature; see noise.json.",
        *turn_on,
    )


def calibration_left_out(device):
    """Return comments on the calibration where a format takes calibrated samples."""
    return comment(
        "The noise is that of calibrated samples: bias, scale factor, misalignment and effects",
        "are not carried. First: python -m imuloop apply calibration.json LOG -o OUT",
        *effect_lines(device),
    )


def effect_lines(device, carried=()):
    """Return a line for each effect of the calibration that a format does not carry."""
    return [
        f"Effect not carried, {sensor}: {line}"
        for sensor in SENSORS
        for line in device.effects(sensor, carried)
    ]
