"""``python -m imuloop``: its commands on raw logs and on results, their messages, exit status."""

import json
import re
from html import unescape
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import imuloop
from imuloop.__main__ import main
from imuloop.commands.program import COMMANDS
from imuloop.core.samples import ACCELERATION, CHANNELS
from imuloop.ingest.ingest import ingest
from ingest.logs import brief


def one_line_error(arguments, capsys):
    assert main([str(a) for a in arguments]) == 1
    message = capsys.readouterr().err
    assert message.startswith("imuloop: ") and message.count("\n") == 1
    return message


def test_info_says_what_a_file_is(device, tmp_path, capsys):
    calibrated, samples = tmp_path / "c.parquet", tmp_path / "samples.parquet"
    main([*map(str, ("apply", device / "calibration.json", device / "1.csv", "-o", calibrated))])
    session = {"device": "d", "session": "poses", "kind": "multi_position"}
    quality, exports = tmp_path / "quality.json", tmp_path / "exports.json"
    exports.write_text('{"sha256": {"kalibr_imu.yaml": "0a"}}')
    attitude = tmp_path / "attitude.json"
    attitude.write_text('{"format": 1, "status": "not_testable"}')
    ingest(**session, paths=[device / "1.csv"], samples_path=samples, quality_path=quality)
    capsys.readouterr()
    # the truth: 0.12 m/s^2, -4 mrad
    calibration = r"^calibration of d, gravity 9.80665 m/s²[^~]*Bias x +mg +12\.\d+ ± 0\.\d+"
    for path, pattern in (
        (device / "calibration.json", calibration),
        (device / "calibration.json", r"misalignment ± 1 σ\n +Axis .*\n +on x +\S+ +-[34]\.\d+ ± "),
        (device / "noise.json", r"N, white noise .* +µg/√Hz +153 +143 +194"),
        (device / "1.csv", r"1.csv: log, format csv[^~]*Rate, Hz  [^~]*ax, ay, az"),
        (calibrated, "^calibrated samples of d: "),
        (samples, "^samples of d, session poses, multi_position\nok: "),
        (quality, "^ok: "),
        (exports, r"^exports.json\n  sha256.kalibr_imu.yaml  0a\n$"),
        (attitude, "  status  not_testable"),
    ):
        assert main(["info", str(path)]) == 0
        assert re.search(pattern, capsys.readouterr().out), path


def link_to(path):
    other = path.with_name(f"link_{path.name}")
    other.symlink_to(path)
    return other


