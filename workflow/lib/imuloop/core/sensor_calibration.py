"""The calibration of one sensor, ``x = T (K (raw - b) - e)``."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import OUTPUT, FittedEffect
from imuloop.core.errors import ImuloopError
from imuloop.core.units import RawUnit

# what a file says of a sensor as it is
_WORDS = ("method", "not_testable", "reduced_chi2", "verdict")
# share of its prior standard deviation above which a parameter is the data sheet's
IMPROVED = 0.7
# prior standard deviations from the prior's mean beyond which a parameter is reported
FAR_OFF = 4.0


@dataclass(frozen=True)
class SensorCalibration:
    """The calibration of one sensor, ``x = T (K (raw - b) - e)``."""

    raw_unit: RawUnit  # of `raw` and b
    T: np.ndarray  # (3, 3): misalignment, unit diagonal; upper triangular for an accelerometer
    K: np.ndarray  # (3,): scale factor, SI per raw unit
    b: np.ndarray  # (3,): bias, raw units
    # the p parameters that were estimated: ``T01``, …, ``K0``, …, ``b0``, … and an effect's
    names: tuple[str, ...] = ()
    covariance: np.ndarray | None = None  # (p, p): in the parameters' own units
    effects: tuple[FittedEffect, ...] = ()  # what adds up to e, SI, on the sensor's own axes
    method: str = "nominal"  # what the parameters come from, as `multi_position`
    not_testable: str | None = None  # why the data do not determine the full model
    reduced_chi2: float | None = None  # of the fit, against the noise model
    # the worst in diagnosis.json of the records that the parameters and effects come from; None
    # where it was not diagnosed
    verdict: str | None = None
    # ``source`` of the prior, its ``mean`` and ``std`` of each parameter by name; None without one
    prior: dict | None = None

    @classmethod
    def nominal(cls, raw_unit, not_testable):
        """Return the data sheet's calibration, with the reason why nothing was measured."""
        scale, offset = np.full(3, raw_unit.scale), np.full(3, raw_unit.offset)
        return cls(raw_unit, np.eye(3), scale, offset, not_testable=not_testable)

    @property
    def measured(self):
        """Whether any parameter was measured; otherwise all are the data sheet's."""
        promised = self.nominal(self.raw_unit, None)
        same = all(np.array_equal(getattr(self, x), getattr(promised, x)) for x in "TKb")
        return self.method != "nominal" or bool(self.effects) or not same

    @property
    def unexplained(self):
        """Whether the data that it was measured from are unexplained."""
        return self.measured and self.verdict == "unexplained"

    @property
    def excess(self):
        """Reduced χ² of its fit where above one: so many times its noise is that of the data."""
        return max(1.0, self.reduced_chi2 or 1.0)

    def output(self, values):
        """Return ``K (raw - b)`` of values in SI units as logged, shape (n, 3)."""
        return (self.raw_unit.from_si(values) - self.b) * self.K

    def aligned(self, values):
        """Return ``T K (raw - b)``, SI on the axes of the body, of values as logged, (…, 3)."""
        return self.output(values) @ self.T.T

    def apply(self, values, channels=None):
        """Return calibrated values, SI, of values as logged, SI, shape (n, 3).

        The channels, which the effects depend on, are needed only where there are effects.
        """
        output = self.output(values)
        for effect in self.effects:
            output = output - effect.output(channels)
        return output @ self.T.T

    @property
    def std(self):
        """Standard errors of the estimated parameters by name."""
        if not self.names:
            return {}
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True))

    def parameters(self, sensor):
        """Return name, value, standard error (nan without one), unit and source of parameters.

        `sensor` is its name, which its data do not hold.
        """
        si, raw, std = OUTPUT[sensor], self.raw_unit.name, self.std
        scale = "1" if raw == si else f"{si} per {raw}"
        angles = [(i, j) for i, j in np.ndindex(3, 3) if i < j or (i > j and sensor == "gyroscope")]
        rows = [(f"T{i}{j}", self.T[i, j], "rad") for i, j in angles]
        rows += [(f"K{i}", k, scale) for i, k in enumerate(self.K)]
        rows += [(f"b{i}", b, raw) for i, b in enumerate(self.b)]
        before = (self.prior or {}).get("source", "data sheet")
        sources = {name: "data" for name in std} | dict.fromkeys(self.unimproved, before)
        rows = [
            (name, float(value), std.get(name, np.nan), unit, sources.get(name, before))
            for name, value, unit in rows
        ]
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
        """Names of the parameters that the data hardly improved: they are the prior's.

        Their standard error is above `IMPROVED` of the prior's.
        """
        before, std = (self.prior or {"std": {}})["std"], self.std
        return tuple(name for name, size in before.items() if std.get(name, size) > IMPROVED * size)

    @property
    def far_off(self):
        """Prior standard deviations from the prior's mean, by parameter, beyond `FAR_OFF`."""
        if not self.prior:
            return {}
        std, mean = self.prior["std"], self.prior["mean"]
        own = {n: getattr(self, n[0])[tuple(int(i) for i in n[1:])] for n in std}
        sizes = {name: float(abs(own[name] - mean[name]) / std[name]) for name in std}
        return {name: size for name, size in sizes.items() if size > FAR_OFF}

    def to_dict(self):
        """Return what the JSON file holds."""
        covariance = np.zeros((0, 0)) if self.covariance is None else self.covariance
        return {
            "raw_unit": self.raw_unit.name,
            "raw_scale": self.raw_unit.scale,
            "raw_offset": self.raw_unit.offset,
            **{key: getattr(self, key) for key in _WORDS},
            "T": self.T,
            "K": self.K,
            "b": self.b,
            "covariance": {"names": list(self.names), "matrix": covariance},
            "effects": [effect.to_dict() for effect in self.effects],
            **({"prior": self.prior} if self.prior else {}),
        }

    @classmethod
    def from_dict(cls, content):
        """Return the calibration that a JSON file holds."""
        rows = content["covariance"]["matrix"]
        if any(len(row) != len(rows) for row in rows):
            raise ImuloopError("covariance: the matrix is not square")
        return cls(
            RawUnit(content["raw_unit"], content["raw_scale"], content["raw_offset"]),
            *(np.array(content[key], dtype=float) for key in "TKb"),
            names=tuple(content["covariance"]["names"]),
            covariance=np.array(rows, dtype=float).reshape(len(rows), len(rows)),
            effects=tuple(map(FittedEffect.from_dict, content["effects"])),
            prior=content.get("prior"),
            **{key: content.get(key) for key in _WORDS},
        )
