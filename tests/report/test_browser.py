"""The report in a real browser; skipped where there is none."""

import re

import pytest

from report.conftest import Tab

# of the package axe-playwright-python, by .ci/browser
AXE = "build/axe/axe_playwright_python/axe.min.js"


@pytest.fixture
def page(tab, results):
    return tab.open(results / "report.html")


def test_it_opens_without_an_error_asks_no_host_and_runs_only_its_own_script(page, tab):
    assert not tab.wrong
    assert tab.asked and all(url.startswith(("file:", "data:")) for url in tab.asked)
    page.evaluate(
        "() => { const s = document.createElement('script'); s.textContent = 'window.ran = 1';"
        " document.body.append(s); document.body.insertAdjacentHTML('beforeend',"
        " '<p id=trap onclick=\"window.ran = 2\">'); document.getElementById('trap').click(); }"
    )
    assert page.evaluate("window.ran === undefined")


def test_axe_finds_no_violation(browser, results, repository):
    script = repository / AXE
    if not script.is_file():
        pytest.skip("axe is not at hand: .ci/browser fetches it")
    # the page allows no other script
    tab = Tab(browser, bypass_csp=True)
    page = tab.open(results / "report.html")
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    page.add_script_tag(path=script)
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        violations = page.evaluate(
            "axe.run().then(r => r.violations.map(v => [v.id, v.nodes[0].html]))"
        )
        assert violations == []
    tab.context.close()


def test_tables_sort_by_a_click(page):
    table = page.locator("table.comparison >> nth=0")

    def sizes():
        cells = table.locator("tbody tr > :nth-child(4)")
        values = cells.evaluate_all("cells => cells.map(c => c.dataset.value)")
        return [float(value) if value else None for value in values]

    before, head = sizes(), table.locator("thead th").nth(3)
    for direction, reverse in (("ascending", False), ("descending", True)):
        head.locator("button").click()
        assert head.get_attribute("aria-sort") == direction
        expected = sorted((v for v in before if v is not None), reverse=reverse)
        assert sizes() == expected + [None] * (len(before) - len(expected))
    assert len(set(before)) > 1 and table.locator("[aria-sort]").count() == 1


def test_every_link_of_the_contents_opens_its_part_and_scrolls_there(page):
    astray = page.evaluate("""async () => {
      const astray = [];
      for (const link of document.querySelectorAll('nav a, .cards a[href^="#"]')) {
        link.click();
        await new Promise(requestAnimationFrame);
        const part = document.getElementById(decodeURIComponent(link.hash.slice(1)));
        const top = part && part.checkVisibility() ? part.getBoundingClientRect().top : NaN;
        if (!(top >= -1 && top < innerHeight)) astray.push([link.hash, top]);
      }
      return astray;
    }""")
    assert astray == []
    assert page.locator("nav a").count() > 10


def pages(page):
    page.emulate_media(media="print")
    return len(re.findall(rb"/Type\s*/Page\b", page.pdf(prefer_css_page_size=True)))


@pytest.mark.parametrize("scripts", [True, False])
def test_an_address_opens_its_part_and_print_has_what_is_open(browser, results, scripts):
    tab = Tab(browser, java_script_enabled=scripts)
    page = tab.open(results / "report.html")
    page.goto(f"{(results / 'report.html').as_uri()}#board.noise")
    assert page.locator("[id='board.noise']").is_visible()
    page = tab.open(results / "board/report.html")
    count, closed = pages(page), page.locator("details:not([open])")
    assert count <= 3 and closed.count() > 2
    closed.evaluate_all("all => all.forEach(each => each.open = true)")
    assert pages(page) > count
    tab.context.close()


def test_the_page_is_as_wide_as_the_window(page):
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    for width in (390, 1440):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
