"""Pictures: what they keep of the data, and what they carry into the page."""

import re
import warnings

import numpy as np
import pytest

from imuloop.report.pose_plot import direction_words, largest_hole
from imuloop.report.svg import BLUE, _steps, decades, draw
from imuloop.report.time_series import extremes


def test_decimation_keeps_every_peak_and_at_most_2000_points():
    x = np.random.default_rng(0).normal(size=720_000)
    x[[17, 400_001, 719_999]] = 50, -60, 70
    chosen = extremes(x)
    assert len(chosen) <= 2000
    assert (np.diff(chosen) > 0).all()
    assert {17, 400_001, 719_999} <= set(chosen)
    # the envelope of each stretch is that of the samples themselves
    for stretch in np.array_split(np.arange(len(x)), 350)[::50]:
        inside = chosen[(chosen >= stretch[0]) & (chosen <= stretch[-1])]
        assert x[inside].max() == pytest.approx(x[stretch].max())


@pytest.mark.parametrize("n", [0, 1, 699, 700, 701, 1234])
def test_decimation_of_short_series(n):
    x = np.arange(float(n))
    chosen = extremes(x)
    assert len(chosen) == n if n <= 700 else len(chosen) <= 700
    assert n == 0 or (chosen[0] == 0 and chosen[-1] == n - 1)


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


def test_steps_lead_to_the_points_of_the_path():
    rng = np.random.default_rng(2)
    parts = [rng.uniform(-50, 900, (n, 2)) for n in (40, 3, 1, 7)]
    parts[0][1] = parts[0][0]
    ends = ["", " z", "", " z"]
    path = " \n".join(
        f"M {p[0, 0]:f} {p[0, 1]:f}" + "".join(f" \nL {x:f} {y:f}" for x, y in p[1:]) + end
        for p, end in zip(parts, ends, strict=True)
    )
    here, start, found = np.zeros(2), np.zeros(2), []
    for letter, numbers in re.findall(r"([mlz])([^mlz]*)", _steps(path)):
        if letter == "z":
            here = start
            continue
        steps = np.array(re.findall(r"-?(?:\d+\.?\d*|\.\d+)", numbers), float).reshape(-1, 2)
        for k, step in enumerate(steps):
            here = here + step
            if letter == "m" and not k:
                start = here
            found.append(here)
    # no error adds up: each point is as near as tenths can be
    assert np.abs(np.array(found) - np.concatenate(parts)).max() <= 0.05 + 1e-9


def _plot(label):
    def plot(ax):
        ax.loglog([1e-3, 1e3], [1, 10], "o-", color=BLUE, label=label)
        ax.legend(ax.lines, [label])
        decades(ax.xaxis)

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


def test_picture_escapes_labels_and_leaves_dollars_alone():
    svg = draw("a", '"><script>', 300, 200, _plot("_<script>$x_2$ & b</script>"))
    assert "<script" not in svg
    assert "_&lt;script&gt;$x_2$ &amp; b&lt;/script&gt;" in svg
    assert 'aria-label="&quot;&gt;&lt;script&gt;"' in svg


def test_picture_of_a_label_in_another_script_is_drawn_without_a_word():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "加速度" in draw("a", "", 300, 200, _plot("加速度"))


def test_picture_takes_its_colours_from_the_page_and_names_no_host():
    svg = draw("a", "", 300, 200, _plot("b"))
    assert "currentColor" in svg and "var(--c0)" in svg and "var(--grid)" in svg
    assert not re.search(r"#[0-9a-f]{6}\b", svg)
    assert "http" not in svg
    assert "10⁻³" in svg
