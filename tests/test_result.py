"""``imuloop.calibrate`` and its relatives: the workflow's numbers from arrays, tables and files."""

import gc
import pickle
import re
import shlex
import shutil
from dataclasses import replace
from html import unescape
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import imuloop
from bench.study.chain import run_stages
from imuloop import chain
from imuloop.__main__ import main
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from quick import hurry

FORCE, TURN = ["ax", "ay", "az"], ["gx", "gy", "gz"]


@pytest.fixture(scope="module")
def log(device):
    return pd.read_csv(device / "1.csv")


@pytest.fixture(scope="module")
def result(log):
    with hurry("device"):
        return imuloop.calibrate(log["t"], log[FORCE], log[TURN], progress=False)


def test_arrays_give_the_numbers_of_the_workflow(result, device, tmp_path):
    imu = chain.Device("device", tmp_path, {"poses": "multi_position"})
    chain.ingest(imu, "poses", {}, [device / "1.csv"])
    with hurry("device"):
        run_stages(imu)
    chain.export(imu)
    theirs = imuloop.Calibration.from_json(tmp_path / "calibration.json")
    for sensor in ("accelerometer", "gyroscope"):
        mine, other = getattr(result.calibration, sensor), getattr(theirs, sensor)
        for name in ("T", "K", "b", "covariance"):
            np.testing.assert_allclose(getattr(mine, name), getattr(other, name), rtol=1e-12)
        expected = read_json(tmp_path / "diagnosis.json")["sensors"][sensor]
        assert result.verdict[sensor] == {part: b["verdict"] for part, b in expected.items()}
        # a session of poses alone: they decide
        assert getattr(result.calibration, sensor).verdict == result.verdict[sensor]["poses"]
        assert result.verdict[sensor]["poses"] in str(result) and repr(result).count("\n") == 0
    exported = result.export(tmp_path / "mine")
    assert len(exported) > 10
    for file in exported:
        assert file.read_bytes() == (tmp_path / "exports" / file.name).read_bytes()
    assert result.noise["gx"].N.value > 0 and not result.failures


# files of results, and a command that takes one
FILES = re.compile(r"(calibration|noise|diagnosis)\.json|comparison\.csv|README\.txt|imuloop apply")


@pytest.mark.usefixtures("blank_figures")
def test_the_report_is_written_and_figures_are_of_matplotlib(result, tmp_path):
    (tmp_path / "link.html").symlink_to("report.html")
    page = result.report(tmp_path / "link.html").read_text()
    assert (tmp_path / "link.html").is_symlink() and (tmp_path / "report.html").is_file()
    assert page.lower().startswith("<!doctype html>") and "in memory" in page
    # which is temporary
    assert str(result.device.folder) not in page
    # the files go with the result, and so does what can be done with them
    assert not FILES.search(page.partition('id="provenance"')[0])
    assert set(re.findall(r'href="([^#"][^"]*)"', page)) == set()
    for kind in ("poses", "allan", "series", "loop", "spectra"):
        figures = getattr(result.plot, kind)()
        assert figures and all(isinstance(figure, Figure) for figure in figures)
    for sensor in ("accelerometer", "gyroscope"):
        assert 0 < len(result.plot.residuals(sensor)) < len(result.plot.residuals())
    with pytest.raises(AttributeError, match="loop, poses"):
        result.plot.nothing()


@pytest.mark.usefixtures("blank_figures")
def test_a_report_leads_to_the_files_that_are_kept(result, log, tmp_path, monkeypatch):
    kept = tmp_path / "my results"
    # of the same log the stages have made their files before
    monkeypatch.setattr("imuloop.chain.stages", tuple)
    kept_result = imuloop.calibrate(log["t"], log[FORCE], log[TURN], folder=kept, progress=False)
    shutil.copytree(result.device.folder, kept, dirs_exist_ok=True)
    (tmp_path / "pages").mkdir()
    page = kept_result.report(tmp_path / "pages/report.html")
    text = page.read_text()
    links = set(re.findall(r'href="([^#"][^"]*)"', text))
    assert len(links) > 20 and all((page.parent / unquote(link)).exists() for link in links)
    assert {"calibration.json", "loop.svg", "comparison.csv", "README.txt"} <= {
        link.rpartition("/")[2] for link in links
    }
    [command] = re.findall(r"<code>python -m imuloop (apply .*?) LOG -o OUT</code>", text)
    assert shlex.split(unescape(command)) == ["apply", str(kept / "calibration.json")]


