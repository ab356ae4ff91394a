"""What bench compares with: the peers' environment."""

import re


def test_peers_get_the_same_numpy_and_scipy(repository):
    locked = (repository / "locks/users.lock").read_text()
    for line in (repository / "bench/requirements.txt").read_text().splitlines()[1:5]:
        assert re.search(rf"^{re.escape(line)}\b", locked, re.M), line
