"""The report in a real browser, screenshots in build/screenshots; skipped where there is none."""

import json
import re
from itertools import product

import numpy as np
import pandas as pd
import pytest

from report.conftest import SIZE, Tab

# where .ci/browser puts the accessibility checker
AXE = "build/axe/**/axe.min.js"
# the report of `make report`, where it was made
FINISHED = "results/report.html"
TABLE = "table.comparison >> nth=0"
BIAS = 3


@pytest.fixture
def page(tab, results):
    return tab.open(results / "report.html")


@pytest.fixture(scope="module", params=["plausible", "finished"])
def either(request, browser, results, repository):
    """A tab with that, and one with the workflow's report, which no test changes."""
    path = results / "report.html"
    if request.param == "finished":
        path = repository / FINISHED
        style = (repository / "workflow/templates/style.css").read_text()
        if not path.exists() or style not in path.read_text(encoding="utf-8"):
            pytest.skip(f"no {FINISHED} of this version: make report writes it")
    tab = Tab(browser)
    tab.open(path)
    tab.shots = repository / "build/screenshots" / request.param
    yield tab
    tab.context.close()


def test_every_link_of_the_contents_scrolls_to_its_part(either):
    astray = either.page.evaluate("""async () => {
      const astray = [];
      for (const link of document.querySelectorAll('nav a, .cards a[href^="#"]')) {
        link.click();
        await new Promise(requestAnimationFrame);
        const part = document.getElementById(decodeURIComponent(link.hash.slice(1)));
        const top = part ? part.getBoundingClientRect().top : NaN;
        if (!(top >= -1 && top < innerHeight)) astray.push([link.hash, top]);
      }
      return astray;
    }""")
    assert astray == []
    assert either.page.locator("nav a").count() > 10


def test_the_comparison_needs_no_scrolling_at_1440(either):
    wide = either.page.locator("#comparison .scroll:has(table)").evaluate_all(
        "all => all.map(e => [e.scrollWidth, e.clientWidth])"
    )
    assert len(wide) == 3
    assert all(needed <= given for needed, given in wide)


def test_the_page_is_as_wide_as_the_window(either):
    page, every = either.page, "document.querySelectorAll('details').forEach(d => d.open = {})"
    for width, scheme in product((375, 1440), ("light", "dark")):
        page.set_viewport_size({"width": width, "height": 900})
        page.emulate_media(color_scheme=scheme)
        page.evaluate(every.format("true"))
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.evaluate(every.format("false"))
        for name in ("main", "filter", "curves"):
            page.evaluate(f"document.getElementById('{name}').scrollIntoView()")
            page.screenshot(path=f"{either.shots}_{width}_{scheme}_{name}.png")


# size on the screen of every text of the first part, pictures too, px
TEXTS = """() => {
  const sizes = [], walk = document.createTreeWalker(
    document.getElementById('comparison'), NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const e = walk.currentNode.parentElement;
    if (!walk.currentNode.data.trim() || !e.getClientRects().length) continue;
    if (e.closest('svg') && !e.closest('.cards')) continue;
    const scale = e.getScreenCTM ? e.getScreenCTM().a : 1;
    sizes.push(scale * parseFloat(getComputedStyle(e).fontSize));
  }
  return sizes;
}"""


@pytest.mark.parametrize("width", [390, 1440])
def test_what_is_read_first_is_in_12_px_or_more(either, width):
    either.page.set_viewport_size({"width": width, "height": 900})
    sizes = either.page.evaluate(TEXTS)
    assert len(sizes) > 100 and min(sizes) > 11.95


def test_it_opens_without_an_error_and_asks_no_host(either):
    assert not either.wrong
    assert either.asked and all(url.startswith(("file:", "data:")) for url in either.asked)


def test_the_contents_follow_the_reader(page):
    for link in page.locator("nav ul ul a").all()[:8:3]:
        link.click()
        page.wait_for_function("a => a.hasAttribute('aria-current')", arg=link.element_handle())
        assert page.locator("nav [aria-current]").count() == 1


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


def test_tables_sort_by_the_keyboard(page):
    table = page.locator(TABLE)
    table.locator("thead button").nth(BIAS - 1).focus()
    page.keyboard.press("Tab")
    for key, direction in (("Enter", "ascending"), (" ", "descending")):
        page.keyboard.press(key)
        assert sizes(table, BIAS) == in_order(sizes(table, BIAS), direction == "descending")
        assert table.locator("thead th").nth(BIAS).get_attribute("aria-sort") == direction


def table_of(page, caption):
    named = page.locator("caption", has_text=caption)
    return page.locator("table.sortable").filter(has=named).first


