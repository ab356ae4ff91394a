"""A reference beside a log: what is declared wrongly is named with what fits, losses are cut."""

from functools import cache

import numpy as np
import pandas as pd
import pytest

from beside import DECLARED, PLACE, QUATERNION, ingest_session, write_pair
from imuloop.core.files import read_json
from imuloop.core.samples import read_columns
from ingest.figures import check_figures
from simulated_reference import Beside, simulate_beside

SEED = 12160


@cache
def sound():
    return simulate_beside(Beside(duration_s=60.0), SEED)


def ingest_pair(folder, truth=None, declared=None, log=dict, reference=dict):
    """Return quality and samples of a simulated pair; `log` and `reference` harm its columns."""
    columns = simulate_beside(truth, SEED) if truth else sound()
    paths = write_pair(folder, "s", (log(columns[0]), reference(columns[1])))
    sources = {"log": {"path": paths[0].name}, "reference": {"path": paths[1].name}}
    results = ingest_session(folder, "s", paths, DECLARED | (declared or {}), sources=sources)
    return read_json(results["quality_path"]), read_columns(results["samples_path"])


def scaled(names, factor):
    return lambda columns: columns | {name: factor * columns[name] for name in names}


def last_first(columns):
    turned = (columns[k] for k in ("qx", "qy", "qz", "qw"))
    return columns | dict(zip(QUATERNION, turned, strict=True))


# as simulated: 0.2 degrees, 1 mm, 3 % lost, 0.5 % swapped in stretches of five
@pytest.mark.parametrize(
    ("truth", "figures", "coverage"),
    [(None, {"noise.orientation": lambda x: abs(x / np.radians(0.2) - 1) < 0.1,
              "noise.position": lambda x: abs(x / 1e-3 - 1) < 0.1,
              "lost": lambda n: 90 < n < 270, "swaps": lambda n: n > 0, "clock.own": False},
      (0.9, 0.9999)),
     (Beside(duration_s=40.0, lost=0.5), {"lost": lambda n: 1600 < n < 2400}, (0.3, 0.6)),
     # what is left of a clock of its own, 0.1 s at most, is for the diagnosis
     (Beside(duration_s=60.0, clock=(3.0, 0.0)),
      {"clock.own": True, "clock.offset_s": lambda s: abs(s + 3) < 0.01}, (0.9, 0.9999))],
)  # fmt: skip
def test_a_reference_is_beside_the_samples(tmp_path, truth, figures, coverage):
    quality, samples = ingest_pair(tmp_path, truth)
    assert quality["status"] == "ok"
    check_figures(quality["reference"], figures)
    swaps = quality["reference"]["swaps"]
    assert truth or quality["reference"]["swapped"] == 5 * swaps
    inside = np.isfinite(samples["qw"])
    assert coverage[0] < inside.mean() < coverage[1]
    size = np.linalg.norm([samples[k][inside] for k in QUATERNION], axis=0)
    np.testing.assert_allclose(size, 1, atol=1e-12)


# what is wrong, what is said, and what makes it right where a declaration can
@pytest.mark.parametrize(
    ("harm", "says", "declared"),
    [
        ({"reference": scaled(QUATERNION[1:], -1)}, "declare convention: world_to_body",
         {"convention": "world_to_body"}),
        ({"reference": last_first}, "they are xyzw", None),
        ({"reference": scaled(["py"], -1)}, "mirrored", None),
        ({"reference": scaled(PLACE, 1e3)}, "declare units.position: mm",
         {"units": {"position": "mm"}}),
        ({"log": scaled(["gx", "gy", "gz"], np.degrees(1))}, "deg/s", None),
    ],
)  # fmt: skip
def test_a_wrong_declaration_is_named_with_what_fits(tmp_path, harm, says, declared):
    quality, samples = ingest_pair(tmp_path, **harm)
    [reason] = quality["reasons"]
    assert quality["status"] == "rejected" and quality["misdeclared"] and says in reason
    assert not len(samples["t"])
    if declared:
        quality, _ = ingest_pair(tmp_path, declared=declared, **harm)
        assert quality["status"] == "ok", quality["reasons"]


def test_a_reference_in_the_log_itself_is_read(tmp_path):
    log, reference = simulate_beside(Beside(duration_s=60.0, lost=0.0, swapped=0.0), SEED)
    at = np.searchsorted(reference["t"], log["t"] + 1e-9) - 1
    # rows between two of the reference are lost
    odd = np.abs(reference["t"][at] - log["t"]) > 1e-6
    same = {name: np.where(odd, np.nan, reference[name][at]) for name in (*QUATERNION, *PLACE)}
    path = tmp_path / "log.csv"
    pd.DataFrame(log | same).to_csv(path, index=False)
    declared = DECLARED | {"columns": {"orientation": QUATERNION, "position": PLACE}}
    quality = read_json(ingest_session(tmp_path, "s", [path], declared)["quality_path"])
    assert quality["status"] == "ok"
    figures = quality["reference"]
    assert figures["lost"] == odd.sum() and figures["coverage"] > 0.99
