"""The report that the tests of the page share."""

import pytest

from report.build import build


@pytest.fixture(scope="session")
def results(tmp_path_factory, repository):
    """Return a results folder with its report; nobody writes into it."""
    return build(tmp_path_factory.mktemp("report") / "results", repository)
