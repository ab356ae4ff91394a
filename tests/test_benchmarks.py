"""What bench prints: its artefacts, the peers' environment and recordings."""

import re

import numpy as np

from bench import tables
from bench.peers.log import still_log, write_mcap
from imuloop import read
from imuloop.core.samples import CHANNELS


def test_an_artefact_names_its_commit_first(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "ARTEFACTS", tmp_path / "bench")
    tables.publish("peers", "Beside other packages", "a table\n")
    first, *others = (tmp_path / "bench/peers.md").read_text().splitlines()
    assert re.fullmatch(
        r"# Beside other packages: commit (unknown|[0-9a-f]{7,})(, changed)?", first
    )
    assert others[-1] == "a table"


def test_peers_get_the_same_numpy_and_scipy(repository):
    locked = (repository / "locks/users.lock").read_text()
    for line in (repository / "bench/requirements.txt").read_text().splitlines()[1:5]:
        assert re.search(rf"^{re.escape(line)}\b", locked, re.M), line


def test_peers_are_given_the_log_that_was_made(tmp_path):
    _, axes = still_log(1, 1000)
    write_mcap(tmp_path / "log.mcap", axes[:3], axes[3:])
    assert np.array_equal(read(tmp_path / "log.mcap")[[*CHANNELS]].T, axes)
