"""The calibration of a device, ``x = T (K (raw - b) - e)``, which is applied to samples here.

x are calibrated values and raw values are in the unit of the log. T is the misalignment, K are the
scale factors, b the biases, and e is the sum of the effects. `imuloop.model.sensor` has the same
equation, with its derivative, for the fit. Nominal SI values are raw values less the data sheet's
offset, times its scale.
"""

from dataclasses import dataclass, field
from html import escape

import numpy as np
import pandas as pd

from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json, write_json
from imuloop.core.samples import (
    CHANNELS,
    METADATA_KEY,
    SENSORS,
    TEMPERATURE,
    TIME,
    calibrated_attrs,
    check_columns,
    refuse_calibrated,
)
from imuloop.model.apply_file import apply_file
from imuloop.model.calibration_faults import MOST_BYTES, content_fault, sensor_fault
from imuloop.model.effect import Channels
from imuloop.model.prior_remarks import remarks
from imuloop.model.sensor_calibration import SensorCalibration

# version of the JSON files
FORMAT = 1
# meaning of the verdict "unexplained" for a user of the calibration
UNEXPLAINED = (
    "its errors are larger than its noise and no known effect explains them: the model lacks "
    "something, see diagnosis.json"
)
# meaning of an effect that does not last
OF_ONE_LOG = (
    "is of the log that was calibrated and is applied by its time; for another log take the biases "
    "of that one first: imuloop check --update"
)


def _digits(value, std):
    """Return a value and its standard error as two texts, both rounded at the same place.

    This place is the second significant digit of the error `std`. If there is no error (`std` is
    zero or not-a-number), `value` has six significant digits and the text of the error is a dash.
    """
    if not std > 0:
        return f"{value:.6g}", "—"
    # number of digits of the value before the first digit of the error
    exponents = [int(np.floor(np.log10(size))) for size in (abs(value) or std, std)]
    digits = max(exponents[0] - exponents[1], 0) + 2
    return f"{value:#.{digits}g}".rstrip("."), f"{std:#.2g}".rstrip(".")


