"""A headless Chromium of the system, for tests that look at pages as a reader does."""

import shutil

import pytest

# names of the program on Debian and elsewhere
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")


@pytest.fixture(scope="module")
def browser():
    """Start a browser that finds no host."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip("no Chromium at hand: .ci/browser installs it")
    with api.sync_playwright() as playwright:
        blind = ["--host-resolver-rules=MAP * ~NOTFOUND"]
        started = playwright.chromium.launch(executable_path=program, args=blind)
        yield started
        started.close()
