"""The comparison of the devices of each type, results/family.json."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import chdtrc

# a calibration may hold any effect of the library
import imuloop.effects  # noqa: F401
from imuloop.core.files import read_json, write_json
from imuloop.core.noise_model import NoiseModel
from imuloop.core.p_values import holm
from imuloop.core.samples import SENSORS
from imuloop.family import LEAST
from imuloop.family.estimates import of_calibrations, of_noise
from imuloop.family.odd import deviations
from imuloop.family.random_effects import fit, spread_interval
from imuloop.model.calibration import Calibration

# version of the JSON file
FORMAT = 1
# chance that any device of a type is named that does not stand out
SIGNIFICANCE = 0.05


@dataclass(frozen=True)
class Member:
    """A device of a type, and its results."""

    name: str
    calibration: Calibration
    noise: NoiseModel
    tried: dict  # the effects that its diagnosis tested, as `tried_effects` returns them


def read_member(folder):
    """Return the Member of a folder of results."""
    folder = Path(folder)
    return Member(
        folder.name,
        Calibration.from_json(folder / "calibration.json"),
        NoiseModel.from_json(folder / "noise.json"),
        tried_effects(read_json(folder / "diagnosis.json")),
    )


def tried_effects(diagnosis):
    """Return p-value, and whether it was added, of each effect that a diagnosis tested.

    The result is a dict by sensor, kind of data and name of the effect.
    """
    return {
        (sensor, record, each["name"]): (each["p_value"], each["status"] == "added")
        for sensor in SENSORS
        for record, block in diagnosis["sensors"][sensor].items()
        for each in block["candidates"]
        if each["p_value"] is not None
    }


def write_family(path, types):
    """Write family.json; `types` holds the Members of each type by its name."""
    write_json(path, {"format": FORMAT, "types": {t: of_type(m) for t, m in types.items()}})


def of_type(members):
    """Return the content of family.json on one type.

    Each device is tested in each parameter. The p-values of all these tests are adjusted together
    by Holm's method.
    """
    every = of_calibrations([m.calibration for m in members])
    every += of_noise([m.noise for m in members])
    parameters, chances, tests = {}, [], []
    for each in (e for e in every if e.known.sum() >= LEAST):
        parameters[each.name], p = of_parameter(each, members)
        chances += [*p]
        tests += [(each.name, k) for k in range(len(p))]
    odd = []
    for (name, k), p in zip(tests, holm(chances).tolist(), strict=True):
        if p < SIGNIFICANCE:
            device, away = (parameters[name][key][k] for key in ("devices", "deviations"))
            odd.append({"device": device, "parameter": name, "deviation": away, "p_value": p})
    return {
        "devices": [m.name for m in members],
        "tests": len(tests),
        "significance": SIGNIFICANCE,
        "parameters": parameters,
        "odd": sorted(odd, key=lambda each: each["p_value"]),
        "effects": effects(members),
    }


def of_parameter(each, members):
    """Return the content on one parameter, a dict, and the p-value of each known device, (k,).

    The p-value is the probability that a device which is not odd is as far from the others; it is
    not adjusted. Mean and values of a noise coefficient are in its unit, its spread and standard
    errors are relative.
    """
    own = each.known
    y, std = each.values[own], each.std[own]
    found, shown = fit(y, std**2), np.exp if each.logarithmic else np.asarray
    away, p = deviations(y, std**2)
    content = {
        "unit": each.unit,
        "logarithmic": each.logarithmic,
        "mean": shown(found.mean[0]),
        "mean_std": np.sqrt(found.mean_variance[0]),
        "spread": np.sqrt(found.variance[0]),
        "spread_ci95": spread_interval(y, std**2),
        "within": np.sqrt(np.mean(std**2)),
        "devices": [m.name for m, k in zip(members, own, strict=True) if k],
        "values": shown(y),
        "std": std,
        "deviations": away,
    }
    return content, p


def effects(members):
    """Return a list of the effects that several devices tested, the smallest p-value first.

    The hypothesis is that fewer than half of the devices have the effect. Its p-value is Fisher's
    combination of the larger half of the p-values of the devices (partial conjunction), adjusted
    for all effects by Holm's method. So a single device cannot give an effect to the type, and all
    devices together can show an effect that no device shows by itself.

    References
    ----------
    Y. Benjamini, R. Heller, "Screening for partial conjunction hypotheses", Biometrics 64 (2008).
    """
    tried = {}
    for member in members:
        for effect, outcome in member.tried.items():
            tried.setdefault(effect, {})[member.name] = outcome
    found = []
    for (sensor, record, name), devices in tried.items():
        if len(devices) >= LEAST:
            p = np.sort([max(p, 1e-300) for p, _ in devices.values()])
            larger = p[(len(p) + 1) // 2 - 1 :]
            added = [device for device, (_, has) in devices.items() if has]
            one = {"sensor": sensor, "record": record, "name": name, "tried": len(p)}
            chance = chdtrc(2 * len(larger), -2 * np.log(larger).sum())
            found.append(one | {"added": added, "p_value": float(chance)})
    for one, p in zip(found, holm([one["p_value"] for one in found]).tolist(), strict=True):
        one["p_value"] = p
    return sorted(found, key=lambda one: (one["p_value"], -len(one["added"])))
