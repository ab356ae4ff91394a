"""What bench prints: its artefacts, its reference, the peers' environment, two processors."""

import re

import numpy as np
import pytest

from bench import tables
from bench.held_out import ratios
from bench.peers.__main__ import reference
from bench.peers.calls import averaging_factors
from bench.processors import BOUND, differences
from calibrate.devices import UNITS, known_noise, planned, recording
from imuloop.calibrate.calibrate import start_pair
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.diagnose.records.pose_diagnosis import pose_problem
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.noise.allan import allan_variance
from imuloop.simulate.truth import example_truth


def test_an_artefact_names_its_commit_first(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "ARTEFACTS", tmp_path / "bench")
    tables.publish("peers", "Beside other packages", "a table\n")
    first, *others = (tmp_path / "bench/peers.md").read_text().splitlines()
    assert re.fullmatch(
        r"# Beside other packages: commit (unknown|[0-9a-f]{7,})(, changed)?", first
    )
    assert others[-1] == "a table"


def test_peers_get_the_same_numpy_and_scipy(repository):
    locked = (repository / "requirements.lock").read_text()
    for line in (repository / "bench/requirements.txt").read_text().splitlines()[1:5]:
        assert re.search(rf"^{re.escape(line)}\b", locked, re.M), line


def test_reference_is_the_overlapping_deviation():
    x = np.random.default_rng(1).normal(9.8, 1, (2, 3000))
    factors = averaging_factors(3000)
    found = [np.sqrt(allan_variance([each], factors)) for each in x]
    assert reference(x, factors) == pytest.approx(np.array(found), rel=1e-12)


def test_results_of_two_processors_differ_by_a_word_or_by_a_share_of_a_number():
    one = {"verdict": "consistent", "floor": 1e-3, "ci95": [0.0, 2.0], "tests": 9, "why": None}

    def share(**changed):
        return max(share for _, _, share in differences(one, one | changed))

    assert share() == 0
    assert share(floor=1.001e-3) == pytest.approx(1e-3, rel=1e-2)
    # of an interval that reaches down to zero the size is its other end
    assert share(ci95=[1e-9, 2.0]) < BOUND < share(ci95=[1e-3, 2.0])
    # an estimate near zero is as large as its standard error
    one |= {"parameters": {"k": 4e-7}, "std": {"k": 5e-4}}
    assert share(parameters={"k": 4.0001e-7}) < BOUND < share(parameters={"k": 5e-7})
    for changed in ({"verdict": "unexplained"}, {"why": 0.0}, {"ci95": None}, {"ci95": [0.0]}):
        assert share(**changed) == np.inf
    assert share(another=0) == np.inf


def test_weights_of_all_poses_hardly_lower_the_held_out_errors():
    """The bound of what docs/method.md says of the weights and the linearisation."""
    truth = planned(example_truth(rate=50.0), poses=20)
    made, how = recording(truth, 9400), (known_noise(truth), truth.gravity, UNITS)
    pair, _ = start_pair(made, *how, CalibrateSettings())
    found = ratios(pose_problem(pair, made, DiagnoseSettings(folds=5), 1))
    assert set(found) == {"gravity_norm", "pose_rate", "rotation"}
    assert all(0.9 < ratio < 1.1 for ratio in found.values()), found
