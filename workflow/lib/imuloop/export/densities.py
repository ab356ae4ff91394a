"""What the formats share that take one noise density and one bias random walk a sensor."""

from imuloop.core.errors import Lacking
from imuloop.core.samples import SENSORS
from imuloop.export.exported import comment, number

# SI units of the coefficients
UNITS = {
    "accelerometer": {"N": "m/s^2/sqrt(Hz)", "B": "m/s^2", "K": "m/s^3/sqrt(Hz)"},
    "gyroscope": {"N": "rad/s/sqrt(Hz)", "B": "rad/s", "K": "rad/s^2/sqrt(Hz)"},
}
NAMES = {"N": "N, white noise", "K": "K, random walk of the bias"}


def heading(device, tool, *lines):
    """Return the comments that a file begins with: whose it is and for whom."""
    return comment(
        f"{device.label} ({device.device}) for {tool}; from imuloop's calibration.json, noise.json",
        *lines,
    )


def density_field(device, key, sensor, term, indent=""):
    """Return a line with the worst axis' continuous density, what it is in a comment."""
    density = device.worst(sensor, term)
    words = f"{NAMES[term]}, {UNITS[sensor][term]}, continuous; worst axis: {density.words}"
    return f"{indent}{key}: {number(density.value)}  {comment(words)}"


def noise_left_out(device):
    """Return comments on the noise that a density and a walk of the worst axis do not carry."""
    lines = ["Noise that is not carried: the other axes' own, Q, R, Gauss-Markov processes, lines,"]
    lines.append("the intervals of all, dependence on temperature; see noise.json. And flicker:")
    for sensor, units in UNITS.items():
        try:
            flicker = device.worst(sensor, "B")
        except Lacking:
            continue
        lines.append(f"{sensor}: B = {flicker.value:.2g} {units['B']} (axis {flicker.words})")
    lines.append("A walk of size K falls short of it at times where B rules; filters take more.")
    return comment(*lines)


def calibration_left_out(device):
    """Return comments on the calibration where a format takes calibrated samples."""
    lines = [
        "The noise is that of calibrated samples: bias, scale factor, misalignment and effects"
    ]
    lines.append("are not carried. First: python -m imuloop apply calibration.json LOG -o OUT")
    return comment(*lines, *effect_lines(device))


def effect_lines(device, carried=()):
    """Return a line for each effect of the calibration that a format does not carry."""
    lines = []
    for sensor in SENSORS:
        for line in device.effects(sensor):
            if line.split(":")[0] not in carried:
                lines.append(f"Effect not carried, {sensor}: {line}")
    return lines
