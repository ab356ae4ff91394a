"""A C header with the numbers and a function that applies them."""

import re
from functools import partial
from string import Template

import numpy as np

from imuloop.core.errors import one_line
from imuloop.core.samples import SENSORS
from imuloop.effects.axes import AXES
from imuloop.effects.discovered import Discovered
from imuloop.export.exported import MODEL, UNITS, ExportFormat, number, numbers
from imuloop.export.per_axis import BIAS, range_lines

# of what is held to no range
LARGEST = np.finfo(float).max
HELD, ARM = "imu_calibration_held", "imu_calibration_arm"
HOLDING = f"""
#ifndef {HELD.upper()}
#define {HELD.upper()}
/* x, held between low and high; what is zero acts on another axis */
static inline double {HELD}(double x, double low, double high)
{{
    return x == 0.0 ? 0.0 : x < low ? low : x > high ? high : x;
}}
/* what an arm of 1 m along axis j adds to specific force along axis i */
static inline double {ARM}(const double *w, const double *dw, int i, int j)
{{
    if (i == j)
        return w[i] * w[i] - (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    return w[i] * w[j] + ((j - i + 3) % 3 == 2 ? dw[3 - i - j] : -dw[3 - i - j]);
}}
#endif
"""
FUNCTION = Template("""\
static inline void ${name}(${arguments})
{
    double o[3], y[3];
    int i;
    (void)temperature;
${unread}    for (i = 0; i < 3; ++i) {
        const double output = ${name}_K[i] * (raw[i] - ${name}_b[i]);
        o[i] = output;
        y[i] = output${effects};
    }
    (void)o;
${formula}    for (i = 0; i < 3; ++i)
        x[i] = ${name}_T[i][0] * y[0] + ${name}_T[i][1] * y[1] + ${name}_T[i][2] * y[2];
}
""")


def text(device):
    """Return the header."""
    device.need_calibration()
    prefix = re.sub(r"\W", "_", device.device, flags=re.ASCII)
    guard = f"IMU_CALIBRATION_{prefix.upper()}_H"
    body = remark(
        f"{device.label} ({device.device}): calibration, {MODEL}, by imuloop.",
        "raw: as logged, in the unit that the function names; x: calibrated, m/s^2 and rad/s.",
        "Numbers read back as the same double. The noise is not carried: see noise.json.",
    )
    if device.temperature_range:
        cold, warm = device.temperature_range
        body += remark(f"Temperatures of the logs: {cold:g} to {warm:g} degC.")
    body += f"#ifndef {guard}\n#define {guard}\n"
    if device.calibration.effects:
        body += HOLDING
    for sensor in SENSORS:
        body += "\n" + sensor_text(device, sensor, f"{prefix}_{sensor}")
    return body + "\n#endif\n"


def sensor_text(device, sensor_name, name):
    """Return numbers and function of one sensor, all called `name`."""
    sensor, si = device.sensor(sensor_name), UNITS[sensor_name]["B"]
    unit, gyroscope = sensor.raw_unit.name, sensor_name == "gyroscope"
    formulas = [e for e in sensor.effects if e.name == Discovered.name and portable(e.effect)]
    carried = (*EFFECTS, *(e.name for e in formulas))
    body = remark(*device.left_out(sensor_name, carried, aligned=True))
    body += remark(f"b: bias, {unit}, subtracted from raw") + array(f"{name}_b", sensor.b)
    body += remark(f"K: scale factor, {si} per {unit}, multiplies") + array(f"{name}_K", sensor.K)
    body += remark("T: misalignment, row by row, multiplies last") + array(f"{name}_T", sensor.T)
    for effect in (BIAS, "g_sensitivity"):
        body += remark(*range_lines(device, sensor_name, effect, "held to that"))
    terms = ""
    for index, fitted in enumerate(e for e in sensor.effects if e.name in EFFECTS):
        arrays, term = EFFECTS[fitted.name](fitted, f"{name}_e{index}")
        body += remark(f"e: {fitted.name}, {fitted.effect.equation}, SI, subtracted") + arrays
        terms += f" - {term}"
    for fitted in formulas:
        body += remark(f"e: {fitted.name}, {fitted.effect.formula}, SI, subtracted")
    turning = any(e.name in ("lever_arm", "rate_sensitivity") for e in sensor.effects)
    more = ["f"] * gyroscope + ["w", "dw"] * turning
    given = ["const double raw[3]", "double temperature", *(f"const double {v}[3]" for v in more)]
    body += remark(
        f"raw in {unit}, temperature in degC; x in {si}",
        *["f: calibrated force, m/s^2"] * gyroscope,
        *["w: the gyroscope's T K (raw - b), rad/s; dw: its change, rad/s^2"] * turning,
    )
    return body + FUNCTION.substitute(
        name=name,
        arguments=", ".join([*given, "double x[3]"]),
        unread="".join(f"    (void){v};\n" for v in more),
        effects=terms,
        formula="".join(map(discovered, formulas)),
    )


