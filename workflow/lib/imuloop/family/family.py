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
from imuloop.family.estimates import estimates_of_calibrations, estimates_of_noise
from imuloop.family.odd import deviations
from imuloop.family.random_effects import fit, spread_interval
from imuloop.model.calibration import Calibration

# version of the JSON file
FORMAT = 1
# probability that a device is called odd in a type without odd devices
SIGNIFICANCE = 0.05


@dataclass(frozen=True)
class Member:
    """A member of a type: one device, with its calibration, noise and tested effects."""

    name: str
    calibration: Calibration
    noise: NoiseModel
    # the result of `tried_effects`
    tried: dict


def read_member(folder):
    """Return the Member whose results are in `folder`; the name of the folder is its name."""
    folder = Path(folder)
    return Member(
        name=folder.name,
        calibration=Calibration.from_json(folder / "calibration.json"),
        noise=NoiseModel.from_json(folder / "noise.json"),
        tried=tried_effects(read_json(folder / "diagnosis.json")),
    )


def tried_effects(diagnosis):
    """Return the p-value of each effect that a diagnosis tested, and whether the effect was added.

    `diagnosis` is the content of diagnosis.json. The result is a dict with an entry for each
    effect. The key is a tuple of three texts: the sensor, the kind of data (static, poses or
    reference), and the name of the effect. The value is a tuple of the p-value and a bool, which is
    true if the effect was added to the device's calibration. An effect without a p-value has no
    entry.
    """
    return {
        (sensor, record, entry["name"]): (entry["p_value"], entry["status"] == "added")
        for sensor in SENSORS
        for record, block in diagnosis["sensors"][sensor].items()
        for entry in block["candidates"]
        if entry["p_value"] is not None
    }


def write_family(path, types):
    """Write family.json to `path`; `types` has a list of the Members of each type by its name."""
    write_json(path, {"format": FORMAT, "types": {t: compare_devices(m) for t, m in types.items()}})


def compare_devices(members):
    """Return the content of family.json on one type, a dict; `members` are its Members.

    For each parameter, each device is tested for being odd: for differing from all other devices of
    the type. The p-values of all these tests are adjusted together by Holm's method. A device is
    listed as odd for each parameter with an adjusted p-value below `SIGNIFICANCE`. Exception: a
    parameter that fewer than `LEAST` devices determine is neither tested nor listed.
    """
    all_estimates = estimates_of_calibrations([m.calibration for m in members])
    all_estimates += estimates_of_noise([m.noise for m in members])
    parameters, p_values, tests = {}, [], []
    for estimates in (e for e in all_estimates if e.has_value.sum() >= LEAST):
        content, p = compare_parameter(estimates, members)
        parameters[estimates.name] = content
        p_values += [*p]
        devices = zip(content["devices"], content["deviations"], strict=True)
        tests += [
            {"device": device, "parameter": estimates.name, "deviation": deviation}
            for device, deviation in devices
        ]
    adjusted = zip(tests, holm(p_values).tolist(), strict=True)
    odd = [test | {"p_value": p} for test, p in adjusted if p < SIGNIFICANCE]
    return {
        "devices": [m.name for m in members],
        "tests": len(tests),
        "significance": SIGNIFICANCE,
        "parameters": parameters,
        "odd": sorted(odd, key=lambda entry: entry["p_value"]),
        "effects": effects(members),
    }


def compare_parameter(estimates, members):
    """Return the content of family.json on one parameter, a dict, and k p-values, (k,).

    There is a p-value for each of the k devices whose data determine the parameter: the probability
    that a device which is not odd differs from all others by at least as much as this one. The
    p-values are not yet adjusted for the number of tests. The mean and the values of a noise
    coefficient are in its unit; its spread and standard errors are relative.

    Parameters
    ----------
    estimates : Estimates
        The values of the parameter by all devices.
    members : list of Member
        The devices.
    """
    has_value = estimates.has_value
    y, std = estimates.values[has_value], estimates.std[has_value]
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
        # the usual error of a value by its own device
        "within": np.sqrt(np.mean(std**2)),
        "devices": [m.name for m, counts in zip(members, has_value, strict=True) if counts],
        "values": to_value(y),
        "std": std,
        "deviations": deviation,
    }
    return content, p


def effects(members):
    """Return the entries of family.json on effects, a list of dict, the smallest p-value first.

    An effect is an error of a sensor, such as a drift of its bias. `members` are the Members of a
    type. There is an entry for each effect that at least `LEAST` devices tested. The entry has the
    p-value of the null hypothesis that fewer than half of these devices have the effect. This
    p-value is computed by Fisher's method from the larger half of the devices' own p-values
    (partial conjunction), and adjusted for all effects by Holm's method. So one device cannot show
    an effect of the type, but all devices together can show an effect that none of them shows by
    itself.

    References
    ----------
    Y. Benjamini, R. Heller, "Screening for partial conjunction hypotheses", Biometrics 64 (2008).
    """
    # p-value, and whether it was added, by effect and device
    outcomes = {}
    for member in members:
        for effect, outcome in member.tried.items():
            outcomes.setdefault(effect, {})[member.name] = outcome
    outcomes = {effect: o for effect, o in outcomes.items() if len(o) >= LEAST}
    p_values = []
    for by_device in outcomes.values():
        # the n - u + 1 largest of n p-values test whether fewer than u = ⌈n/2⌉ devices have the
        # effect; a p-value of zero has no logarithm
        p = np.sort([max(p, 1e-300) for p, _ in by_device.values()])
        larger = p[(len(p) + 1) // 2 - 1 :]
        p_values.append(chdtrc(2 * len(larger), -2 * np.log(larger).sum()))
    entries = [
        {
            "sensor": sensor,
            "record": record,
            "name": name,
            "tried": len(by_device),
            "added": [device for device, (_, is_added) in by_device.items() if is_added],
            "p_value": p,
        }
        for ((sensor, record, name), by_device), p in zip(
            outcomes.items(), holm(p_values).tolist(), strict=True
        )
    ]
    return sorted(entries, key=lambda entry: (entry["p_value"], -len(entry["added"])))