def test_tables_of_a_device_sort_by_size_whatever_the_unit(page):
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    table = table_of(page, "Accelerometer: parameters, value ± 1 σ")
    table.locator("thead button").nth(3).click()
    values = sizes(table, 3)
    # %, mrad and mg in one column; what has no size stays last
    assert values == in_order(values) and sum(v is not None for v in values) >= 9
    units = set(table.locator("tbody td:nth-child(2)").all_inner_texts())
    assert units >= {"mg", "%", "mrad"}


@pytest.fixture
def curves(page):
    """The Allan deviation of a gyroscope, unfolded, with its tools."""
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    region = page.get_by_role("region", name="board.long.allan_gyroscope", exact=True)
    figure = page.locator("figure").filter(has=region)
    figure.get_by_role("button", name="Zoom").press("Enter")
    return figure


def labels(figure):
    seen = "all => all.filter(e => e.getClientRects().length).map(e => e.textContent)"
    return figure.locator("[data-axis] > g:has(path) text").evaluate_all(seen)


def test_a_stretch_that_is_dragged_over_fills_the_picture(page, curves):
    whole = labels(curves)
    box = curves.locator("svg svg").nth(1).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + box["width"] / 4, y, steps=3)
    page.mouse.up()
    view, tau = curves.locator("svg svg"), curves.locator("[data-axis=x] >> nth=0").locator(".tick")
    shares = view.evaluate_all(
        "all => all.map(e => e.viewBox.baseVal.width / e.width.baseVal.value)"
    )
    assert shares == pytest.approx([0.25] * 3, abs=0.01)
    # of a logarithmic axis the third quarter of its decades
    low, high = map(
        float, curves.locator("[data-area]").first.get_attribute("data-area").split()[1:3]
    )
    shown = [float(text) for text in tau.locator("text").all_text_contents()]
    ends = [low * (high / low) ** share for share in (0.49, 0.76)]
    assert len(shown) >= 2 and ends[0] < min(shown) < max(shown) < ends[1]
    # what was drawn stays in its frame
    assert view.first.evaluate("e => getComputedStyle(e).overflow") == "hidden"
    assert labels(curves) != whole
    page.mouse.dblclick(x, y)
    assert labels(curves) == whole
    # what begins outside is no stretch
    page.mouse.move(x, box["y"] + box["height"] + 40)
    page.mouse.down()
    page.mouse.move(x, y, steps=3)
    page.mouse.up()
    assert labels(curves) == whole


def test_values_stand_at_the_pointer_before_anything_is_clicked(page):
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    region = page.get_by_role("region", name="board.long.allan_gyroscope", exact=True)
    figure = page.locator("figure").filter(has=region)
    assert not figure.locator(".tools").is_visible()
    before = labels(figure)
    region.scroll_into_view_if_needed()
    box = region.locator("svg").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 5, box["y"] + box["height"] / 2)
    page.mouse.move(box["x"] + box["width"] / 4, box["y"] + box["height"] / 2)
    assert "Allan deviation, °/h: " in figure.locator("output").inner_text()
    assert not figure.get_by_label("from").is_visible() and labels(figure) == before
    page.mouse.move(0, 0)
    assert not figure.locator("output").is_visible()


def test_values_at_the_cursor_are_those_of_the_file(page, curves, results):
    table = pd.read_csv(results / "board/figures/long_allan.csv").query("stage == 'raw'")
    slider = curves.get_by_label("values at")
    for share in ("0", "0.31", "0.8"):
        slider.fill(share)
        for line, (channel, rows) in zip(
            curves.locator("output").inner_text().splitlines(),
            table[table["axis"].str.startswith("g")].groupby("axis"),
            strict=True,
        ):
            assert line.startswith(f"{channel[1]}: averaging time")
            tau = number(re.search(r"τ, s (\S+)\. ", line)[1])
            near = rows.loc[(np.log(rows["tau_s"] / tau)).abs().idxmin(), "adev"]
            # in °/h, as the tables
            near *= np.degrees(1) * 3600
            found = number(re.search(r"95 % band (\S+),", line)[1])
            assert found == pytest.approx(near, rel=5e-3)


def number(text):
    size, _, power = text.replace("−", "-").partition("·10")
    return float(size) * 10 ** float(
        power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 0
    )


def test_a_curve_comes_and_goes_with_its_band(curves):
    box = curves.get_by_label("measured, 95 % band")
    marks = curves.locator("[data-curve='measured, 95 % band']")
    assert marks.count() == 6
    for visible in (False, True):
        # by the keyboard
        box.press(" ")
        assert box.is_checked() == visible == marks.first.is_visible()
        assert ("measured" in curves.locator("output").inner_text()) == visible