@pytest.fixture
def log(device, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for name in ("1.csv", "calibration.json", "noise.json"):
        (folder / name).write_bytes((device / name).read_bytes())
    return folder / "1.csv"


def refusal_line(arguments, folder, capsys):
    """Return the line with which a command that would destroy an input ends; all is as before."""
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    message = one_line_error(arguments, capsys)
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
    assert "is read" in message
    return message


@pytest.mark.parametrize(
    "another_name", [lambda path: path.parent / "." / ".." / "in" / path.name, link_to]
)
def test_no_command_writes_onto_what_it_reads(log, capsys, another_name):
    calibration, copy = log.with_name("calibration.json"), log.with_name("made.csv")
    copy.write_bytes(calibration.read_bytes())
    onto = another_name(log)
    for command, target in (
        (["apply", calibration, log, "-o"], onto),
        (["apply", copy, log, "-o"], another_name(copy)),
        (["check", calibration, log, "--json"], another_name(log.with_name("noise.json"))),
        (["report", log, "-o"], onto),
    ):
        refusal_line([*command, target], log.parent, capsys)


@pytest.mark.parametrize(
    ("place", "way"),
    [("", "same"), ("multi_position_1", "hard link"), ("multi_position_1", "linked folder")],
)
def test_report_keeps_nothing_where_its_log_lies(log, tmp_path, capsys, place, way):
    keep = tmp_path / "keep"
    inside = keep / place / "comparison.csv"
    if way == "linked folder":
        keep.mkdir()
        (keep / (place or "more")).symlink_to(log.parent)
    else:
        inside.parent.mkdir(parents=True)
        if way == "same":
            log = log.rename(inside)
        else:
            inside.hardlink_to(log)
    refusal_line(["report", log, "-o", tmp_path / "r.html", "--keep", keep], tmp_path, capsys)


def test_results_leave_other_files_of_their_folder(tmp_path):
    brief().to_csv(tmp_path / "rest.csv", index=False)
    other = tmp_path / "out/exports/mine.csv"
    other.parent.mkdir(parents=True)
    other.write_text("mine")
    assert main(["calibrate", str(tmp_path / "rest.csv"), "-o", str(tmp_path / "out")]) == 0
    assert other.read_text() == "mine" and other.with_name("kalibr_imu.yaml").is_file()


def test_what_a_terminal_would_obey_is_not_printed(tmp_path, capsys):
    hostile = tmp_path / "a\x1b[31m\r\x07.csv"
    rows = "\n".join(f"{k / 100},1,2,3,4,5,6" for k in range(20))
    hostile.write_text(f"t,ax,ay,az,gx,gy,\x1b[31mgz\n{rows}\n")
    assert main(["info", str(hostile), "--columns.angular_rate", "gx,gy,\x1b[31mgz"]) == 1
    out = capsys.readouterr().out
    assert "a?[31m" in out and all(line.isprintable() for line in out.splitlines())


def test_a_report_of_a_wrong_unit_says_so_first(device, tmp_path, capsys):
    cause, page = "taken as m/s^2, it looks like g", tmp_path / "report.html"
    log = pd.read_csv(device / "1.csv")
    log[list(ACCELERATION)] /= 9.80665
    log.to_csv(tmp_path / "log.csv", index=False)
    line = one_line_error(["report", tmp_path / "log.csv", "-o", page], capsys)
    assert line.startswith(f"imuloop: {tmp_path / 'log.csv'}: rejected: ") and cause in line
    text = unescape(page.read_text())
    assert text.index("Rejected sessions") < text.index(cause) < text.index("value ± 1 σ")
    assert text.count(cause) == 1 and "Nothing needed" not in text
    assert "Before anything else, correct the declaration of the rejected" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([command, "-h"])
    assert stopped.value.code == 0
    assert f"  imuloop {command} " in capsys.readouterr().out


def test_one_result_in_the_place_of_another_is_one_line(device, tmp_path, capsys):
    arguments = ["apply", device / "noise.json", device / "1.csv", "-o", tmp_path / "out.csv"]
    assert "noise.json" in one_line_error(arguments, capsys)
    (tmp_path / "calibration.json").write_text((device / "calibration.json").read_text())
    (tmp_path / "noise.json").write_text("{}")
    line = one_line_error(["check", tmp_path / "calibration.json", device / "1.csv"], capsys)
    assert "not a noise model" in line


def test_a_bug_is_one_line_that_names_the_file_of_its_traceback(
    device, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("imuloop.commands.calibrate.calibrate", lambda *logs, **how: 1 / 0)
    line = one_line_error(["calibrate", device / "1.csv", "-o", tmp_path / "out"], capsys)
    assert "a bug of imuloop: ZeroDivisionError: division by zero" in line
    assert not (tmp_path / "out").exists()
    traceback = Path(line.strip().rpartition(", ")[2])
    assert "1 / 0" in traceback.read_text()
    traceback.unlink()


def test_every_command_takes_a_file_of_each_sensor(device, tmp_path, capsys):
    log = pd.read_csv(device / "2.csv")
    force, rate = tmp_path / "acc.csv", tmp_path / "gyr.csv"
    log.rename(columns={"t": "when"})[["when", *ACCELERATION]].to_csv(force, index=False)
    log[["t", *CHANNELS[3:]]].rename(columns={"t": "tick"}).to_csv(rate, index=False)
    pair, old = f"acceleration={force},angular_rate={rate}", str(device / "calibration.json")
    named = ["--columns.time.acceleration", "when", "--columns.time.angular_rate", "tick"]
    assert main(["info", pair, *named]) == 0
    shown = capsys.readouterr().out
    assert "acc.csv and gyr.csv: log, format csv" in shown
    assert "time acceleration when, angular_rate tick" in shown
    assert main(["check", old, pair, *named]) == 0
    assert "acc.csv and gyr.csv against the calibration" in capsys.readouterr().out
    for log_of, out in ((pair, "two.parquet"), (str(device / "2.csv"), "one.parquet")):
        more = named if log_of == pair else []
        assert main(["apply", old, log_of, "-o", str(tmp_path / out), *more]) == 0
    one, two = (pd.read_parquet(tmp_path / f"{n}.parquet")[[*CHANNELS]] for n in ("one", "two"))
    np.testing.assert_array_equal(one, two)
    line = one_line_error(["info", pair, "--columns.time", "when"], capsys)
    assert "--columns.time: no column 'when'; there are tick" in line
    line = one_line_error(["apply", old, pair, "-o", force], capsys)
    assert "acc.csv" in line


def test_the_noise_of_a_log_with_the_files_of_filters(tmp_path, capsys):
    rng, rate = np.random.default_rng(5), 100.0
    log = pd.DataFrame({"t": np.arange(60_000) / rate})
    sizes = dict.fromkeys(ACCELERATION, 2e-3) | dict.fromkeys(CHANNELS[3:], 1e-4)
    for channel, density in sizes.items():
        log[channel] = density * np.sqrt(rate) * rng.standard_normal(len(log))
    log["az"] += 9.81
    log.to_csv(tmp_path / "rest.csv", index=False)
    out = tmp_path / "out"
    assert main(["noise", str(tmp_path / "rest.csv"), "-o", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "white noise (angle random walk)" in shown
    noise = json.loads((out / "noise.json").read_text())
    for channel, density in sizes.items():
        assert noise["axes"][channel]["N"]["value"] == pytest.approx(density, rel=0.02)
    kalibr = yaml.safe_load((out / "kalibr_imu.yaml").read_text())
    white = max(noise["axes"][channel]["N"]["value"] for channel in ACCELERATION)
    assert white <= kalibr["accelerometer_noise_density"] < 1.5 * white
    assert {"allan_accelerometer.svg", "allan_gyroscope.svg"} <= {p.name for p in out.iterdir()}
    curve = pd.read_csv(out / "allan.csv").query("axis == 'ax'").iloc[0]
    assert curve["adev"] == pytest.approx(2e-3 * np.sqrt(rate), rel=0.02)


def test_an_axis_without_noise_is_left_open_and_so_are_the_files_of_filters(tmp_path, capsys):
    log = pd.DataFrame(np.random.default_rng(5).normal(0, 0.01, (7000, 6)), columns=[*CHANNELS])
    log.assign(t=log.index / 100, az=log.az + 9.81, gy=0.0).to_csv(tmp_path / "rest.csv")
    assert main(["noise", str(tmp_path / "rest.csv"), "-o", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert "gy: output is constant, no coefficient estimated" in shown
    assert "openvins_kalibr_imu_chain.yaml is not written: no noise: K of gy" in shown


def test_a_log_that_is_rejected_ends_every_command_with_1(device, tmp_path, capsys):
    """One line with the cause; a calibration by the other logs is written."""
    bad, out = tmp_path / "bad.csv", tmp_path / "out"
    rows = "\n".join(f"{k / 100},0,0,9.8,0,0,0" for k in range(20))
    bad.write_text(f"t,ax,ay,az,gx,gy,gz\n{rows}\n")
    calibration, good = device / "calibration.json", tmp_path / "good.csv"
    brief().to_csv(good, index=False)
    for command in (
        ["apply", calibration, bad, "-o", out],
        ["calibrate", bad, "-o", out],
        ["check", calibration, bad, "--json", out],
        ["coach", bad, "--every", "0.01", "--patience", "0.1"],
        ["noise", bad, "-o", out],
        ["report", bad, "-o", tmp_path / "page.html"],
    ):
        message = one_line_error(command, capsys)
        assert "bad.csv: " in message and "20 usable rows" in message and not out.exists()
    message = one_line_error(["calibrate", good, f"static={bad}", "-o", out], capsys)
    assert "bad.csv: rejected: 20 usable rows" in message and (out / "calibration.json").exists()


def test_a_log_that_shows_nothing_gives_no_calibration(tmp_path, capsys):
    log = pd.DataFrame({"t": np.arange(6000) / 100})
    for k, channel in enumerate(CHANNELS):
        log[channel] = 5 * np.sin((1 + 0.3 * k) * log["t"])
    log.to_csv(tmp_path / "moving.csv", index=False)
    command = ["calibrate", tmp_path / "moving.csv", "-o", tmp_path / "out"]
    assert "moving.csv: nothing was measured: " in one_line_error(command, capsys)
    assert not (tmp_path / "out").exists()


def test_a_prior_is_a_file(device, tmp_path, capsys):
    log, kept = tmp_path / "rest.csv", tmp_path / "earlier"
    brief().to_csv(log, index=False)
    kept.mkdir()
    for name in ("calibration.json", "noise.json"):
        (kept / name).write_bytes((device / name).read_bytes())
    file = kept / "calibration.json"
    command = ["calibrate", log, "-o", tmp_path / "out", "--prior"]
    assert main([*map(str, command), str(file)]) == 0
    calibration = json.loads((tmp_path / "out/calibration.json").read_text())
    assert {calibration[s]["prior"]["source"] for s in ("accelerometer", "gyroscope")} == {
        str(file)
    }
    refusal_line(["calibrate", log, "-o", kept, "--prior", file], kept, capsys)


def test_the_gravity_that_was_used_is_printed(device, tmp_path, capsys):
    calibration, log = str(device / "calibration.json"), str(tmp_path / "rest.csv")
    brief().to_csv(log, index=False)
    # normal gravity on the ellipsoid at 45° is 9.806199 m/s^2, and falls by 3.1e-6 per m
    place = ["--gravity.latitude", "45", "--gravity.height", "100"]
    for command in (
        ["calibrate", log, "-o", str(tmp_path / "out")],
        ["check", calibration, log],
        ["coach", log, "--every", "0.01", "--patience", "0.1"],
    ):
        main([*command, *place])
        assert "gravity 9.80589 m/s²" in capsys.readouterr().out
    main(["check", calibration, log])
    assert "gravity 9.80665 m/s²" in capsys.readouterr().out


def test_a_terminal_shows_the_steps_that_are_done(tmp_path, capsys, monkeypatch):
    brief().to_csv(tmp_path / "rest.csv", index=False)
    command = ["calibrate", str(tmp_path / "rest.csv"), "-o", str(tmp_path / "out")]
    assert main(command) == 0 and capsys.readouterr().err == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert main(command) == 0
    shown = capsys.readouterr().err
    assert "ingest multi_position_1" in shown and " 0 of 5 steps done" in shown
    assert shown.index("segment: ") < shown.index("diagnose: ")
    assert (tmp_path / "out/multi_position_1/allan.parquet").is_file()


LONG = "--columns.time tick --columns.acceleration fx,ay,az --units.time ms"
COUNTS = " --units.acceleration count --nominal.acceleration.scale 0.01"
RANGES = " --sensor icm42688p --range.acceleration 16g --range.angular_rate 2000deg/s"


@pytest.mark.parametrize(
    ("short", "long"),
    [
        ("--set columns.time=tick columns.acceleration=[fx,ay,az] units.time=ms", LONG),
        ("--columns time=tick acceleration=fx,ay,az --time-unit ms", LONG),
        ('--set=columns.time=tick --columns=acceleration=fx,ay,az --set units={"time":"ms"}', LONG),
        (f"{LONG} --rate null", LONG),
        (f"{LONG} --range=16g,2000deg/s --sensor icm42688p", LONG + RANGES),
        (f"{LONG} --counts acceleration=0.01", LONG + COUNTS),
        (f"{LONG} --counts acceleration=0.01,5", f"{LONG}{COUNTS} --nominal.acceleration.offset 5"),
        (f"{LONG} --sensor icm42688p --range 16g,2000deg/s", LONG + RANGES),
    ],
)
def test_a_key_of_the_config_is_an_option_and_has_shorthands(tmp_path, capsys, short, long):
    log = brief().rename(columns={"t": "tick", "ax": "fx"})
    log.assign(tick=1e3 * log["tick"]).to_csv(tmp_path / "log.csv", index=False)
    shown = []
    for words in (short, long):
        status = main(["info", str(tmp_path / "log.csv"), *words.split()])
        shown.append((status, capsys.readouterr()))
    assert shown[0] == shown[1] and "fx, ay, az" in shown[0][1].out


def test_the_version_is_printed(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"imuloop {imuloop.__version__}\n"
