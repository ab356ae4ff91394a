"""The report that the tests of the page share, and the results that it is made of."""

import shutil

import pytest

from imuloop.report.results import read_device
from report.build import build
from report.plausible_results import DEVICES


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Return a results folder with its report; nobody writes into it."""
    return build(tmp_path_factory.mktemp("report") / "results")


@pytest.fixture(scope="session")
def devices(results, tmp_path_factory):
    """Return the devices as the report reads them, of a copy, as figures write their numbers."""
    folder = shutil.copytree(results, tmp_path_factory.mktemp("devices") / "results")
    return {n: read_device(n, label, folder / n, kinds) for n, (label, kinds) in DEVICES.items()}
