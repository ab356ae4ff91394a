"""The report that the tests of the page share, and the results that it is made of."""

import shutil

import pytest

from report.build import build


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Return a results folder with its report; nobody writes into it."""
    return build(tmp_path_factory.mktemp("report") / "results")


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


class Tab:
    """A tab of the browser: opens pages, keeps what they ask for and what goes wrong in them."""

    def __init__(self, browser, **settings):
        self.context = browser.new_context(viewport=SIZE, **settings)
        self.page, self.asked, self.wrong = self.context.new_page(), [], []
        self.page.on("request", lambda request: self.asked.append(request.url))
        for event in ("pageerror", "console"):
            self.page.on(event, lambda message: self.wrong.append(message))

    def open(self, path):
        """Open a page as at first, whatever was done to the last one."""
        self.page.set_viewport_size(SIZE)
        self.page.emulate_media(media="screen", color_scheme="light")
        self.asked.clear()
        self.wrong.clear()
        self.page.goto(path.absolute().as_uri())
        return self.page


@pytest.fixture(scope="module")
def tab(browser):
    opened = Tab(browser)
    yield opened
    opened.context.close()
