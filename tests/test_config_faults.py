"""Faults of a config: all of them, one a line, each with its key and the remedy."""

import os
from pathlib import Path

import pytest
import yaml

from entries import REPLICAS, SOUND, session
from imuloop.config import merge
from imuloop.config_faults import config_faults
from imuloop.config_text import unreadable

FAULTS = yaml.safe_load(Path(__file__).with_name("config_faults.yaml").read_text("utf-8"))
FILE = "devices.imu.sessions.a.file: "


@pytest.mark.parametrize("name", ["config.yaml", "config/measured.yaml", "config/reference.yaml"])
def test_shipped_configs_have_no_fault(repository, name, monkeypatch):
    monkeypatch.chdir(repository)
    replicas = {
        path.stem: list(yaml.safe_load(path.read_text())["sessions"])
        for path in repository.glob("data/replicas/*.yaml")
    }
    path = repository / name
    assert config_faults(yaml.safe_load(path.read_text()), {name: path}, replicas) == []


def one_fault():
    for keys, fault in FAULTS["session"].items():
        sound = keys.startswith(("kind:", "file:"))
        yield session(keys if sound else f"{SOUND}, {keys}"), "devices.imu.sessions.a.", fault
    for keys, fault in FAULTS["device"].items():
        yield session(SOUND, f"{keys} ,"), "devices.imu.", fault
    for text, fault in FAULTS["whole"].items():
        yield text, "", fault


@pytest.mark.parametrize(("text", "key", "fault"), [*one_fault()])
def test_a_fault_names_its_key_and_the_remedy(faults, text, key, fault):
    assert faults(text) == ([key + fault] if fault else [])


@pytest.mark.parametrize("content", [None, "devices: " + 999 * "[", *FAULTS["text"]])
def test_a_file_that_is_no_config_has_one_line(tmp_path, monkeypatch, content):
    monkeypatch.chdir(tmp_path)
    line = ": cannot be read: maximum recursion"
    if content is None:
        line = ": there is no such file here; write one, or name one with --configfile"
    else:
        (tmp_path / "config.yaml").write_text(content)
    fault = unreadable("config.yaml")
    assert fault.startswith(f"config.yaml{FAULTS['text'].get(content, line)}")
    assert "\n" not in fault


def test_a_fault_hides_no_other_fault(faults):
    """A wrong unit and a missing file beside reserved names and a range."""
    text = f"""
    defaults: {{noise: {{significance: 2}}}}
    devices:
      figures: {{label: '', sessions: {{exports: {{kind: statc, file: poses.csv}}}}}}
      a:
        range: {{acceleration: 16 g}}
        sessions: {{x: {{{SOUND}, units: {{time: sec}}}}}}
      b:
        gravity: 1e1
        sessions:
          x: {{kind: static, file: none.csv, units: {{time: sec}}}}
          y: {{{SOUND}, rates: 3}}
    """
    assert {line.split(": ")[0] for line in faults(text)} == {
        "defaults.noise.significance",
        "devices.figures",
        "devices.figures.label",
        "devices.figures.sessions.exports",
        "devices.figures.sessions.exports.kind",
        "devices.a.range.acceleration",
        "devices.a.sessions.x.units.time",
        "devices.b.gravity",
        "devices.b.sessions.x.file",
        "devices.b.sessions.x.units.time",
        "devices.b.sessions.y.rates",
    }


def test_a_fault_names_the_file_that_holds_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "poses.csv").write_text("t,ax,ay,az,gx,gy,gz\n0,0,0,9.8,0,0,0\n")
    first = {"devices": {"a": {"sessions": {"x": {"kind": "static", "file": "poses.csv"}}}}}
    second = {"devices": {"a": {"label": 3}}}
    files = {name: tmp_path / name for name in ("first.yaml", "second.yaml")}
    for path, content in zip(files.values(), (first, second), strict=True):
        path.write_text(yaml.safe_dump(content))
    lines = config_faults(merge(first, second), files, REPLICAS)
    assert lines == ["second.yaml line 3: devices.a.label: 3 should be a valid string"]


def test_files_of_a_folder_have_names_that_are_taken_as_written(faults, tmp_path, monkeypatch):
    """Protects: each file of a folder is an input of Snakemake's, which fills braces."""
    for name, why in (
        (b"a\xff.csv", "'a\\udcff.csv' has a blank at an end or what cannot be printed"),
        (b"b_{device}.csv", "b_{device}.csv: in place of braces"),
    ):
        path = os.path.join(os.fsencode(tmp_path / "imu0"), name)
        open(path, "w").close()
        [line] = faults(session("kind: static, file: imu0"))
        assert line.startswith(f"{FILE}in imu0, {why}")
        os.unlink(path)
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert faults(session(SOUND)) == [f"{FILE}poses.csv cannot be read: permission denied"]
