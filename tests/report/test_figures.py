"""The figures of a device: what they are shown against, and that captions hold the results."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from imuloop.core.units import DEGREE
from imuloop.report import axes
from imuloop.report.allan_plot import allan_pictures
from imuloop.report.calibration_tables import correlations
from imuloop.report.columns import rows
from imuloop.report.parameter_plot import correlation_matrices
from imuloop.report.pose_plot import pose_picture
from imuloop.report.ranking_plot import ranking_pictures
from imuloop.report.residual_plot import _ranks, against, goes_with, residual_pictures, turn_axis
from imuloop.report.results import read_device
from imuloop.report.time_series import session_pictures
from report.build import build, joined_report
from report.plausible_results import write_results


@pytest.fixture(scope="module")
def devices(tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures") / "results"
    return {
        name: read_device(name, label, folder / name, kinds)
        for name, (label, kinds) in write_results(folder).items()
    }


def block(device, sensor="gyroscope", part="poses"):
    return device.diagnosis["sensors"][sensor][part]


def plain(text):
    return text.replace("\u202f", " ").replace("\u00a0", " ")


def test_a_turn_is_about_an_axis_or_none():
    directions = [(0.0, 0.0, 1.0), (-0.9, 0.3, 0.3), (0.7, 0.7, 0.1), (0.0, 0.0, 0.0)]
    assert [turn_axis(u) for u in directions] == ["+z", "−x", "mixed", "mixed"]


def test_a_residual_is_shown_against_time_attitude_and_turn(devices):
    device = devices["board"]
    poses = rows(device.poses, device.poses["session"] == "turns")
    panels = against("pose_rate", poses)
    assert list(panels) == ["time_s", "up_x", "up_y", "up_z"]
    up = np.array([panels[f"up_{axis}"][1] for axis in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(up, axis=0), 1)
    assert "temperature_degC" in against("pose_rate", poses | {"temperature": np.arange(24.0)})
    panels = against("rotation", device.moves)
    assert list(panels) == ["time_s", "angle_deg", "speed_deg_s", "axis"]
    np.testing.assert_allclose(panels["angle_deg"][1] * DEGREE, device.moves["angle_rad"])
    assert all(len(values) == len(device.moves["pose"]) for _, values in panels.values())


def two_sessions(table):
    """Return the first rows of a table as two of the session `day` and two of `night`."""
    table = rows(table, slice(4))
    changes = {"start_s": [0.0, 50.0, 0.0, 20.0], "end_s": [10.0, 60.0, 8.0, 30.0]}
    changes |= {"pose": [0, 1, 0, 1], "session": ["day", "day", "night", "night"]}
    return table | {name: np.array(values) for name, values in changes.items()}


def test_sessions_stand_one_after_the_other(devices):
    table = two_sessions(devices["board"].moves)
    _, time = against("rotation", table)["time_s"]
    assert list(time) == [0, 50, 60, 80]


def test_a_session_is_marked_where_it_begins(devices, tmp_path):
    device = devices["board"]
    alone, one = (p.svg for p in residual_pictures(device, "gyroscope", block(device), tmp_path))
    assert ">turns</text>" not in alone + one
    both = replace(device, moves=two_sessions(device.moves))
    _, turn = residual_pictures(both, "gyroscope", block(device), tmp_path)
    # once, in the panel of time
    assert turn.svg.count(">day</text>") == turn.svg.count(">night</text>") == 1
    at = re.findall(r'translate\((\d+) 30\)rotate\(-90\)"[^>]*>(\w+)<', turn.svg)
    assert [name for _, name in at] == ["day", "night"]
    # of 80 s with margins of 4 % on both sides the second begins at 60
    area = float(re.search(r'<rect width="([\d.]+)"', turn.svg)[1])
    assert (int(at[1][0]) - int(at[0][0])) / area == pytest.approx(60 / (80 * 1.08), abs=1e-3)
    assert re.search(r"Largest left: .* turn [01] of (day|night);", plain(turn.caption))
    table = pd.read_csv(tmp_path / "gyroscope_rotation.csv")
    assert table["session"].tolist() == ["day", "day", "night", "night"]


def test_what_grows_with_the_angle_is_told_and_chance_is_not():
    rng = np.random.default_rng(3)
    angle, time = rng.uniform(10, 180, (2, 40))
    panels = {
        "time_s": ("time, s", time),
        "angle_deg": ("angle turned, °", angle),
        "axis": ("about axis", rng.integers(0, 7, 40)),
    }
    grown = angle * rng.choice([-1, 1], 40)
    assert plain(goes_with(panels, grown)) == (
        "its size grows with angle turned (rank correlation 1.0)"
    )
    for seed in range(50):
        chance = goes_with(panels, np.random.default_rng(seed).normal(size=40))
        assert chance == "its size goes with none of time, angle turned beyond chance"


def test_residual_pictures_hold_before_and_after(devices, tmp_path):
    device = devices["board"]
    pictures = residual_pictures(device, "gyroscope", block(device), tmp_path)
    rate, turn = (plain(p.caption) for p in pictures)
    # 2e-3 to 2e-4 rad/s, 9.1e-3 to 2.4e-3 rad
    assert "falls from 0.115 °/s to 0.0115 °/s" in rate and "pose" in rate
    assert "falls from 0.521° to 0.138°" in turn and "turn" in turn
    table = pd.read_csv(tmp_path / "gyroscope_pose_rate.csv")
    worst = table.loc[table["after"].abs().idxmax()]
    assert f"pose {worst['pose']:.0f};" in rate
    assert {"session", "time_s", "up_x", "before", "after", "floor"} <= set(table)
    # poses on six faces are not diagnosed
    assert set(table["session"]) == {"turns"}
    # each mark says what it is
    assert pictures[0].svg.count("<title>") == len(table)


def test_the_matrix_of_correlations_is_that_of_the_calibration(devices, tmp_path):
    device = devices["board"]
    sensor = device.calibrations["final"].accelerometer
    r = correlations(sensor)
    assert np.diag(r) == pytest.approx(1)
    accelerometer, gyroscope = correlation_matrices(device, tmp_path)
    size = np.abs(np.tril(r, -1))
    i, j = np.unravel_index(size.argmax(), r.shape)
    assert f"{r[i, j]:.2g}".replace("-", "−") in accelerometer.caption
    assert f"of {len(r) * (len(r) - 1) // 2} pairs" in accelerometer.caption
    assert accelerometer.svg.count("<title>") == (size >= 0.05).sum()
    table = pd.read_csv(tmp_path / "accelerometer_correlations.csv").set_index("parameter")
    assert table.to_numpy() == pytest.approx(r)
    # biases alone
    assert correlation_matrices(devices["still"], tmp_path) == []
    assert gyroscope.name == "board.gyroscope_correlations"


def test_candidates_are_ranked_by_what_they_leave(devices, tmp_path):
    device = devices["board"]
    (rate,) = ranking_pictures(device, "gyroscope", "poses", block(device), tmp_path)
    told = plain(rate.caption)
    # g_sensitivity 5e-4 of 2e-3 rad/s, floor 1.8e-4
    assert "of 3 effects" in told and "2 were added" in told
    assert (
        "g_sensitivity alone leaves least, 0.0286 °/s of 0.115 °/s, floor from noise 0.0103" in told
    )
    assert rate.svg.count('fill="var(--c0)"') == 2
    table = pd.read_csv(tmp_path / "gyroscope_poses_pose_rate_candidates.csv")
    assert list(table["effect"]) == ["g_sensitivity", "bias_drift", "earth_rate"]


def test_the_allan_curve_has_its_terms_and_tells_how_well_the_model_fits(devices, tmp_path):
    device = devices["board"]
    session = device.sessions[0]
    force, turn = allan_pictures(device, session, tmp_path)
    inside, count = map(int, re.search(r"at (\d+) of (\d+) averaging", force.caption).groups())
    assert count == 90 and 0 <= inside <= 90
    # a model of N five times as large leaves the band
    noise = {**device.noise, "axes": {k: dict(v) for k, v in device.noise["axes"].items()}}
    for axis in noise["axes"].values():
        axis["N"] = {**axis["N"], "value": 5 * axis["N"]["value"]}
    worse, _ = allan_pictures(replace(device, noise=noise), session, tmp_path)
    assert int(re.search(r"at (\d+) of", worse.caption)[1]) < inside
    for letter in ("N", "B"):
        assert f">{letter}</text>" in force.svg
    assert ">GM</text>" in turn.svg and ">line</text>" in force.svg


def test_the_smoothed_series_is_in_the_file_and_in_the_caption(devices, tmp_path):
    device = devices["board"]
    force, _ = session_pictures(device, device.sessions[0], tmp_path)
    table = pd.read_csv(tmp_path / "long_accelerometer.csv")
    smooth = table[(table["line"] == "smoothed") & (table["channel"] == "ax")]
    raw = table[(table["line"] == "raw") & (table["channel"] == "ax")]
    assert 0 < len(smooth) < len(raw) <= 2000
    # of 4e-3 m/s² of noise, and 0.4 of disturbance, nothing is left
    assert np.ptp(smooth["value_m/s^2"]) < 2e-3 < np.ptp(raw["value_m/s^2"])
    assert "Without noise it moves by" in force.caption


def test_faces_that_no_pose_covers_are_named(devices, tmp_path):
    assert "all six faces are covered" in pose_picture(devices["board"], tmp_path).caption


def test_notes_say_what_good_looks_like(devices, tmp_path):
    device = devices["board"]
    pictures = [
        pose_picture(device, tmp_path),
        *(p for s in device.used for p in session_pictures(device, s, tmp_path)),
        *allan_pictures(device, device.sessions[0], tmp_path),
        *correlation_matrices(device, tmp_path),
        *residual_pictures(device, "gyroscope", block(device), tmp_path),
        *ranking_pictures(device, "gyroscope", "poses", block(device), tmp_path),
    ]
    assert all("Good: " in p.note for p in pictures)


def test_no_line_has_more_than_2000_points(devices, tmp_path):
    device = devices["board"]
    for session in device.used:
        for picture in session_pictures(device, session, tmp_path):
            for path in re.findall(r' d="([^"]+)"', picture.svg):
                assert len(re.findall(r"-?\d+", path)) <= 4000


def test_a_report_of_ten_devices_is_below_5_mb(tmp_path, repository):
    from report.build import build

    folder = build(tmp_path / "results", repository)
    names = [f"board_{k}" for k in range(10)]
    for name in names:
        shutil.copytree(folder / "board", folder / name)
        for file in ("section.html", "summary.json"):
            text = (folder / name / file).read_text(encoding="utf-8")
            (folder / name / file).write_text(text.replace("board", name), encoding="utf-8")
    joined_report(folder, names, repository, tmp_path)
    assert (tmp_path / "report.html").stat().st_size < 5e6


def test_every_axis_of_numbers_has_two_marks_inside_it(tmp_path, repository, monkeypatch):
    drawn, frame = [], axes.frame
    monkeypatch.setattr(axes, "frame", lambda area, p: drawn.append(area) or frame(area, p))
    build(tmp_path / "results", repository)
    numbers = [(a, which) for a in drawn for which in "xy" if which not in a._ticks]
    assert len(numbers) > 100
    for area, which in numbers:
        places, labels, _ = area.ticks(which)
        low, high = sorted(area.span(which))
        inside = [p for p in places if low - 1e-9 * (high - low) <= p <= high * (1 + 1e-9)]
        assert len(inside) == len(set(labels)) >= 2


def test_equal_values_share_the_mean_of_their_ranks():
    assert list(_ranks(np.array([3.0, 1.0, 3.0, 2.0]))) == [3.5, 1.0, 3.5, 2.0]
