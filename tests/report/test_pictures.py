"""Pictures: what they keep of the data, and what they carry into the page."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imuloop.report.axes import Axes
from imuloop.report.paths import polyline
from imuloop.report.pose_plot import direction_words, largest_hole
from imuloop.report.smoothing import smoothed
from imuloop.report.svg import BLUE, draw
from imuloop.report.ticks import decade_ticks, linear_ticks
from imuloop.report.time_series import SMOOTH_BUCKETS, extremes, trend


def test_decimation_keeps_every_peak_and_at_most_2000_points():
    x = np.random.default_rng(0).normal(size=720_000)
    x[[17, 400_001, 719_999]] = 50, -60, 70
    chosen = extremes(x)
    assert len(chosen) <= 2000
    assert (np.diff(chosen) > 0).all()
    assert {17, 400_001, 719_999} <= set(chosen)
    # the envelope of each stretch is that of the samples themselves
    for stretch in np.array_split(np.arange(len(x)), 240)[::50]:
        inside = chosen[(chosen >= stretch[0]) & (chosen <= stretch[-1])]
        assert x[inside].max() == pytest.approx(x[stretch].max())


@pytest.mark.parametrize("n", [0, 1, 479, 480, 481, 1234])
def test_decimation_of_short_series(n):
    x = np.arange(float(n))
    chosen = extremes(x)
    assert len(chosen) == n if n <= 480 else len(chosen) <= 480
    assert n == 0 or (chosen[0] == 0 and chosen[-1] == n - 1)


def test_smoothing_takes_noise_away_and_leaves_a_step_and_a_slope():
    rng = np.random.default_rng(5)
    t = np.arange(8192) / 8192
    true = 3.0 * (t > 0.37) + 2 * t
    left = smoothed(true + rng.normal(size=len(t))) - true
    away = np.abs(t - 0.37) > 0.02
    # white noise of 1
    assert np.sqrt(np.mean(left[away][64:-64] ** 2)) < 0.15
    assert smoothed(true[:20]) == pytest.approx(true[:20])


def test_noise_alone_leaves_no_wave():
    noise = np.random.default_rng(6).normal(size=4096)
    assert np.ptp(smoothed(noise)) < 0.15 * np.ptp(noise)


def test_a_trend_is_that_of_each_stretch_and_has_few_points():
    t = np.arange(200_000.0)
    x = np.where(t > 1.2e5, 8.0, 0.0) + np.random.default_rng(7).normal(size=len(t))
    x[100_000:100_200] += 50
    at, values = trend(t, x, [(0, 100_000), (100_200, 200_000), (5, 20)])
    assert len(at) <= 2 * SMOOTH_BUCKETS + 4
    known = values[np.isfinite(values)]
    # neither the knock, nor anything between the two levels
    assert known.max() < 9 and np.abs(known - 4).min() > 3
    assert np.isnan(values[(at > 1e5) & (at < 100_200)]).all()


def test_largest_hole_of_six_faces_is_a_corner_of_the_cube():
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    hole, angle = largest_hole(faces)
    assert np.degrees(angle) == pytest.approx(np.degrees(np.arccos(3**-0.5)), abs=2)
    assert np.abs(hole) == pytest.approx(np.full(3, 3**-0.5), abs=0.05)


def test_largest_hole_is_where_a_pose_is_missing():
    faces = np.concatenate([np.eye(3), -np.eye(3)[:2]])
    hole, angle = largest_hole(faces)
    assert hole == pytest.approx([0, 0, -1], abs=0.06)
    assert np.degrees(angle) == pytest.approx(90, abs=3)
    assert direction_words(hole) == "−z"


def test_a_path_leads_through_its_points():
    rng = np.random.default_rng(2)
    points = rng.uniform(-500, 9000, (60, 2))
    points[17] = points[16]
    points[[20, 40]] = np.nan
    found = []
    for start, steps in re.findall(r"M([^Ml]*)l([^M]*)", polyline(*points.T)):
        numbers = np.array(re.findall(r"-?\d+", f"{start} {steps}"), int).reshape(-1, 2)
        found.append(np.cumsum(numbers, axis=0))
    known = np.rint(points[np.isfinite(points[:, 0])])
    # what repeats a place is not drawn again
    assert np.concatenate(found) == pytest.approx(np.delete(known, 17, axis=0))
    assert [len(f) for f in found] == [19, 19, 19]


@pytest.mark.parametrize(
    ("low", "high"), [(0, 1), (-3.2e-7, 8e-7), (9.79, 9.82), (-4e6, 1.3e7), (2, 2.0001), (-170, 5)]
)
def test_marks_of_an_axis_are_round_numbers_that_say_their_place(low, high):
    places, labels, factor = linear_ticks(low, high, 6)
    assert 3 <= len(places) <= 13
    assert all(low <= p <= high for p in places)
    assert len(set(labels)) == len(labels)
    raised = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    scale = 10.0 ** int(factor.removeprefix("×10").translate(raised)) if factor else 1.0
    said = [float(label.replace("−", "-")) * scale for label in labels]
    assert said == pytest.approx(places, abs=1e-9 * (high - low))
    step = (places[1] - places[0]) / 10.0 ** np.floor(np.log10(places[1] - places[0]) + 1e-9)
    assert round(step, 6) in (1, 2, 5)


def test_marks_of_a_logarithmic_axis():
    assert decade_ticks(0.01, 1000, 8) == (
        [0.01, 0.1, 1, 10, 100, 1000],
        ["0.01", "0.1", "1", "10", "100", "1000"],
        "",
    )
    assert decade_ticks(2e-6, 3e-5, 8)[1] == ["2·10⁻⁶", "5·10⁻⁶", "10⁻⁵", "2·10⁻⁵"]
    assert decade_ticks(1e-9, 1e3, 4)[1] == ["10⁻⁹", "10⁻⁵", "10⁻¹", "10³"]


def test_a_short_logarithmic_axis_has_marks_inside_it():
    places, labels, _ = decade_ticks(1.1, 1.9, 4)
    assert places == pytest.approx([1.2, 1.4, 1.6, 1.8])
    assert labels == ["1.2", "1.4", "1.6", "1.8"]
    places, _, factor = decade_ticks(2.1e-6, 4.9e-6, 4)
    assert places == pytest.approx([3e-6, 4e-6]) and factor == "×10⁻⁶"


@settings(deadline=None)
@given(
    low=st.floats(-12, 6).map(lambda e: 10**e),
    ratio=st.floats(0.01, 14).map(lambda e: 10**e),
    count=st.floats(1, 20),
    kind=st.sampled_from([(linear_ticks, float), (decade_ticks, np.log10)]),
)
def test_every_axis_has_two_marks_inside_it(low, ratio, count, kind):
    (ticks, scale), high = kind, low * ratio
    places, labels, _ = ticks(low, high, count)
    assert len(places) >= 2 and len(set(labels)) == len(places)
    start, end = scale(low), scale(high)
    assert all(-1e-6 < (scale(p) - start) / (end - start) < 1 + 1e-6 for p in places)


def _plot(label):
    def plot(ax):
        ax.loglog([1e-3, 1e5], [1, 10], color=BLUE, label=label)
        ax.plot([1], [2], "o", titles=[label])
        ax.legend()

    return plot


def test_picture_is_the_same_each_time_and_its_ids_are_its_own():
    first, again = (draw("a.x", "text", 300, 200, _plot("b")) for _ in range(2))
    other = draw("b.x", "text", 300, 200, _plot("b"))
    assert first == again
    ids = [set(re.findall(r' id="([^"]+)"', svg)) for svg in (first, other)]
    assert ids[0]
    assert not ids[0] & ids[1]
    for svg, known in zip((first, other), ids, strict=True):
        assert set(re.findall(r'(?:href="|url\()#([^")]+)', svg)) == known


def test_picture_escapes_labels():
    svg = draw("a", '"><script>', 300, 200, _plot("_<script>$x_2$ & b</script>"))
    assert "<script" not in svg
    assert svg.count("_&lt;script&gt;$x_2$ &amp; b&lt;/script&gt;") == 2
    assert 'aria-label="&quot;&gt;&lt;script&gt;"' in svg


def test_picture_takes_its_colours_from_the_page_and_names_no_host():
    svg = draw("a", "", 300, 200, _plot("b"))
    assert "currentColor" in svg and "var(--c0)" in svg and "var(--grid)" in svg
    assert not re.search(r"#[0-9a-f]{6}\b", svg)
    assert "http" not in svg
    assert "10⁻³" in svg


def test_places_are_those_of_the_data():
    ax = Axes(100, 50)
    ax.set_xlim(0, 10)
    ax.set_ylim(-1, 1)
    ax.plot([0, 5, 10], [-1, 0, 1])
    assert 'd="M0 500l500-250 500-250"' in ax.svg(0, 0, "i")


def test_areas_that_share_an_axis_have_one_scale_and_one_row_of_numbers():
    def plot(areas):
        for ax, top in zip(areas, (1, 40), strict=True):
            ax.plot([0, 1], [0, top])

    svg = draw("a", "", 400, 200, plot, columns=(1, 1), sharey=True)
    paths = re.findall(r'stroke-width="13" d="M\d+ (\d+)l\d+-(\d+)"', svg)
    assert paths[0][0] == paths[1][0]
    assert float(paths[1][1]) / float(paths[0][1]) == pytest.approx(40, rel=0.05)
    assert svg.count(">40<") == 1


@pytest.mark.parametrize("plot", ["plot", "loglog"])
def test_values_that_differ_by_rounding_have_room(plot):
    x = np.array([15.0, np.nextafter(15.0, 16.0)])
    low, high = span_of(lambda ax: getattr(ax, plot)(x, x))
    assert low < 14 and high > 16


def test_limits_of_what_never_changes_have_room():
    def drawn(ax):
        ax.plot([0.0, 1.0], [3.0, 3.0])
        ax.set_ylim(3.0, 3.0)

    low, high = span_of(drawn)
    assert low < 3 < high


def span_of(drawn):
    ax = Axes(300, 200)
    drawn(ax)
    return ax.span("y")


def test_an_area_without_a_finite_value_is_drawn_empty():
    for values in ([], [np.nan, np.nan]):
        assert "<svg" in draw("a", "", 300, 200, lambda ax, v=values: ax.loglog(v, v))
