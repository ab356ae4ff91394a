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


# names of the program on Debian and elsewhere
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SIZE = {"width": 1440, "height": 900}


@pytest.fixture(scope="session")
def browser():
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip("no Chromium at hand: .ci/browser installs it")
    with api.sync_playwright() as playwright:
        blind = ["--host-resolver-rules=MAP * ~NOTFOUND"]
        started = playwright.chromium.launch(executable_path=program, args=blind)
        yield started
        started.close()


@pytest.fixture
def opened(browser):
    """Return a function that opens a page and keeps what it asks for and what goes wrong."""
    contexts = []

    def open_page(path, **settings):
        contexts.append(browser.new_context(viewport=SIZE, **settings))
        page = contexts[-1].new_page()
        page.asked, page.wrong = [], []
        page.on("request", lambda request: page.asked.append(request.url))
        for event in ("pageerror", "console"):
            page.on(event, lambda found: page.wrong.append(found))
        page.goto(path.absolute().as_uri())
        return page

    yield open_page
    for context in contexts:
        context.close()