def test_a_calibration_is_shown_in_a_line_and_as_a_table(result):
    calibration = result.calibration
    for shown in (calibration, calibration.gyroscope, result):
        assert "\n" not in repr(shown) and len(repr(shown)) < 300
    table = calibration.parameters().set_index(["sensor", "parameter"])
    for sensor, unit in (("accelerometer", "m/s^2"), ("gyroscope", "rad/s")):
        sensor_fit, rows_of = getattr(calibration, sensor), table.loc[sensor]
        assert {name: rows_of.loc[name, "std"] for name in sensor_fit.std} == pytest.approx(
            sensor_fit.std
        )
        assert rows_of.loc[["b0", "b1", "b2"], "value"].tolist() == sensor_fit.b.tolist()
        assert (
            rows_of.loc["b0", "unit"] == unit and rows_of.loc["T01", "value"] == sensor_fit.T[0, 1]
        )
    for html in (calibration._repr_html_(), result._repr_html_()):
        rows = [re.findall("<td>(.*?)</td>", row, re.S) for row in html.split("<tr>")]
        rows = {tuple(row[:2]): row[2:] for row in rows if row}
        assert {*rows} == {*table.index}
        for name, (value, std, unit, source) in rows.items():
            expected = table.loc[name]
            assert float(std) == pytest.approx(expected["std"], rel=0.06)
            assert float(value) == pytest.approx(expected["value"], abs=expected["std"])
            assert unescape(unit) == expected["unit"] and source == expected["source"]


def test_names_in_html_are_text(result):
    """Protects users who open the notebook of another user."""
    hostile = "<script>alert(1)</script>"
    device = replace(result.device, label=hostile)
    named = replace(result.calibration, device=hostile)
    for shown in (replace(result, device=device), named):
        html = shown._repr_html_()
        assert "<script" not in html and "&lt;script&gt;" in html


def test_a_result_is_kept(result, tmp_path):
    copy = pickle.loads(pickle.dumps(result))
    loaded = imuloop.load(result.save(tmp_path / "kept"))
    again = pickle.loads(pickle.dumps(loaded))
    gc.collect()
    for kept in (copy, loaded, again):
        assert str(kept) == str(result) and kept.logs == result.logs
        assert kept.verdict == result.verdict and kept.diagnosis == result.diagnosis
        assert dict(kept.device.kinds) == dict(result.device.kinds)
        assert kept.noise["gx"].N.value == result.noise["gx"].N.value
        # each has its own files
        assert kept.device.folder != result.device.folder
    assert result.device.file("noise.json").exists()
    with pytest.raises(ImuloopError, match="no folder of a result: it has no calib"):
        imuloop.load(tmp_path)
    for write in (result.save, result.export):
        with pytest.raises(ImuloopError, match="a file, where a folder is asked for"):
            write(loaded.device.file("noise.json"))


def test_a_name_that_no_figure_has_is_an_error(result):
    for name, hint in (("accel", "'accelerometer'"), ("multi_position_2", "'multi_position_1'")):
        with pytest.raises(ImuloopError, match=f"names no figure; did you mean {hint}"):
            result.plot.residuals(name)
    # a sensor that has none of this kind
    assert result.plot.corrected("gyroscope") == []
    of_session = result.plot.allan("multi_position_1", "gyroscope")
    assert len(of_session) == 1 < len(result.plot.allan("multi_position_1"))


def test_a_table_of_each_sensor(log, result, tmp_path):
    force, turn = log[["t", *FORCE]], log[["t", *TURN]]
    with hurry("device"):
        two = imuloop.calibrate(acceleration=force, angular_rate=turn, progress=False)
    assert two.calibration.accelerometer.b.tolist() == result.calibration.accelerometer.b.tolist()
    assert list(two.logs.values()) == ["in memory"]
    for name, table in (("a.csv", force), ("b.csv", turn)):
        table.to_csv(tmp_path / name, index=False)
    files = {"acceleration": tmp_path / "a.csv", "angular_rate": tmp_path / "b.csv"}
    pd.testing.assert_frame_equal(imuloop.read(files), imuloop.read(log))


