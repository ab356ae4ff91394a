"""A reference beside a log: what is declared wrongly is named with what fits, losses are cut."""

import json
from functools import cache

import numpy as np
import pandas as pd
import pytest

from beside import DECLARED, PLACE, QUATERNION, written
from beside import ingested as ingested_files
from imuloop.core.samples import read_columns
from simulated_reference import Beside, simulate_beside

SEED = 12160


@cache
def sound():
    return simulate_beside(Beside(duration_s=60.0), SEED)


def made(folder, truth=None, declared=None, log=lambda x: x, reference=lambda x: x):
    pair = simulate_beside(truth, SEED) if truth else sound()
    paths = written(folder, "s", (log(pair[0]), reference(pair[1])))
    sources = {"log": {"path": paths[0].name}, "reference": {"path": paths[1].name}}
    return ingested(folder, paths, DECLARED | (declared or {}), sources=sources)


def ingested(folder, paths, reference, **more):
    results = ingested_files(folder, "s", paths, reference, **more)
    quality = json.loads(results["quality_path"].read_text())
    return quality, read_columns(results["samples_path"])


def scaled(names, factor):
    return lambda columns: columns | {name: factor * columns[name] for name in names}


def last_first(columns):
    turned = (columns[k] for k in ("qx", "qy", "qz", "qw"))
    return columns | dict(zip(QUATERNION, turned, strict=True))


def test_a_sound_reference_is_beside_the_samples(tmp_path):
    quality, samples = made(tmp_path)
    found = quality["reference"]
    assert quality["status"] == "ok"
    # as simulated: 0.2 degrees, 1 mm, 3 % lost, 0.5 % swapped in stretches of five
    assert found["noise"]["orientation"] == pytest.approx(np.radians(0.2), rel=0.1)
    assert found["noise"]["position"] == pytest.approx(1e-3, rel=0.1)
    assert found["lost"] == pytest.approx(0.03 * 6000, rel=0.5)
    assert found["swapped"] == 5 * found["swaps"] > 0
    assert not found["clock"]["own"]
    known = np.isfinite(samples["qw"])
    assert 0.9 < known.mean() < 1
    size = np.linalg.norm([samples[k][known] for k in QUATERNION], axis=0)
    np.testing.assert_allclose(size, 1, atol=1e-12)


CONJUGATE, IN_MM = scaled(QUATERNION[1:], -1), scaled(PLACE, 1e3)


# what is wrong, what is said, and what makes it right where a declaration can
@pytest.mark.parametrize(
    ("harm", "says", "declared"),
    [
        ({"reference": CONJUGATE}, "declare convention: world_to_body",
         {"convention": "world_to_body"}),
        ({"reference": last_first}, "they are xyzw", None),
        ({"reference": scaled(["py"], -1)}, "mirrored", None),
        ({"reference": IN_MM}, "declare units.position: mm", {"units": {"position": "mm"}}),
        ({"log": scaled(["gx", "gy", "gz"], np.degrees(1))}, "deg/s", None),
    ],
)  # fmt: skip
def test_a_wrong_declaration_is_named_with_what_fits(tmp_path, harm, says, declared):
    quality, samples = made(tmp_path, **harm)
    [reason] = quality["reasons"]
    assert quality["status"] == "rejected" and quality["misdeclared"] and says in reason
    assert not len(samples["t"])
    if declared:
        quality, _ = made(tmp_path, declared=declared, **harm)
        assert quality["status"] == "ok", quality["reasons"]


def test_half_of_the_reference_lost_is_counted(tmp_path):
    quality, samples = made(tmp_path, Beside(duration_s=40.0, lost=0.5))
    assert quality["status"] == "ok"
    assert quality["reference"]["lost"] == pytest.approx(2000, rel=0.2)
    assert 0.3 < np.isfinite(samples["qw"]).mean() < 0.6


def test_a_clock_of_its_own_is_found_by_the_rates(tmp_path):
    quality, samples = made(tmp_path, Beside(duration_s=60.0, clock=(3.0, 0.0)))
    clock = quality["reference"]["clock"]
    assert clock["own"]
    # what is left is for the diagnosis, of 0.1 s at most
    assert clock["offset_s"] == pytest.approx(-3.0, abs=0.01)
    assert 0.9 < np.isfinite(samples["qw"]).mean()


def test_a_reference_in_the_log_itself_is_read(tmp_path):
    log, reference = simulate_beside(Beside(duration_s=60.0, lost=0.0, swapped=0.0), SEED)
    at = np.searchsorted(reference["t"], log["t"] + 1e-9) - 1
    same = {name: reference[name][at] for name in (*QUATERNION, *PLACE)}
    # rows between two of the reference are lost
    odd = np.abs(reference["t"][at] - log["t"]) > 1e-6
    for column in same.values():
        column[odd] = np.nan
    path = tmp_path / "log.csv"
    pd.DataFrame(log | same).to_csv(path, index=False)
    declared = DECLARED | {"columns": {"orientation": QUATERNION, "position": PLACE}}
    quality, _ = ingested(tmp_path, [path], declared)
    assert quality["status"] == "ok"
    assert quality["reference"]["lost"] == odd.sum()
    assert quality["reference"]["coverage"] > 0.99
