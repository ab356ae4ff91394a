"""The report in a real browser, screenshots in build/screenshots; skipped where there is none."""

import base64
import json

import pytest

from report.browser import Browser, program

# where .ci/browser puts the accessibility checker
AXE = "build/axe/**/axe.min.js"
# the report of `make report`, where it was made
FINISHED = "results/report.html"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    path = program()
    if path is None:
        pytest.skip("no Chromium at hand: .ci/browser installs it")
    started = Browser(path, tmp_path_factory.mktemp("profile"))
    yield started
    started.close()


def _open(browser, path):
    browser.view(1440, 900)
    browser.open(path)
    return browser


@pytest.fixture
def page(browser, results):
    """The report of the plausible results, one device of each kind."""
    return _open(browser, results / "report.html")


@pytest.fixture(params=["plausible", "finished"])
def either(request, browser, results, repository):
    """That, and the workflow's report; `kind` says which."""
    path = results / "report.html"
    if request.param == "finished":
        path = repository / FINISHED
        style = (repository / "workflow/templates/style.css").read_text()
        if not path.exists() or style not in path.read_text(encoding="utf-8"):
            pytest.skip(f"no {FINISHED} of this version: make report writes it")
    browser.kind = request.param
    return _open(browser, path)


def _shot(repository, page, name):
    return repository / "build/screenshots" / f"{page.kind}_{name}"


def test_it_opens_without_an_error_and_asks_no_host(either):
    page = either
    assert page.run("document.readyState") == "complete"
    assert not page.said("Runtime.exceptionThrown")
    assert not [e for e in page.said("Log.entryAdded") if e["entry"]["level"] == "error"]
    assert not page.said("Runtime.consoleAPICalled")
    asked = [e["request"]["url"] for e in page.said("Network.requestWillBeSent")]
    assert asked and all(url.startswith(("file:", "data:")) for url in asked)


def test_only_its_own_script_runs(page):
    page.run(
        "(() => { const s = document.createElement('script'); s.textContent = 'window.ran = 1';"
        " document.body.append(s); document.body.insertAdjacentHTML('beforeend',"
        " '<p id=trap onclick=\"window.ran = 2\">'); document.getElementById('trap').click(); })()"
    )
    assert page.run("window.ran === undefined")


def test_every_link_of_the_contents_scrolls_to_its_part(either):
    astray = either.run("""(async () => {
      const astray = [];
      for (const link of document.querySelectorAll('nav a, .answers a')) {
        link.click();
        await new Promise(requestAnimationFrame);
        const part = document.getElementById(decodeURIComponent(link.hash.slice(1)));
        const top = part ? part.getBoundingClientRect().top : NaN;
        if (!(top >= -1 && top < innerHeight)) astray.push([link.hash, top]);
      }
      return astray;
    })()""")
    assert astray == []
    assert either.run("document.querySelectorAll('nav a').length") > 10


HEADS = "document.querySelector('table.comparison').tHead.rows[0].cells"
# sizes of a column from top to bottom, those without a number as null
COLUMN = (
    "[...document.querySelector('table.comparison').tBodies[0].rows]"
    ".map(r => r.cells[{0}].dataset.value ?? null).map(v => v === null ? null : parseFloat(v))"
)
BIAS = 3


def _sorted(values, reverse=False):
    known = sorted((v for v in values if v is not None), reverse=reverse)
    return known + [None] * (len(values) - len(known))


def test_tables_sort_by_a_click(page):
    before = page.run(COLUMN.format(BIAS))
    page.click(f"{HEADS}[{BIAS}].querySelector('button')")
    assert page.run(f"{HEADS}[{BIAS}].ariaSort") == "ascending"
    assert page.run(COLUMN.format(BIAS)) == _sorted(before)
    page.click(f"{HEADS}[{BIAS}].querySelector('button')")
    assert page.run(f"{HEADS}[{BIAS}].ariaSort") == "descending"
    assert page.run(COLUMN.format(BIAS)) == _sorted(before, reverse=True)
    assert len(set(before)) > 1
    # by name; only one column is marked
    page.click(f"{HEADS}[0].querySelector('button')")
    names = page.run(
        "[...document.querySelector('table.comparison').tBodies[0].rows]"
        ".map(r => r.cells[0].innerText.trim())"
    )
    order = "(a, b) => a.localeCompare(b, 'en', {numeric: true})"
    assert names == page.run(f"{json.dumps(names)}.sort({order})")
    assert page.run(f"[...{HEADS}].filter(h => h.ariaSort).length") == 1


# a table of a device's part by its caption, and a column of it from top to bottom
TABLE = "[...document.querySelectorAll('table.sortable')].find(t => t.caption.innerText == {0!r})"
CELLS = "[...({0}).tBodies[0].rows].map(r => r.cells[{1}])"


def _column(page, table, column, of):
    return page.run(f"{CELLS.format(table, column)}.map(c => {of})")


