"""What an export is made of: a device's calibration and noise, its numbers and words as text."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import NamedTuple

import numpy as np

from imuloop.core.errors import Lacking, one_line
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.core.units import DEGREE
from imuloop.effects.axes import AXES
from imuloop.noise.filters import RANGE, bounding

# what follows K (raw - b) by the contract; every file says it
MODEL = "x = T (K (raw - b) - e)"
# SI units of the noise coefficients
UNITS = {
    "accelerometer": {"N": "m/s^2/sqrt(Hz)", "B": "m/s^2", "K": "m/s^3/sqrt(Hz)"},
    "gyroscope": {"N": "rad/s/sqrt(Hz)", "B": "rad/s", "K": "rad/s^2/sqrt(Hz)"},
}


class ExportFormat(NamedTuple):
    """A file for another tool: its name, the tool, and what returns its text of an `Exported`.

    The text's function raises Lacking where the device does not have what the file holds.
    """

    file: str
    title: str
    text: Callable


@dataclass(frozen=True)
class Density:
    """A noise coefficient as a filter takes it: always a number, SI, with its axis or channel.

    The estimate, or the one-sided 95 % upper `limit` of a term that was not seen; `raised_from`
    that, where the value is larger so that N and K bound the Allan curve.
    """

    value: float
    axis: str
    limit: bool
    raised_from: float | None = None

    @property
    def words(self):
        """What a comment says of it."""
        words = f"{self.axis}, not seen: its 95 % upper limit" if self.limit else self.axis
        if self.raised_from is None:
            return words
        bound = f"so that N and K bound its Allan curve from {RANGE}"
        return f"{words}; raised from {self.raised_from:.3g} {bound}"

    def times(self, factor):
        """Return the density in another unit."""
        raised_from = None if self.raised_from is None else self.raised_from * factor
        return replace(self, value=self.value * factor, raised_from=raised_from)


def estimated(noise, axis, term):
    """Return coefficient `term` (Q, N, B, K or R) of an AxisNoise; Lacking without an estimate."""
    coefficient = getattr(noise, term)
    if coefficient.size is None:
        raise Lacking(f"no noise: {term} of {axis} is neither known nor limited")
    return Density(float(coefficient.size), axis, coefficient.value is None)


def for_filter(noise, axis, term):
    """Return N or K of an AxisNoise, raised so that both bound its Allan curve."""
    own = {each: estimated(noise, axis, each) for each in "NK"}[term]
    value = dict(zip("NK", bounding(noise), strict=True))[term]
    return own if value == own.value else replace(own, value=value, raised_from=own.value)


def of_calibrated(sensor, densities):
    """Return densities of calibrated samples, of a SensorCalibration and those as logged.

    Of axes that are independent, ``N_i^2 = Σ_j M_ij^2 N_j^2`` with M = T K over the nominal scale;
    what bounds the Allan curves as logged then bounds those of calibrated samples.
    """
    at = [AXES.index(density.axis[-1]) for density in densities]
    M = (sensor.T * sensor.K / sensor.raw_unit.scale)[np.ix_(at, at)]

    def through(values):
        return np.sqrt(M**2 @ np.square(values)).tolist()

    values = through([d.value for d in densities])
    own = through([d.value if d.raised_from is None else d.raised_from for d in densities])
    return [
        replace(d, value=value, raised_from=d.raised_from and bare)
        for d, value, bare in zip(densities, values, own, strict=True)
    ]


@dataclass(frozen=True)
class Exported:
    """A device as every format takes it; what it does not have raises Lacking.

    The label is untrusted text, see `comment`. The noise is that of the samples as logged, SI, with
    notes for its readers; rate and range of temperatures, degC, are those of the logs, if known.
    """

    device: str
    label: str
    calibration: Calibration
    noise: NoiseModel
    rate_hz: float | None
    notes: tuple[str, ...] = ()
    temperature_range: tuple[float, float] | None = None
    # parameters, SI, of the effects found beside a reference, by sensor and name
    beside: dict = field(default_factory=dict)

    def reference_lines(self):
        """Return lines on a reference's clock and place: signs as Kalibr has them between IMUs."""
        lines = []
        for (sensor, name), values in self.beside.items():
            if name == "time_offset":
                shift = values["dt"]
                lines.append(
                    f"{sensor} beside the reference: t_reference = t_imu + shift, shift "
                    f"{number(shift)} s: what is stamped 10 s was there at {10 + shift:.5f} s"
                )
            elif name == "lever_arm":
                place = numbers(values[f"r{k}"] for k in "xyz")
                lines.append(f"from the reference's marker to the sensor, its axes, m: {place}")
        return lines

    def sensor(self, name):
        """Return the `SensorCalibration` of ``accelerometer`` or ``gyroscope``."""
        return getattr(self.calibration, name)

    def need_calibration(self):
        """Raise Lacking, with the reasons, where nothing was measured of either sensor."""
        if not self.calibration.measured:
            raise Lacking(f"no calibration; {'; '.join(self.calibration.limits())}")

    def need_rate(self):
        """Return the rate in Hz; raise Lacking where it is not known."""
        if not self.rate_hz:
            raise Lacking("the rate of the logs is not known: no session could be used")
        return self.rate_hz

    def density(self, axis, term):
        """Return coefficient `term` (Q, N, B, K or R) of a channel as logged, as estimated."""
        return estimated(self.noise.axes[axis], axis, term)

    def calibrated(self, sensor, term):
        """Return coefficient `term` of each axis of a sensor's calibrated samples, as estimated."""
        found = [self.density(axis, term) for axis in SENSORS[sensor]]
        return of_calibrated(self.sensor(sensor), found)

    def worst(self, sensor, term, logged=False):
        """Return the largest N or K that a filter needs for an axis of a sensor.

        Of calibrated samples, or of those as `logged` where the tool calibrates itself.
        """
        found = [for_filter(self.noise.axes[axis], axis, term) for axis in SENSORS[sensor]]
        found = found if logged else of_calibrated(self.sensor(sensor), found)
        return max(found, key=lambda density: density.value)

    def effects(self, sensor, name):
        """Return the fitted effects of a sensor that have a name."""
        return [fitted for fitted in self.sensor(sensor).effects if fitted.name == name]

    def left_out(self, sensor, carried=(), aligned=False):
        """Return a line for each part of a sensor's calibration that a format does not carry.

        The misalignment too unless the format, or what comes before it, is `aligned`. Then what the
        calibration itself lacks: every format with numbers of it, or for its samples, says so.
        """
        lines = []
        angle = np.abs(self.sensor(sensor).T - np.eye(3)).max() / DEGREE
        if angle and not aligned:
            lines.append(f"misalignment T, largest element {angle:.2g} deg")
        for fitted in self.sensor(sensor).effects:
            if fitted.name in carried:
                continue
            units, largest = fitted.effect.units(sensor), {}
            for name, value in fitted.values.items():
                largest[units[name]] = max(abs(value), largest.get(units[name], 0.0))
            sizes = ", ".join(f"{value:.2g} {unit}" for unit, value in largest.items())
            words = [f"{fitted.name}: {fitted.effect.equation}", f"largest parameter {sizes}"]
            for name, value in asdict(fitted.effect).items():
                if isinstance(value, (int, float)):
                    words.append(f"{name} = {value:g}")
            lines.append("; ".join(words))
        lines = [f"Not carried of the {sensor}: {line}" for line in lines]
        return lines + self.calibration.limits(sensor)


def number(value):
    """Return the shortest text that reads back as the same float64.

    With a point in the mantissa: YAML 1.1 takes ``1e-05`` for a word.
    """
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}.0{e}{exponent}" if e and "." not in mantissa else text


def numbers(values, separator=", "):
    """Return an array's numbers row by row in one line."""
    return separator.join(map(number, np.ravel([*values])))


def comment(*lines, mark="#"):
    """Return lines as comments; each stays one line, whatever text it holds."""
    return "".join(f"{mark} {one_line(line)}".rstrip() + "\n" for line in lines)
