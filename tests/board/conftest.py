"""Simulated boards that the tests of the folder share."""

from functools import cache

import pytest

from board.boards import calibrated, logs


@pytest.fixture(scope="session")
def board(tmp_path_factory):
    """Return a function: raw logs of a board by its seed, and its calibrated devices, made once."""

    @cache
    def of(seed):
        made = logs(seed)
        return made, calibrated(tmp_path_factory.mktemp("wing"), made)

    return of
