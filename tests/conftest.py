"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# the same examples in every run; a shared machine's speed is no property of the code
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# many small matrices: threads of the linear algebra library only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def repository():
    """Top folder of the project."""
    return REPOSITORY


@pytest.fixture(scope="session")
def recordings():
    """Folder with the measured recordings, or a skip that says what is missing."""
    for folder in (os.environ.get("IMULOOP_MIRROR"), REPOSITORY.parent / "shared" / "data"):
        if folder and Path(folder).is_dir():
            return Path(folder)
    pytest.skip("measured recordings not at hand: set IMULOOP_MIRROR to the folder that holds them")