def test_logs_of_every_kind_are_sessions_of_one_device(log, device, tmp_path, monkeypatch):
    monkeypatch.setattr("imuloop.chain.stages", tuple)
    rest, path = log[log["t"] < 15], device / "1.csv"
    at_rest = (rest["t"], rest[FORCE], rest[TURN])
    how = {"static": at_rest, "six_position": path, "folder": tmp_path, "progress": False}
    result = imuloop.calibrate([path, log], **how)
    assert (tmp_path / "multi_position_1/samples.parquet").is_file()
    assert dict(result.device.kinds) == {
        "multi_position_1": "multi_position",
        "multi_position_2": "multi_position",
        "six_position_1": "six_position",
        "static_1": "static",
    }
    assert set(result.logs.values()) == {str(path), "in memory"}


def test_what_cannot_be_used_is_said(log):
    with pytest.raises(ImuloopError, match="rejected"):
        imuloop.read((np.arange(10), np.full((10, 3), np.nan), np.ones((10, 3))))
    with pytest.warns(UserWarning, match="rejected"):
        short = imuloop.calibrate(log.iloc[:20], progress=False)
    assert set(short.verdict["gyroscope"].values()) == {"not_testable"}
    assert "rejected" in short.failures[0]


def test_a_log_in_counts_is_questioned(log):
    with pytest.warns(UserWarning, match=r"units={'acceleration'"):
        result = imuloop.calibrate(log.iloc[:4000] * ([1] + 6 * [4000]), progress=False)
    assert "units={'acceleration'" in str(result) and not result.failures


def test_the_allan_deviation_of_white_noise_falls_as_its_square_root():
    rate, density = 100.0, 0.3
    x = np.random.default_rng(0).normal(0, density * np.sqrt(rate), (20000, 2))
    table = imuloop.allan(pd.DataFrame(x, columns=["gx", "gy"]), rate)
    assert list(table["axis"].unique()) == ["gx", "gy"]
    expected = density / np.sqrt(table["tau_s"])
    inside = (table["ci_low"] < expected) & (expected < table["ci_high"])
    assert inside.mean() > 0.85
    assert np.all(np.abs(table["adev"] / expected - 1)[table["tau_s"] < 1] < 0.1)
    with pytest.raises(ImuloopError, match="not finite"):
        imuloop.allan([0.0, np.nan, 1.0], 1.0)


def test_the_package_says_what_it_has():
    assert {*imuloop.__all__} <= {*dir(imuloop)} and imuloop.__version__
    assert all(getattr(imuloop, name).__doc__ for name in imuloop.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        _ = imuloop.nothing


@pytest.mark.usefixtures("blank_figures")
def test_a_scale_that_no_sensor_has_is_not_consistent(log, tmp_path, capsys):
    """Protects users of a log that is off by a factor without a name: its fit is a good one."""
    factor, scale = 1.35, "0.73"
    with hurry("device"):
        force = np.asarray(log[FORCE])
        scaled = imuloop.calibrate(log["t"], force, factor * log[TURN], progress=False)
    why = f"K of x is {scale}"
    block = scaled.diagnosis["sensors"]["gyroscope"]["poses"]
    assert block["verdict"] == "not_testable" and why in block["why"]
    assert scaled.diagnosis["sensors"]["accelerometer"]["poses"]["verdict"] == "consistent"
    assert why in scaled.calibration.gyroscope.not_testable and why in str(scaled)
    assert any(why in line for line in scaled.calibration.limits())
    scaled.export(tmp_path)
    assert any(why in file.read_text() for file in tmp_path.glob("*.txt"))
    scaled.report(tmp_path / "report.html")
    assert why in (tmp_path / "report.html").read_text()
    # a calibration of an older version, too
    scaled.calibration.to_json(tmp_path / "calibration.json")
    shutil.copy(scaled.device.file("noise.json"), tmp_path)
    (factor * log[TURN]).join(log.drop(columns=TURN)).to_csv(tmp_path / "log.csv")
    main(["check", str(tmp_path / "calibration.json"), str(tmp_path / "log.csv")])
    assert why in capsys.readouterr().out