@dataclass(frozen=True)
class Calibration:
    """The calibration of a device: of its accelerometer and its gyroscope."""

    device: str  # name
    gravity: float  # local gravity that the accelerometer was calibrated to, m/s^2
    accelerometer: SensorCalibration
    gyroscope: SensorCalibration
    # declarations of the calibrated log: ``format``, ``columns``, ``units``, ``rate``,
    # ``full_scale`` as in the config, and ``sensor_ids``, if an autopilot numbers its sensors
    log: dict = field(default_factory=dict)
    # by sensor, the name of a later log that its bias comes from; empty without an update
    updated: dict = field(default_factory=dict)
    sha256: tuple[str, ...] = ()  # hash of each file of the calibrated logs, if known

    @property
    def effects(self):
        """Effects of both sensors, a tuple of FittedEffect, the accelerometer's first."""
        return (*self.accelerometer.effects, *self.gyroscope.effects)

    @property
    def measured(self):
        """Whether any parameter of either sensor was measured; otherwise all are nominal."""
        return self.accelerometer.measured or self.gyroscope.measured

    def parameters(self):
        """Return all parameters of both sensors, with their standard errors.

        Returns
        -------
        DataFrame
            A row per parameter: `sensor`, `parameter`, `value`, `std`, `unit` and `source`. `std`
            is the standard error, not-a-number for a parameter that was not fitted. `source` is
            ``data``; for a parameter that the data hardly improved, it is ``data sheet`` or the
            file of the prior.
        """
        rows = [(s, *row) for s in SENSORS for row in getattr(self, s).parameters(s)]
        columns = ["sensor", "parameter", "value", "std", "unit", "source"]
        return pd.DataFrame(rows, columns=columns)

    def __repr__(self):
        sensors = "; ".join(f"{name} {getattr(self, name)}" for name in SENSORS)
        return f"<Calibration of {self.device}: {sensors}>"

    def _repr_html_(self):
        """Return the parameters with their standard errors as a table in HTML, for notebooks."""
        table = self.parameters()
        both = zip(table["value"], table["std"], strict=True)
        texts = (_digits(value, std) for value, std in both)
        table["value"], table["std"] = zip(*texts, strict=True)
        table = table.rename(columns={"std": "standard error"})
        return f"<p>{escape(repr(self))}</p>\n{table.to_html(index=False)}"

    def limits(self, *sensors):
        """Return the limits of the calibration that a user has to know, a list of lines of text.

        The lines name sensors that are not fully calibrated, sensors with errors that neither noise
        nor a known effect explains, parameters that the data hardly improved or that are far from
        their prior, and effects, such as a step, that hold for the calibrated log only. `sensors`
        are the names of the sensors to report on, by default both. The list is empty if nothing
        limits the calibration.
        """
        lines = []
        for name in sensors or SENSORS:
            sensor = getattr(self, name)
            if sensor.not_testable:
                lines.append(f"{name}: {sensor.method} ({sensor.not_testable})")
            if sensor.unexplained:
                lines.append(f"{name}: unexplained ({UNEXPLAINED})")
            lines += [f"{name}: {remark}" for remark in remarks(name, sensor)]
            short_lived = [e.name for e in sensor.effects if not e.effect.lasting]
            lines += [f"{name}: {effect} {OF_ONE_LOG}" for effect in short_lived]
        return lines

    def refuse_nominal(self, where=None):
        """Raise an ImuloopError if no parameter of the calibration was measured.

        The message names `where`, a path or another text, by default the device, and says how to
        apply a nominal calibration anyway.
        """
        if not self.measured:
            raise ImuloopError(
                f"{where or self.device}: the calibration is nominal, nothing was measured: "
                f"{'; '.join(self.limits())}; to apply the data sheet's values give --nominal, in "
                "Python nominal=True"
            )

    def apply(self, samples, *, nominal=False):
        """Return calibrated samples.

        Parameters
        ----------
        samples : DataFrame
            The whole log, SI, as ingest writes it: `t` (s), `ax ay az` (m/s^2), `gx gy gz` (rad/s)
            and, if it was logged, `temperature` (degC). It has to be whole, because some effects
            depend on earlier samples.
        nominal : bool
            Whether to apply a calibration even if none of its parameters was measured.

        Returns
        -------
        DataFrame
            A copy with calibrated specific force (m/s^2) and angular rate (rad/s), marked as
            calibrated in its `attrs`.

        Raises
        ------
        ImuloopError
            If a column is missing, the samples are marked as calibrated, or nothing was measured.
        """
        if not hasattr(samples, "columns"):
            raise ImuloopError(
                "apply takes a DataFrame with t, ax ay az, gx gy gz, not "
                f"{type(samples).__name__}: imuloop.read(log) gives one; of arrays apply_arrays"
            )
        check_columns(samples.columns)
        refuse_calibrated(samples.columns, samples.attrs.get(METADATA_KEY.decode(), {}))
        f, w = (samples[list(axes)] for axes in SENSORS.values())
        f, w = self.apply_arrays(f, w, samples[TIME], samples.get(TEMPERATURE), nominal=nominal)
        calibrated = samples.copy()
        calibrated[list(CHANNELS)] = np.hstack([f, w])
        calibrated.attrs |= calibrated_attrs(self.device)
        return calibrated

    def apply_arrays(
        self, acceleration, angular_rate, t=None, temperature=None, *, raw=False, nominal=False
    ):
        """Return the calibrated specific force and angular rate of arrays.

        Parameters
        ----------
        acceleration, angular_rate : array_like, shape (n, 3) or (3,)
            Specific force and angular rate of n samples or of one, nominal SI (m/s^2, rad/s).
        t : array_like, shape (n,), optional
            Seconds since the start of the log. It is needed if an effect depends on the time or on
            other samples; in the latter case the arrays have to be the whole log.
        temperature : array_like, shape (n,), optional
            degC; needed if there is an effect of the temperature.
        raw : bool
            Whether the arrays are in the raw units of the calibration, such as counts, not in SI.
        nominal : bool
            Whether to apply a calibration even if none of its parameters was measured.

        Returns
        -------
        acceleration, angular_rate : ndarray
            Calibrated values, m/s^2 and rad/s, in the shape of the inputs.

        Raises
        ------
        ImuloopError
            If shapes differ, an effect lacks an input (such as the samples before and after a
            single one), or nothing was measured.
        """
        if not nominal:
            self.refuse_nominal()
        f, w = np.asarray(acceleration, dtype=float), np.asarray(angular_rate, dtype=float)
        if f.shape != w.shape or f.ndim not in (1, 2) or f.shape[-1] != 3:
            raise ImuloopError(
                f"acceleration and angular_rate must both be (n, 3) or (3,), not {f.shape} and "
                f"{w.shape}"
            )
        shape, f, w = f.shape, f.reshape(-1, 3), w.reshape(-1, 3)
        timed = [e.name for e in self.effects if e.effect.timed or e.effect.rate_of_change]
        if t is None and timed:
            raise ImuloopError(f"t is needed: the calibration holds {', '.join(timed)}")
        t = np.zeros(len(f)) if t is None else np.atleast_1d(np.asarray(t, dtype=float))
        if temperature is not None:
            temperature = np.atleast_1d(np.asarray(temperature, dtype=float))
        for name, values in (("t", t), ("temperature", temperature)):
            if values is not None and values.shape != (len(f),):
                raise ImuloopError(f"{name} must have the shape ({len(f)},), not {values.shape}")
        if raw:
            f, w = self.accelerometer.raw_unit.to_si(f), self.gyroscope.raw_unit.to_si(w)
        f, w = self.calibrated(f, w, t, temperature)
        return f.reshape(shape), w.reshape(shape)

    def apply_file(self, source, target, *, nominal=False, shift=0.0):
        """Write a copy of a file of samples with calibrated specific force and angular rate.

        Parameters
        ----------
        source : path
            Parquet file of samples that ingest wrote.
        target : path
            File to write, with the ending ``.csv`` or ``.parquet``.
        nominal : bool
            Whether to apply a calibration even if none of its parameters was measured.
        shift : float
            Seconds to add to the time stamps.

        Returns
        -------
        dict
            Number of samples at which an effect was clamped, by (sensor, effect), both names. At
            these samples the input of the effect, such as the temperature, is outside its range in
            the data of the fit. Effects that were never clamped are left out.
        """
        if not nominal:
            self.refuse_nominal()
        return apply_file(self, source, target, shift=shift)

    def calibrated(self, f, w, t, temperature, clamped=(None, None)):
        """Return calibrated specific force, m/s^2, and angular rate, rad/s, (n, 3) each.

        Effects of the accelerometer that depend on the angular rate use it before the gyroscope's
        effects are subtracted. Effects of the gyroscope use the calibrated specific force. Raises
        an ImuloopError if a result is not finite although all inputs are.

        Parameters
        ----------
        f : ndarray, shape (n, 3)
            Specific force, nominal SI.
        w : ndarray, shape (n, 3)
            Angular rate, nominal SI.
        t : ndarray, shape (n,)
            Time since the start of the log, s.
        temperature : ndarray, shape (n,), or None
            Temperature, degC.
        clamped : pair of dict or None
            For each sensor, accelerometer first, a dict to fill, or None. The dict gets, by name of
            the effect, the mask, (n,), of the samples at which the effect was clamped to the range
            of the data that it was fitted to.
        """

        def apply_sensor(sensor, values, other, clamped):
            """Return the calibrated values of `sensor`, a SensorCalibration, (n, 3).

            `values` are its values in nominal SI, and `other` the values of the other sensor, (n,
            3) each. `clamped` is the dict to fill for this sensor, or None.
            """
            output = sensor.output(values)
            channels = Channels(t, output, other, temperature, clamped=clamped)
            return sensor.apply(values, channels)

        finite = all(np.isfinite(values).all() for values in (f, w, t))
        # values that overflow are refused below
        with np.errstate(over="ignore", invalid="ignore"):
            f = apply_sensor(self.accelerometer, f, self.gyroscope.aligned(w), clamped[0])
            w = apply_sensor(self.gyroscope, w, f, clamped[1])
        for sensor, values in zip(SENSORS, (f, w), strict=True):
            wrong = ~np.isfinite(values).all(axis=1)
            if finite and wrong.any():
                raise ImuloopError(
                    f"the {sensor}'s calibration makes values that are not finite of finite ones, "
                    f"first at t = {t[np.argmax(wrong)]:.6g} s"
                )
        return f, w

    def to_json(self, path):
        """Write the calibration as a JSON file at `path`.

        Raises an ImuloopError for an impossible calibration, such as one with a singular
        misalignment.
        """
        self._refuse_impossible(path)
        content = {"format": FORMAT, "device": self.device, "gravity": self.gravity}
        content |= {"log": self.log} | {s: getattr(self, s).to_dict() for s in SENSORS}
        # these keys are left out if there is nothing to say
        optional = {"sha256": list(self.sha256), "updated": self.updated}
        write_json(path, content | {key: value for key, value in optional.items() if value})

    @classmethod
    def from_json(cls, path):
        """Return the Calibration in the JSON file at `path`.

        Raises an ImuloopError if the file has another format, violates the schema, or holds an
        impossible calibration, such as one with a singular misalignment.
        """
        content = read_json(path, MOST_BYTES)
        number = content.get("format") if isinstance(content, dict) else None
        if number != FORMAT:
            raise ImuloopError(
                f"{path}: format {str(number)[:40]}, this version reads format {FORMAT}"
            )
        if fault := content_fault(content):
            raise ImuloopError(f"{path}: {fault}")
        try:
            calibration = cls(
                content["device"],
                content["gravity"],
                **{sensor: SensorCalibration.from_dict(content[sensor]) for sensor in SENSORS},
                log=content.get("log", {}),
                updated=content.get("updated", {}),
                sha256=tuple(content.get("sha256", ())),
            )
        except ImuloopError as error:
            raise ImuloopError(f"{path}: {error}") from error
        calibration._refuse_impossible(path)
        return calibration

    def _refuse_impossible(self, path):
        """Raise an ImuloopError if a value of the calibration is impossible, such as a singular T.

        The message names the file `path`.
        """
        for sensor in SENSORS:
            if fault := sensor_fault(getattr(self, sensor), sensor):
                raise ImuloopError(f"{path}: {sensor}: {fault}")