def test_the_keyboard_zooms_and_print_is_of_the_whole(page, curves):
    whole, start = labels(curves), curves.get_by_label("from")
    for _ in range(4):
        start.press("PageUp")
    assert float(start.input_value()) > 0.2 and labels(curves) != whole
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert labels(curves) == whole and not curves.locator(".tools").is_visible()


def test_every_picture_of_curves_has_its_tools(page, tab):
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    unfolded = page.locator("figure button").evaluate_all(
        "all => all.map(b => { b.click(); return b.getAttribute('aria-expanded'); })"
    )
    assert len(unfolded) >= 12 and set(unfolded) == {"true"}
    assert not tab.wrong
    for text in page.locator(".tools output").all_inner_texts():
        assert re.search(r"\d", text) and "NaN" not in text


def test_without_javascript_the_tables_stand_as_they_are(browser, results):
    tab = Tab(browser, java_script_enabled=False)
    page = tab.open(results / "report.html")
    for selector in ("table.sortable", "nav a", "figure svg"):
        assert page.locator(selector).count()
    assert not page.locator("button").count()
    tab.context.close()


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


def test_print_is_on_white_without_contents(page):
    page.emulate_media(media="print", color_scheme="dark")
    ground = "getComputedStyle(document.body).backgroundColor"
    assert page.evaluate(ground) == "rgb(255, 255, 255)"
    assert not page.locator("nav").is_visible()


def pages(page):
    page.emulate_media(media="print")
    return len(re.findall(rb"/Type\s*/Page\b", page.pdf(prefer_css_page_size=True)))


@pytest.mark.parametrize("scripts", [True, False])
def test_print_holds_every_section_whole(browser, results, scripts):
    """Protects readers on paper from empty headings where a section was closed."""
    tab = Tab(browser, java_script_enabled=scripts)
    page = tab.open(results / "board/report.html")
    found, closed = pages(page), page.locator("details:not([open])")
    assert closed.count() > 5
    closed.evaluate_all("all => all.forEach(each => each.open = true)")
    assert found == pages(page) > 4
    tab.context.close()


@pytest.mark.parametrize(
    ("by", "scripts"),
    [(by, True) for by in ("click", "keyboard", "address")]
    + [("click", False), ("address", False)],
)
def test_what_a_link_leads_to_is_open(browser, results, by, scripts):
    """Protects readers from contents that lead to a closed section."""
    tab = Tab(browser, java_script_enabled=scripts)
    page = tab.open(results / "report.html")
    for target in ("board.noise", "method", "partly.data"):
        link = page.locator(f"a[href='#{target}']").first
        if by == "click":
            link.click()
        elif by == "keyboard":
            link.press("Enter")
        else:
            page.goto("about:blank")
            page.goto(f"{(results / 'report.html').as_uri()}#{target}")
        around = page.locator(f"details:has([id='{target}'])")
        assert around.count() and around.evaluate_all("all => all.every(each => each.open)")
        assert 0 <= page.locator(f"[id='{target}']").bounding_box()["y"] < SIZE["height"] / 2
    tab.context.close()


# leaves one text of each colour on each ground, size and weight, the others empty
ONE_OF_EACH = """() => {
  const seen = new Set(), walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const look = [];
    for (let e = walk.currentNode.parentElement; e; e = e.parentElement) {
      const style = getComputedStyle(e);
      if (!look.length) look.push(e.localName, style.color, style.fontSize, style.fontWeight);
      look.push(style.backgroundColor, style.backgroundImage, style.opacity);
    }
    if (seen.has(look.join())) walk.currentNode.data = '';
    seen.add(look.join());
  }
  return seen.size;
}"""


# the workflow's own page has thousands of elements, of the same templates
def test_axe_finds_nothing_serious(page, repository):
    code = next(iter(sorted(repository.glob(AXE))), None)
    if code is None:
        pytest.skip(f"no {AXE}: .ci/browser fetches axe-core")

    def check(least, **options):
        passed, found = page.evaluate(
            f"axe.run(document, {json.dumps({'resultTypes': ['violations'], **options})})"
            ".then(r => [r.passes.length, "
            "r.violations.map(v => [v.impact, v.id, v.nodes.slice(0, 5).map(n => n.html)])])"
        )
        assert passed >= least
        assert not [v for v in found if v[0] in ("serious", "critical")]

    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    page.locator("figure button").first.click()
    # what is inside a picture is one image by its role; thousands of elements need no visit
    page.evaluate("document.querySelectorAll('figure svg').forEach(s => s.replaceChildren())")
    page.evaluate(code.read_text(encoding="utf-8") + "; true")
    colours = ["color-contrast", "link-in-text-block"]
    check(20, rules={name: {"enabled": False} for name in colours})
    assert page.evaluate(ONE_OF_EACH) > 20
    # what is not a colour does not change with the scheme
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        check(1, runOnly=colours)
