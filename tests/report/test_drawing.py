"""Pictures: what they carry into the page, and what lines keep of the data."""

import re

import numpy as np
import pytest

from imuloop.report.figures.drawing import BLUE, Picture, entitle, write_csv
from imuloop.report.figures.time_series import BUCKETS, extremes


def one(name="a", label="b", caption="c"):
    """Return a picture of a line and a mark with a title, the label on it and in the key."""

    def plot(area):
        area.loglog([1e-3, 1e5], [1, 10], color=BLUE, label=label)
        (marks,) = area.plot([1], [2], "o")
        entitle(area, marks, [label])
        area.text(1, 2, label)

    return Picture(name, "Line", caption, plot)


def test_a_picture_is_the_same_each_time_and_its_ids_are_its_own():
    first, again, other = one("a.x"), one("a.x"), one("b.x")
    assert first.inline == again.inline
    ids = [set(re.findall(r' id="([^"]+)"', p.inline)) for p in (first, other)]
    assert ids[0] and not ids[0] & ids[1]
    for p, known in zip((first, other), ids, strict=True):
        assert set(re.findall(r'(?:href="|url\()#([^")]+)', p.inline)) == known


def test_other_peoples_text_stays_text():
    label = "<script>$x_2$ & b</script>"
    svg = one(label=label, caption='"><script>').inline
    assert "<script" not in svg
    # on the picture, in the key and in the title of its mark
    assert svg.count("&lt;script&gt;$x_2$ &amp; b&lt;/script&gt;") == 3
    assert 'aria-label="Line. &#34;&gt;&lt;script&gt;"' in svg


def test_a_picture_takes_its_colours_from_the_page_and_names_no_host():
    svg = one().inline
    assert "currentColor" in svg and "var(--c0)" in svg and "var(--grid)" in svg
    assert not re.search(r"#[0-9a-f]{6}\b", svg)
    assert "src=" not in svg and "<style" not in svg
    assert ">10⁴</text>" in svg and ">0.01</text>" in svg


@pytest.mark.parametrize(
    ("low", "high"),
    [(1, 1.0000001), (1.1, 1.9), (2.1e-6, 4.9e-6), (2e-6, 3e-5), (1e-9, 1e3), (0.01, 1000)],
)
def test_a_logarithmic_axis_has_two_numbers_or_more(low, high):
    def plot(area):
        area.semilogy([0, 1], [low, high])
        area.set_xticks([])
        area.set_ylim(low, high)

    texts = re.findall(r">([^<]+)</text>", Picture("a", "b", "c", plot).svg)
    assert len(set(texts)) == len(texts) >= 2


def test_the_numbers_of_a_picture_with_a_text_that_a_spreadsheet_would_run(tmp_path):
    columns = {"session": ["-poses", "rest"], "x": [-1.0, np.nan]}
    assert write_csv(tmp_path, "a", columns).endswith("a.csv")
    assert (tmp_path / "a.csv").read_text() == '"session","x"\n"\'-poses",-1\n"rest",\n'


def test_decimation_keeps_every_peak_and_at_most_2000_points():
    x = np.random.default_rng(0).normal(size=720_000)
    x[[17, 400_001, 719_999]] = 50, -60, 70
    chosen = extremes(x)
    assert len(chosen) <= 2000
    assert {17, 400_001, 719_999} <= set(chosen)
    # the envelope of each stretch is that of the samples themselves
    for stretch in np.array_split(np.arange(len(x)), BUCKETS)[::50]:
        inside = chosen[(chosen >= stretch[0]) & (chosen <= stretch[-1])]
        assert x[inside].max() == pytest.approx(x[stretch].max())
