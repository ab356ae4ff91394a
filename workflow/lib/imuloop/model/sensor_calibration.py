"""The calibration of one sensor, ``x = T (K (raw - b) - e)``.

Raw values are in the unit of the log. Nominal SI values are raw values less the data sheet's
offset, times its scale.
"""

from dataclasses import dataclass

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.units import RawUnit
from imuloop.model.effect import OUTPUT, FittedEffect
from imuloop.model.state import NAMES

# fields that a file holds without conversion
_PLAIN = ("method", "not_testable", "reduced_chi2", "verdict")
# ratio of the standard error to the prior standard deviation above which the data did not improve
# a parameter
IMPROVED = 0.7
# distance from the mean of the prior, in its standard deviations, above which it is reported
FAR_OFF = 4.0


@dataclass(frozen=True)
class SensorCalibration:
    """The calibration of one sensor, ``x = T (K (raw - b) - e)``, and how it was found.

    x are the calibrated values, T is the misalignment, K are the scale factors, b the biases, and e
    is the sum of the effects.
    """

    raw_unit: RawUnit  # of `raw` and b
    T: np.ndarray  # (3, 3): misalignment, unit diagonal; upper triangular for an accelerometer
    K: np.ndarray  # (3,): scale factor, SI per raw unit
    b: np.ndarray  # (3,): bias, raw units
    # names of the p estimated parameters: ``T01``, …, ``K0``, …, ``b0``, …, then of its effects
    names: tuple[str, ...] = ()
    covariance: np.ndarray | None = None  # (p, p): in the units of the parameters
    effects: tuple[FittedEffect, ...] = ()  # their sum is e, SI, on the sensor's own axes
    method: str = "nominal"  # how the parameters were estimated, such as `multi_position`
    not_testable: str | None = None  # why the data do not determine the full model
    reduced_chi2: float | None = None  # reduced χ² of the fit by the noise model
    # worst verdict, in diagnosis.json, of the records that the parameters and effects come from;
    # None without a diagnosis
    verdict: str | None = None
    # ``source`` of the prior, and ``mean`` and ``std`` by name of the parameter; None if absent
    prior: dict | None = None

    @classmethod
    def nominal(cls, raw_unit, not_testable):
        """Return the nominal calibration of a sensor: the scale and the offset of its data sheet.

        `raw_unit` is the RawUnit that has them. `not_testable` is a text: why nothing was measured.
        """
        scale, offset = np.full(3, raw_unit.scale), np.full(3, raw_unit.offset)
        return cls(raw_unit, T=np.eye(3), K=scale, b=offset, not_testable=not_testable)

    @property
    def measured(self):
        """Whether any parameter was measured; otherwise all come from the data sheet."""
        nominal = self.nominal(self.raw_unit, None)
        same = all(np.array_equal(getattr(self, x), getattr(nominal, x)) for x in "TKb")
        return self.method != "nominal" or bool(self.effects) or not same

    @property
    def unexplained(self):
        """Whether the residuals of the fit are larger than the noise and the effects explain."""
        return self.measured and self.verdict == "unexplained"

    @property
    def excess(self):
        """Factor by which the variance of the noise is enlarged: the reduced χ² of the fit, or 1.

        It is 1 if the reduced χ² is smaller than 1 or not known.
        """
        return max(1.0, self.reduced_chi2 or 1.0)

    def output(self, values):
        """Return ``K (raw - b)``, SI, on the sensor's own axes, (…, 3), without effects.

        `values`, (…, 3), are in nominal SI; raw are the same in raw units. K are the scale factors
        and b the biases.
        """
        return (self.raw_unit.from_si(values) - self.b) * self.K

    def aligned(self, values):
        """Return ``T K (raw - b)``, SI, on the axes of the body, without effects, (…, 3).

        `values`, (…, 3), are in nominal SI; raw are the same in raw units. T is the misalignment, K
        are the scale factors and b the biases.
        """
        return self.output(values) @ self.T.T

    def apply(self, values, channels=None):
        """Return the calibrated values of n samples, SI, on the axes of the body, (n, 3).

        `values`, (n, 3), are in nominal SI. `channels` are the Channels at the n samples, the
        inputs of the effects; they are not needed if there are no effects.
        """
        output = self.output(values)
        for effect in self.effects:
            output = output - effect.output(channels)
        return output @ self.T.T

    @property
    def std(self):
        """Standard errors of the estimated parameters, in the units of these, a dict by name."""
        if not self.names:
            return {}
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True))

    def value(self, name):
        """Return the value, in raw units, of the parameter `name`, an element of T, K or b.

        T01, for instance, is an off-diagonal element of the misalignment T, K0 a scale factor and
        b0 a bias.
        """
        return float(getattr(self, name[0])[tuple(map(int, name[1:]))])

    def parameters(self, sensor):
        """Return all parameters, a list of (name, value, standard error, unit, source).

        T, K and b come first, then the parameters of the effects. The standard error is
        not-a-number for a parameter that was not estimated. The source is ``data``; for a parameter
        that the data did not improve, it is the source of the prior. `sensor` is the name of the
        sensor.
        """
        # names of the SI unit and of the raw unit
        si, raw, std = OUTPUT[sensor], self.raw_unit.name, self.std
        units = {"T": "rad", "K": "1" if raw == si else f"{si} per {raw}", "b": raw}
        prior = (self.prior or {}).get("source", "data sheet")
        rows = []
        for name in NAMES[sensor]:
            source = "data" if name in std and name not in self.unimproved else prior
            rows.append((name, self.value(name), std.get(name, np.nan), units[name[0]], source))
        for fitted in self.effects:
            units = fitted.effect.units(sensor)
            rows += [
                (f"{fitted.name}.{name}", value, fitted.std.get(name, np.nan), units[name], "data")
                for name, value in fitted.values.items()
            ]
        return rows

    def __str__(self):
        effects = ", ".join(effect.name for effect in self.effects) or "no effects"
        return f"{self.method}, {len(self.names)} parameters, {effects}"

    def __repr__(self):
        return f"<SensorCalibration: {self}>"

    @property
    def unimproved(self):
        """Names of the parameters that the data hardly improved, a tuple.

        The standard error of such a parameter is more than `IMPROVED` times the standard deviation
        of its prior. Parameters that were not estimated are among them.
        """
        prior, std = (self.prior or {"std": {}})["std"], self.std
        return tuple(name for name, size in prior.items() if std.get(name, size) > IMPROVED * size)

    @property
    def far_off(self):
        """Parameters that are far from the prior, a dict of their distances by name.

        A distance is the absolute difference between the parameter and its mean by the prior,
        divided by its standard deviation by the prior. Only distances above `FAR_OFF` are in the
        dict; it is empty if there are none.
        """
        prior = self.prior or {"std": {}}
        sizes = {n: abs(self.value(n) - prior["mean"][n]) / s for n, s in prior["std"].items()}
        return {name: size for name, size in sizes.items() if size > FAR_OFF}

    def to_dict(self):
        """Return the entry of this sensor in the JSON file of a calibration, a dict."""
        covariance = np.zeros((0, 0)) if self.covariance is None else self.covariance
        return {
            "raw_unit": self.raw_unit.name,
            "raw_scale": self.raw_unit.scale,
            "raw_offset": self.raw_unit.offset,
            **{key: getattr(self, key) for key in _PLAIN},
            "T": self.T,
            "K": self.K,
            "b": self.b,
            "covariance": {"names": list(self.names), "matrix": covariance},
            "effects": [effect.to_dict() for effect in self.effects],
            **({"prior": self.prior} if self.prior else {}),
        }

    @classmethod
    def from_dict(cls, content):
        """Return the SensorCalibration from `content`, the dict of its entry in a JSON file.

        Raises an ImuloopError if the matrix of the covariance is not square, or if an effect is not
        in the library.
        """
        rows = content["covariance"]["matrix"]
        if any(len(row) != len(rows) for row in rows):
            raise ImuloopError("covariance: the matrix is not square")
        return cls(
            RawUnit(content["raw_unit"], content["raw_scale"], content["raw_offset"]),
            **{key: np.array(content[key], dtype=float) for key in "TKb"},
            names=tuple(content["covariance"]["names"]),
            covariance=np.array(rows, dtype=float).reshape(len(rows), len(rows)),
            effects=tuple(map(FittedEffect.from_dict, content["effects"])),
            prior=content.get("prior"),
            **{key: content.get(key) for key in _PLAIN},
        )
