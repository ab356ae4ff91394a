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
    # p-value, and whether it was added, of each effect that its diagnosis tested, by sensor, kind
    # of data and name of the effect
    tried: dict


def read_member(folder):
    """Return the Member of a folder of results."""
    folder = Path(folder)
    return Member(
        name=folder.name,
        calibration=Calibration.from_json(folder / "calibration.json"),
        noise=NoiseModel.from_json(folder / "noise.json"),
        tried=tried_effects(read_json(folder / "diagnosis.json")),
    )


def tried_effects(diagnosis):
    """Return p-value, and whether it was added, of each effect that a diagnosis tested.

    The result is a dict by sensor, kind of data and name of the effect.
    """
    return {
        (sensor, record, entry["name"]): (entry["p_value"], entry["status"] == "added")
        for sensor in SENSORS
        for record, block in diagnosis["sensors"][sensor].items()
        for entry in block["candidates"]
        if entry["p_value"] is not None
    }


def write_family(path, types):
    """Write family.json; `types` holds the Members of each type by its name."""
    write_json(path, {"format": FORMAT, "types": {t: of_type(m) for t, m in types.items()}})


def of_type(members):
    """Return the content of family.json on one type, a dict; takes its Members.

    Each device is tested in each parameter. The p-values of all these tests are adjusted together
    by Holm's method.
    """
    all_estimates = of_calibrations([m.calibration for m in members])
    all_estimates += of_noise([m.noise for m in members])
    # a test is the name of a parameter and the number of a device that determined it
    parameters, p_values, tests = {}, [], []
    for estimates in (e for e in all_estimates if e.known.sum() >= LEAST):
        parameters[estimates.name], p = of_parameter(estimates, members)
        p_values += [*p]
        tests += [(estimates.name, k) for k in range(len(p))]
    odd = []
    for (name, k), p in zip(tests, holm(p_values).tolist(), strict=True):
        if p < SIGNIFICANCE:
            device, deviation = (parameters[name][key][k] for key in ("devices", "deviations"))
            odd.append({"device": device, "parameter": name, "deviation": deviation, "p_value": p})
    return {
        "devices": [m.name for m in members],
        "tests": len(tests),
        "significance": SIGNIFICANCE,
        "parameters": parameters,
        "odd": sorted(odd, key=lambda entry: entry["p_value"]),
        "effects": effects(members),
    }


def of_parameter(estimates, members):
    """Return the content on one parameter, a dict, and a p-value for k devices, (k,).

    These are the devices that determined the parameter. The p-value is the probability that a
    device which is not odd is as far from the others; it is not adjusted for other tests. Mean and
    values of a noise coefficient are in its unit, its spread and standard errors are relative.

    Parameters
    ----------
    estimates : Estimates
        The values of the parameter by all devices.
    members : list of Member
        The devices.
    """
    known = estimates.known
    y, std = estimates.values[known], estimates.std[known]
    # a fit of a mean and a spread between devices; logarithms become values again
    model, to_value = fit(y, std**2), np.exp if estimates.logarithmic else np.asarray
    deviation, p = deviations(y, std**2)
    content = {
        "unit": estimates.unit,
        "logarithmic": estimates.logarithmic,
        "mean": to_value(model.mean[0]),
        "mean_std": np.sqrt(model.mean_variance[0]),
        "spread": np.sqrt(model.variance[0]),
        "spread_ci95": spread_interval(y, std**2),
        "within": np.sqrt(np.mean(std**2)),
        "devices": [m.name for m, is_known in zip(members, known, strict=True) if is_known],
        "values": to_value(y),
        "std": std,
        "deviations": deviation,
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
    # p-value, and whether it was added, by effect and device
    outcomes = {}
    for member in members:
        for effect, outcome in member.tried.items():
            outcomes.setdefault(effect, {})[member.name] = outcome
    entries = []
    for (sensor, record, name), by_device in outcomes.items():
        if len(by_device) >= LEAST:
            # a p-value of zero has no logarithm
            p = np.sort([max(p, 1e-300) for p, _ in by_device.values()])
            larger = p[(len(p) + 1) // 2 - 1 :]
            combined = chdtrc(2 * len(larger), -2 * np.log(larger).sum())
            entries.append(
                {
                    "sensor": sensor,
                    "record": record,
                    "name": name,
                    "tried": len(p),
                    "added": [device for device, (_, is_added) in by_device.items() if is_added],
                    "p_value": float(combined),
                }
            )
    adjusted = holm([entry["p_value"] for entry in entries]).tolist()
    for entry, p in zip(entries, adjusted, strict=True):
        entry["p_value"] = p
    return sorted(entries, key=lambda entry: (entry["p_value"], -len(entry["added"])))