def remark(*lines):
    """Return lines as C comments; no text in them ends one early or opens another."""
    safe = (re.sub(r"\*(?=/)|/(?=\*)", r"\g<0> ", one_line(line)) for line in lines)
    return "".join(f"/* {line} */\n" for line in safe)


def array(name, values):
    """Return an array of three numbers or of three rows."""
    rows = [f"{{{numbers(row)}}}" for row in np.atleast_2d(values)]
    if np.ndim(values) == 1:
        return f"static const double {name}[3] = {rows[0]};\n"
    return f"static const double {name}[3][3] = {{{', '.join(rows)}}};\n"


def ends(fitted, name, keys):
    """Return arrays of the ends to which derivatives by parameters are held."""
    low, high = np.transpose([fitted.ranges.get(key, (-LARGEST, LARGEST)) for key in keys.flat])
    return "".join(
        array(f"{name}_{end}", values.reshape(keys.shape))
        for end, values in (("low", low), ("high", high))
    )


def per_axis(fitted, name, kind, derivative):
    """Return arrays of the parameters of a kind and the ends of the derivative, and it held."""
    keys = np.array([f"{kind}{axis}" for axis in "xyz"])
    arrays = array(f"{name}_{kind}", [fitted.values[key] for key in keys])
    arrays += ends(fitted, f"{name}_{kind}", keys)
    return arrays, f"{HELD}({derivative}, {name}_{kind}_low[i], {name}_{kind}_high[i])"


def warmer(fitted):
    """Return the expression of the temperature less the effect's reference."""
    return f"(temperature - {number(fitted.effect.reference_temperature)})"


def bias_temperature(fitted, name):
    """Return the arrays and the expression of ``Σ_k c_ki (θ - θ0)^k``."""
    arrays, warmth = per_axis(fitted, name, "c1", warmer(fitted))
    terms = [f"{name}_c1[i] * {warmth}"]
    for k in range(2, fitted.effect.order + 1):
        arrays += array(f"{name}_c{k}", [fitted.values[f"c{k}{axis}"] for axis in "xyz"])
        terms.append(f"{name}_c{k}[i] * {' * '.join([warmth] * k)}")
    return arrays, f"({' + '.join(terms)})"


def scale_temperature(fitted, name):
    """Return the arrays and the expression of ``sT_i (θ - θ0) y_i``."""
    arrays, product = per_axis(fitted, name, "sT", f"{warmer(fitted)} * output")
    return arrays, f"{name}_sT[i] * {product}"


def portable(effect):
    """Return whether a formula needs what the function of its sensor is given, and no past."""
    return not effect.timed and effect.letters <= set("fT" if effect.sensor[0] == "a" else "fwT")


def discovered(fitted):
    """Return the statements that subtract the terms of a formula of outputs and temperature."""

    def factor(name, power, absolute):
        if name == "T":
            text = warmer(fitted)
        else:
            own = (name[0] == "f") == (fitted.effect.sensor == "accelerometer")
            text = f"{'o' if own else 'f'}[{AXES.index(name[1])}]"
        text = f"({text} < 0 ? -{text} : {text})" if absolute else text
        return " * ".join([text] * power)

    lines = []
    each = zip(fitted.effect.terms, fitted.effect.parameters, strict=True)
    for (axis, factors), name in each:
        product = " * ".join(factor(*own) for own in factors)
        low, high = map(number, fitted.ranges.get(name, (-LARGEST, LARGEST)))
        value = number(fitted.values[name])
        lines.append(f"    y[{axis}] -= {value} * {HELD}({product}, {low}, {high});\n")
    return "".join(lines)


def matrix(fitted, name, kind, derivative):
    """Return matrices, rows that an effect lacks zero, and the sum of their products, j = 0 … 2."""
    lacking = 9 - len(fitted.effect.parameters)
    keys = np.reshape([*fitted.effect.parameters, *[""] * lacking], (3, 3))
    values = np.append(fitted.vector, np.zeros(lacking)).reshape(3, 3)
    arrays = array(f"{name}_{kind}", values) + ends(fitted, name, keys)
    terms = (
        f"{name}_{kind}[i][{j}] * "
        f"{HELD}({derivative.format(j)}, {name}_low[i][{j}], {name}_high[i][{j}])"
        for j in range(3)
    )
    return arrays, f"({' + '.join(terms)})"


# effects that the functions apply; of matrices the name and what element j of a row multiplies
MATRICES = {
    "g_sensitivity": ("G", "f[{}]"),
    "rate_sensitivity": ("M", "w[{}]"),
    "lever_arm": ("r", f"{ARM}(w, dw, i, {{}})"),
}
EFFECTS = {each.__name__: each for each in (bias_temperature, scale_temperature)}
EFFECTS |= {name: partial(matrix, kind=k, derivative=of) for name, (k, of) in MATRICES.items()}
C_HEADER = ExportFormat(
    "imu_calibration.h", "C99 header, plain numbers and functions that apply them", text
)
