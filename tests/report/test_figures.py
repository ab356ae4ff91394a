"""The figures of a device: what they are shown against, and that captions hold the results."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from imuloop.core.files import write_json
from imuloop.core.sphere import direction_words, largest_hole
from imuloop.report.figures.allan import allan_pictures
from imuloop.report.figures.attitude import attitude_part
from imuloop.report.figures.loop import WIDTH, loop_picture, reach
from imuloop.report.figures.poses import pose_picture
from imuloop.report.figures.residuals import against, goes_with, residual_pictures
from imuloop.report.figures.time_series import session_pictures
from imuloop.report.numbers import number
from imuloop.report.results import DeviceResults


def block(device, sensor="gyroscope", part="poses"):
    return device.diagnosis["sensors"][sensor][part]


def plain(text):
    return text.replace("\u202f", " ").replace("\u00a0", " ")


def test_the_largest_hole_is_where_a_pose_is_missing_and_is_in_the_caption(devices):
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    hole, angle = largest_hole(faces)
    assert np.degrees(angle) == pytest.approx(np.degrees(np.arccos(3**-0.5)), abs=2)
    hole, angle = largest_hole(faces[:5])
    assert hole == pytest.approx([0, 0, -1], abs=0.06) and direction_words(hole) == "−z"
    assert np.degrees(angle) == pytest.approx(90, abs=3)
    assert "all six faces are covered" in pose_picture(devices["board"]).caption


def test_sessions_stand_one_after_the_other_and_are_marked_where_they_begin(devices):
    device = devices["board"]
    table = device.moves[:4].assign(
        start_s=[0.0, 50.0, 0.0, 20.0],
        end_s=[10.0, 60.0, 8.0, 30.0],
        pose=[0, 1, 0, 1],
        session=["day", "day", "night", "night"],
    )
    _, time = against("rotation", table)["time_s"]
    assert list(time) == [0, 50, 60, 80]
    _, two = residual_pictures(replace(device, moves=table), "gyroscope", block(device))
    # once, in the panel of time
    assert two.svg.count("day</text>") == two.svg.count("night</text>") == 1
    assert re.search(r"Largest left: .* turn [01] of (day|night);", plain(two.caption))


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
    for seed in range(5):
        chance = goes_with(panels, np.random.default_rng(seed).normal(size=40))
        assert chance == "its size goes with none of time, angle turned beyond chance"


def test_residual_pictures_hold_before_and_after(devices):
    device = devices["board"]
    pictures = residual_pictures(device, "gyroscope", block(device))
    rate, turn = (plain(p.caption) for p in pictures)
    # 2.4e-3 to 2e-4 rad/s, 9.1e-3 to 2.4e-3 rad
    assert "falls from 0.138 °/s to 0.0115 °/s" in rate and "pose" in rate
    assert "falls from 0.521° to 0.138°" in turn and "turn" in turn
    table = pd.read_csv(device.figures / "gyroscope_pose_rate.csv")
    worst = table.loc[table["after"].abs().idxmax()]
    assert f"pose {worst['pose']:.0f};" in rate
    # poses on six faces are not diagnosed
    assert set(table["session"]) == {"turns"}
    # each mark says what it is
    assert pictures[0].svg.count("<title>") == len(table)


def test_the_allan_curve_has_its_terms_and_tells_how_well_the_model_fits(devices):
    device = devices["board"]
    force, turn = allan_pictures(device, device.sessions[0])
    inside, count = map(int, re.search(r"at (\d+) of (\d+) averaging", force.caption).groups())
    assert count == 90 and 0 < inside <= 90
    # a model of N five times as large leaves the band
    axes = {
        k: v | {"N": v["N"] | {"value": 5 * v["N"]["value"]}}
        for k, v in device.noise["axes"].items()
    }
    worse, _ = allan_pictures(replace(device, noise={"axes": axes}), device.sessions[0])
    assert int(re.search(r"at (\d+) of", worse.caption)[1]) < inside
    assert ">line</text>" in force.svg
    # with the values of the table
    for key in "NB":
        value = number(device.noise["axes"]["ax"][key]["value"] * 1e6 / 9.80665)
        assert f">{key} {value}</text>" in force.svg
    assert ">GM</text>" in turn.svg
    assert "hump of a line of 0.0800 Hz (z)." in force.caption
    assert "hump of a Gauss–Markov process, T = 30.0 s (x)." in turn.caption


def test_the_smoothed_series_is_in_the_file_and_in_the_caption(devices):
    device = devices["board"]
    force, _ = session_pictures(device, device.sessions[0])
    table = pd.read_csv(device.figures / "long_accelerometer.csv")
    smooth = table[(table["line"] == "smoothed") & (table["channel"] == "ax")]
    raw = table[(table["line"] == "raw") & (table["channel"] == "ax")]
    assert 0 < len(smooth) < len(raw) <= 2000
    # of 4e-3 m/s² of noise, and 0.4 of disturbance, nothing is left
    assert np.ptp(smooth["value_m/s^2"]) < 2e-3 < np.ptp(raw["value_m/s^2"])
    assert "Without noise it moves by" in force.caption


def test_the_error_of_the_vertical_is_said_of_every_model_or_why_not(tmp_path):
    def part(names=("rotation", "filter"), **rms):
        models = {m: {"rms_deg": e, "p95_deg": 2 * e} for m, e in rms.items()}
        ratio = rms["base"] / rms["final"]
        method = {"n": 4, "duration_s": 2.1, "models": models, "base_over_final": ratio}
        method |= {"ratio_ci95": [0.9 * ratio, 1.1 * ratio], "floor_deg": 0.123}
        methods = dict.fromkeys(names, method)
        rows = [
            ("turns", 0, m, model, t, e)
            for m in methods
            for model, e in rms.items()
            for t in (1, 2)
        ]
        columns = ["session", "stretch", "method", "model", "t_s", "error_deg"]
        pd.DataFrame(rows, columns=columns).to_parquet(tmp_path / "attitude.parquet")
        content = {"status": "ok", "methods": methods}
        write_json(tmp_path / "attitude.json", content)
        return attitude_part(DeviceResults("board", "Board", tmp_path))

    found = part(raw=12.7, base=0.556, final=0.154)
    assert "one rotation of 2.1\u202fs" in found["finding"]
    for text in ("13° as logged", "0.56° with the base", "0.15° with the final", "final 3.61"):
        assert text in found["finding"]
    assert found["tables"][0].rows[0][3:6] == ("13 (25)", "0.56 (1.1)", "0.15 (0.31)")
    [picture] = found["pictures"]
    assert all(text in picture.caption for text in ("VQF", "13°", "0.56°", "0.15°"))
    assert "estimates the gyroscope's bias itself" in found["tables"][0].note
    alone = part(names=("rotation",), raw=12.7, base=0.556, final=0.154)
    assert len(alone["tables"][0].rows) == 1 and not alone["pictures"]
    assert "vqf is not installed" in alone["tables"][0].note
    same = part(raw=12.7, base=0.556, final=0.556)
    assert "the final model is the same" in same["finding"]
    assert all("also the final one" in p.caption for p in same["pictures"])
    write_json(tmp_path / "attitude.json", {"status": "not_testable", "why": "no <pose>"})
    found = attitude_part(DeviceResults("board", "Board", tmp_path))
    assert found["finding"] == "The error of the vertical cannot be tested: no <pose>."
    assert not found["tables"] and not found["pictures"]


def error(**sizes):
    sizes = {"logged": None, "calibrated": 2e-3, "final": None, "floor": 1e-3} | sizes
    return {"what": "a", "unit": "rad"} | sizes


def test_the_errors_of_a_device_have_a_mark_a_stage_and_words_on_no_line():
    errors = [error(logged=0.1, final=1e-3), error(calibrated=2e-4)]
    picture = loop_picture("a", errors)
    assert plain(picture.caption) == (
        "a 5.7° → 0.11° → 0.057°, noise alone 0.057°; a 0.011°, noise alone 0.057°."
    )
    figure = picture.figure()
    figure.draw_without_rendering()
    [area] = figure.axes
    sizes = [line.get_xdata()[0] for line in area.lines if line.get_marker() != "None"]
    assert sizes == pytest.approx([100, 2, 1, 0.2])
    # an error far below what slow noise may give is still in the picture
    low, high = area.get_xlim()
    assert low < 0.2 and high > 100
    # none lies on another, or on the mark of its row
    boxes = [text.get_window_extent() for text in area.texts]
    assert len(boxes) == 4
    for i, box in enumerate(boxes):
        assert not box.count_overlaps(boxes[:i])
        assert box.x0 > 0 and box.x1 < WIDTH
    assert loop_picture("a", []) is None


def test_the_errors_of_devices_that_are_compared_have_one_axis():
    devices = [error(logged=0.1)], [error(calibrated=1e-4)]
    ends = reach([e for errors in devices for e in errors])
    assert ends == pytest.approx((0.1, 100))
    limits = {loop_picture("a", e, ends).figure().axes[0].get_xlim() for e in devices}
    assert len(limits) == 1 != len({reach(e) for e in devices})
