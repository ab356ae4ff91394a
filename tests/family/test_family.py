"""results/family.json: its content for a type."""

from dataclasses import replace

import numpy as np
import pytest

from family.members import EVERY, NOTHING, Family, member
from imuloop.core.files import read_json
from imuloop.family.family import compare_devices, effects, write_family
from result_files import fault


def diagnosis_of(**p_values):
    """Return a diagnosis in which effects of the gyroscope were tried at poses, by p-value."""
    candidates = [
        {
            "name": name,
            "p_value": p,
            "status": "added" if p is not None and p < 1e-4 else "rejected",
        }
        for name, p in p_values.items()
    ]
    return {"sensors": NOTHING["sensors"] | {"gyroscope": {"poses": {"candidates": candidates}}}}


def of_effects(*diagnoses):
    zero = dict.fromkeys(EVERY, 0.0)
    one = dict.fromkeys(EVERY, 1e-3)
    members = [member(f"d{k}", zero, one, effect) for k, effect in enumerate(diagnoses)]
    return {effect["name"]: effect for effect in effects(members)}


def test_the_file_fits_its_schema_and_says_the_truth(tmp_path):
    family = Family(3)
    write_family(tmp_path / "family.json", {"chip": family.members()})
    assert fault(tmp_path / "family.json") is None
    content = read_json(tmp_path / "family.json")["types"]["chip"]
    assert [*content["parameters"]] == [e for e in EVERY[:21]] + [
        f"{c}.{t}" for s in ("a", "g") for t in "NBK" for c in (f"{s}x", f"{s}y", f"{s}z")
    ]
    assert content["tests"] == 39 * 50
    for k, name in enumerate(EVERY):
        one = content["parameters"][name]
        if not one["logarithmic"]:
            assert abs(one["mean"] - family.mean[k]) < 4 * one["mean_std"]
            np.testing.assert_allclose(one["values"], family.y[:, k], atol=1e-9)
        np.testing.assert_allclose(one["std"], family.std[:, k], rtol=1e-3)
        assert one["within"] == pytest.approx(np.sqrt(np.mean(family.std[:, k] ** 2)), rel=1e-3)


def test_a_parameter_that_few_determined_is_left_out():
    members = Family(5, count=4).members()
    zero, one = dict.fromkeys(EVERY, 0.0), dict.fromkeys(EVERY, 1e-3)
    unknown = one | {"gyroscope.K0": 0.0}
    members = [*members[:2], member("e", zero, unknown), member("f", zero, unknown)]
    # nor do data that hardly made the error of the prior smaller
    calibration = members[0].calibration
    prior = {"source": "data sheet", "std": {"K1": 1.2 * calibration.gyroscope.std["K1"]}}
    calibration = replace(calibration, gyroscope=replace(calibration.gyroscope, prior=prior))
    members[0] = replace(members[0], calibration=calibration)
    parameters = compare_devices(members)["parameters"]
    assert (
        "gyroscope.K0" not in parameters
        and parameters["gyroscope.K2"]["devices"] == "d0 d1 e f".split()
    )
    assert parameters["gyroscope.K1"]["devices"] == "d1 e f".split()


ALONE = [1e-30, *np.random.default_rng(0).uniform(0.05, 1, 9)]


@pytest.mark.parametrize(
    ("p_values", "added", "of_type"),
    [(ALONE, ["d0"], False), ([0.03, 0.02, 0.04, 0.01] * 5, [], True)],
    ids=["one device shows it", "none by itself, all together"],
)
def test_an_effect_is_that_of_the_type_where_all_devices_show_it(p_values, added, of_type):
    effect = of_effects(*(diagnosis_of(g_sensitivity=p) for p in p_values))["g_sensitivity"]
    assert effect["added"] == added and effect["tried"] == len(p_values)
    assert effect["p_value"] < 1e-6 if of_type else effect["p_value"] > 0.3


def test_what_was_not_tried_does_not_count():
    fitted = of_effects(*[diagnosis_of(g_sensitivity=0.5, earth_rate=None)] * 2, diagnosis_of())
    assert fitted == {}


def test_p_values_of_effects_hold_for_all_of_them():
    # none has any: no more than one family in twenty has one below 0.05
    rng, false = np.random.default_rng(1), 0
    names = ("g_sensitivity", "g2_sensitivity", "scale_nonlinearity")
    for _ in range(200):
        diagnoses = [
            diagnosis_of(**dict(zip(names, rng.uniform(size=3), strict=True))) for _ in range(6)
        ]
        false += min(one["p_value"] for one in of_effects(*diagnoses).values()) < 0.05
    assert false <= 18
