"""Pictures: the same each time, in the colours of the page, with the numbers behind them."""

import numpy as np

from imuloop.report.figures.drawing import BLUE, Picture
from imuloop.report.figures.time_series import extremes


def one(name="a.x", label="b", caption="c", **numbers):
    """Return a picture of a line, with a text that is its label too."""

    def plot(area):
        area.loglog([1e-3, 1e5], [1, 10], color=BLUE, label=label)
        area.text(1, 2, label)

    return Picture(name, "Line", caption, plot, numbers)


def test_other_peoples_text_stays_text():
    label = "<script>$x_2$ & b</script>"
    svg = one(label=label, caption='"><script>').inline
    assert "<script" not in svg and svg.count("&lt;script&gt;$x_2$ &amp; b&lt;/script&gt;") == 2


def test_the_numbers_of_a_picture_with_a_text_that_a_spreadsheet_would_run(tmp_path):
    one("a.b", session=["-poses", "rest"], x=[-1.0, np.nan]).write(tmp_path)
    assert (tmp_path / "b.csv").read_text() == '"session","x"\n"\'-poses",-1\n"rest",\n'
    assert (tmp_path / "b.svg").read_text().startswith("<?xml")


def test_decimation_keeps_every_peak_and_at_most_2000_points():
    x = np.random.default_rng(0).normal(size=720_000)
    x[[17, 400_001, 719_999]] = 50, -60, 70
    chosen = extremes(x)
    assert len(chosen) <= 2000 and {17, 400_001, 719_999} <= set(chosen)
