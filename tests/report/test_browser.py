"""The report in a real browser, screenshots in build/screenshots; skipped where there is none."""

import re

import pytest

from report.conftest import Tab

TABLE = "table.comparison >> nth=0"
BIAS = 3


@pytest.fixture
def page(tab, results):
    return tab.open(results / "report.html")


def test_it_opens_without_an_error_and_asks_no_host(page, tab):
    assert not tab.wrong
    assert tab.asked and all(url.startswith(("file:", "data:")) for url in tab.asked)


def test_only_its_own_script_runs(page):
    page.evaluate(
        "() => { const s = document.createElement('script'); s.textContent = 'window.ran = 1';"
        " document.body.append(s); document.body.insertAdjacentHTML('beforeend',"
        " '<p id=trap onclick=\"window.ran = 2\">'); document.getElementById('trap').click(); }"
    )
    assert page.evaluate("window.ran === undefined")


def sizes(table, column):
    cells = table.locator(f"tbody tr > :nth-child({column + 1})")
    return cells.evaluate_all(
        "cells => cells.map(c => 'value' in c.dataset ? parseFloat(c.dataset.value) : null)"
    )


def in_order(values, reverse=False):
    known = sorted((v for v in values if v is not None), reverse=reverse)
    return known + [None] * (len(values) - len(known))


def test_tables_sort_by_a_click(page):
    table = page.locator(TABLE)
    before = sizes(table, BIAS)
    heads = table.locator("thead th")
    for direction, reverse in (("ascending", False), ("descending", True)):
        heads.nth(BIAS).locator("button").click()
        assert heads.nth(BIAS).get_attribute("aria-sort") == direction
        assert sizes(table, BIAS) == in_order(before, reverse)
    assert len(set(before)) > 1
    # by name; only one column is marked
    heads.nth(0).locator("button").click()
    names = table.locator("tbody th").all_inner_texts()
    assert names == page.evaluate("names => names.sort((a, b) => a.localeCompare(b, 'en'))", names)
    assert table.locator("[aria-sort]").count() == 1


def test_colours_follow_the_system(page):
    found = []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        text, ground = (
            page.locator(selector).first.evaluate(f"e => getComputedStyle(e).{what}")
            for selector, what in (("figure svg text", "fill"), ("body", "backgroundColor"))
        )
        found.append((text, ground))
    # text of the page and of its figures, and the ground behind both
    assert found == [
        ("rgb(27, 31, 36)", "rgb(255, 255, 255)"),
        ("rgb(228, 232, 236)", "rgb(20, 24, 29)"),
    ]


def pages(page):
    page.emulate_media(media="print")
    return len(re.findall(rb"/Type\s*/Page\b", page.pdf(prefer_css_page_size=True)))


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


@pytest.mark.parametrize("scripts", [True, False])
def test_an_address_opens_its_part_and_print_has_all_of_them(browser, results, scripts):
    """Protects readers from headings of closed sections, on paper too."""
    tab = Tab(browser, java_script_enabled=scripts)
    page = tab.open(results / "report.html")
    page.goto(f"{(results / 'report.html').as_uri()}#board.noise")
    assert page.locator("[id='board.noise']").is_visible()
    page = tab.open(results / "nothing/report.html")
    found, closed = pages(page), page.locator("details:not([open])")
    assert closed.count() > 2
    closed.evaluate_all("all => all.forEach(each => each.open = true)")
    assert found == pages(page)
    tab.context.close()


@pytest.mark.parametrize("width", [375, 1440])
def test_the_page_is_as_wide_as_the_window(page, width, repository):
    page.set_viewport_size({"width": width, "height": 900})
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.screenshot(path=repository / f"build/screenshots/report_{width}.png")