def test_tables_of_a_device_sort_by_size_whatever_the_unit(page):
    table = TABLE.format("Accelerometer: parameters, value ± 1 σ")
    names = _column(page, table, 0, "c.innerText.trim()")
    page.click(f"({table}).tHead.rows[0].cells[4].querySelector('button')")
    values = _column(page, table, 4, "c.dataset.value ? parseFloat(c.dataset.value) : null")
    known = [v for v in values if v is not None]
    # %, mrad and mg in one column; what has no size stays last
    assert known == sorted(known) and len(known) >= 9
    assert values[len(known) :] == [None] * (len(values) - len(known))
    assert set(_column(page, table, 1, "c.innerText")) >= {"mg", "%", "mrad"}
    # and by name
    page.click(f"({table}).tHead.rows[0].cells[0].querySelector('button')")
    found = _column(page, table, 0, "c.innerText.trim()")
    assert sorted(found) == sorted(names) and found != names


def test_durations_sort_by_seconds_and_words_do_not_sort(page):
    table = TABLE.format("Stretches found in each session")
    page.click(f"({table}).tHead.rows[0].cells[3].querySelector('button')")
    shown = _column(page, table, 3, "c.innerText")
    seconds = _column(page, table, 3, "parseFloat(c.dataset.value)")
    assert seconds == sorted(seconds) and len(seconds) == 3
    # by their letters these stand in another order
    assert shown != sorted(shown)
    heads = "document.querySelector('table.dense.sortable').tHead.rows[0].cells"
    sorts = page.run(f"[...{heads}].map(h => !!h.querySelector('button'))")
    assert sorts == [True] * 4 + [False] * 3
    assert not page.run("!!document.querySelector('table.grouped thead button')")


@pytest.mark.parametrize("key", ["Enter", " "])
def test_tables_sort_by_the_keyboard(page, key):
    page.run(f"{HEADS}[{BIAS - 1}].querySelector('button').focus()")
    page.press("Tab")
    page.press(key)
    assert page.run(f"{HEADS}[{BIAS}].ariaSort") == "ascending"
    values = page.run(COLUMN.format(BIAS))
    assert values == _sorted(values)


def test_without_javascript_the_tables_stand_as_they_are(browser, results):
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        page = _open(browser, results / "report.html")
        root = page.call("DOM.getDocument")["root"]["nodeId"]

        def found(selector):
            return page.call("DOM.querySelectorAll", nodeId=root, selector=selector)["nodeIds"]

        assert found("table.sortable") and found("nav a") and found("figure svg")
        assert not found("thead button")
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)


@pytest.mark.parametrize("width", [375, 1440])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_is_as_wide_as_the_window(either, repository, width, scheme):
    page = either
    page.view(width, 812 if width < 600 else 900, scheme=scheme)
    page.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert page.run("innerWidth") == width
    assert page.run("document.documentElement.scrollWidth") <= width
    page.run("document.querySelectorAll('details').forEach(d => d.open = false)")
    for name in ("top", "numbers", "filter", "curves", "parameters"):
        page.run(f"(document.getElementById('{name}') ?? document.body).scrollIntoView()")
        page.screenshot(_shot(repository, page, f"{width}_{scheme}_{name}.png"))


def test_the_comparison_needs_no_scrolling_at_1440(either):
    wide = either.run(
        "[...document.querySelectorAll('#comparison .scroll:has(table)')]"
        ".map(e => [e.scrollWidth, e.clientWidth])"
    )
    assert len(wide) == 3
    assert all(needed <= given for needed, given in wide)


def test_colours_follow_the_system(page):
    ground = {}
    for scheme in ("light", "dark"):
        page.view(1440, 900, scheme=scheme)
        ground[scheme] = page.run("getComputedStyle(document.body).backgroundColor")
    assert ground == {"light": "rgb(255, 255, 255)", "dark": "rgb(20, 24, 29)"}


def test_print_is_on_white_without_contents(either, repository):
    page = either
    page.view(1440, 900, media="print", scheme="dark")
    assert page.run("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.run("getComputedStyle(document.querySelector('nav')).display") == "none"
    pdf = base64.b64decode(page.call("Page.printToPDF")["data"])
    assert pdf.startswith(b"%PDF") and len(pdf) > 50_000
    path = _shot(repository, page, "print.pdf")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pdf)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(either, repository, scheme):
    code = next(iter(sorted(repository.glob(AXE))), None)
    if code is None:
        pytest.skip(f"no {AXE}: .ci/browser fetches axe-core")
    either.view(1440, 900, scheme=scheme)
    # what is inside a picture is one image by its role; thousands of elements need no visit
    either.run("document.querySelectorAll('figure svg').forEach(s => s.replaceChildren())")
    either.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    either.run(code.read_text(encoding="utf-8") + "; true")
    # what is not a colour does not change with the scheme
    only = ["color-contrast", "link-in-text-block"] if scheme == "dark" else None
    options = json.dumps({"resultTypes": ["violations"], **({"runOnly": only} if only else {})})
    passed, found = json.loads(
        either.run(
            f"axe.run(document, {options}).then(r => JSON.stringify([r.passes.length, "
            "r.violations.map(v => [v.impact, v.id, v.nodes.slice(0, 5).map(n => n.html)])]))"
        )
    )
    assert passed >= (1 if only else 20)
    assert not [v for v in found if v[0] in ("serious", "critical")]
