"""Calibration files of any content: one clear line, or a right result, of every command."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from imuloop import Calibration
from imuloop.__main__ import main
from imuloop.core.samples import CHANNELS
from imuloop.model.effect import FittedEffect, find_effect

HOSTILE = yaml.safe_load(Path(__file__).with_name("hostile_calibrations.yaml").read_text("utf-8"))


@pytest.fixture(scope="module")
def folder(device, tmp_path_factory):
    """A folder with the log of a simulated device, its noise and calibration, effects in it."""
    folder = tmp_path_factory.mktemp("effects")
    log = pd.read_csv(device / "1.csv")
    log.assign(temperature=20.0 + 0.01 * log["t"]).to_csv(folder / "log.csv", index=False)
    (folder / "noise.json").write_bytes((device / "noise.json").read_bytes())
    calibration = Calibration.from_json(device / "calibration.json")
    effects = (effect_of("warm_up", tau=100.0), effect_of("bias_temperature"))
    replace(
        calibration,
        accelerometer=replace(calibration.accelerometer, effects=effects),
        gyroscope=replace(calibration.gyroscope, effects=(effect_of("g_sensitivity"),)),
    ).to_json(folder / "calibration.json")
    return folder


def effect_of(name, **constants):
    effect = find_effect(name)(**constants)
    values = dict.fromkeys(effect.parameters, 1e-5)
    return FittedEffect(effect, values, dict.fromkeys(values, 1e-6))


def changed(content, changes):
    """Return a calibration's content with changes by key."""
    content = json.loads(content)
    for path, value in changes.items():
        path = re.sub("^A(?=[.])", "accelerometer", re.sub("^G(?=[.])", "gyroscope", path))
        *parents, last = [int(key) if key.isdigit() else key for key in path.split(".")]
        part = content
        for key in parents:
            part = part[key]
        if value == "MISSING":
            del part[last]
        elif isinstance(value, dict) and "effect" in value:
            constants = {key: x for key, x in value.items() if key != "effect"}
            part[last] = effect_of(value["effect"], **constants).to_dict()
        else:
            part[last] = value
    return json.dumps(content)


TEXT = b'{"format": 1, "device": "d", "gravity": 9.8, '
# files without any JSON of a calibration
FILES = {
    "empty": b"",
    "no JSON": b"{",
    "key twice": TEXT + b'"gravity": 1.0}',
    "NaN": TEXT + b'"x": NaN}',
    "10000 deep": TEXT + b'"x": ' + b"[" * 10_000 + b"]" * 10_000 + b"}",
    "3 MB of numbers": TEXT + b'"accelerometer": [' + b"1," * 1_500_000 + b'1], "gyroscope": 1}',
}


def outcome(arguments, capfd):
    """Run a command; return its status, after looking at its output."""
    status = main([str(a) for a in arguments])
    said = capfd.readouterr()
    text = said.out + said.err
    assert "Traceback" not in text and "Warning" not in text
    assert all(line.isprintable() for line in text.split("\n"))
    if status == 1:
        assert said.out == "" and said.err.startswith("imuloop: ")
        assert said.err.count("\n") == 1 and len(said.err) < 600
        assert "calibration.json: " in said.err or "log.csv: " in said.err
    else:
        assert said.err == "" and not re.search(r"\b(nan|inf)\b", said.out)
    return status


@pytest.fixture
def statuses(folder, tmp_path, capfd):
    """Run all commands with a calibration; return their statuses."""

    def call(path):
        out, drift, log = tmp_path / "out.csv", tmp_path / "drift.json", folder / "log.csv"
        applied = outcome(["apply", path, log, "-o", out], capfd)
        assert out.exists() == (applied == 0)
        if applied == 0:
            values = pd.read_csv(out)
            assert np.isfinite(values[list(CHANNELS)].to_numpy()).all()
        path.with_name("noise.json").write_bytes((folder / "noise.json").read_bytes())
        checked = outcome(["check", path, log, "--json", drift], capfd)
        assert drift.exists() == (checked in (0, 3))
        return applied, checked, outcome(["info", path], capfd)

    return call


def test_the_calibration_is_good(folder, statuses):
    assert statuses(folder / "calibration.json") == (0, 0, 0)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", HOSTILE)
def test_a_changed_calibration_is_refused_or_gives_what_is_finite(folder, tmp_path, statuses, kind):
    sound, path = (folder / "calibration.json").read_text(), tmp_path / "calibration.json"
    for changes in HOSTILE[kind]:
        path.write_text(changed(sound, changes))
        assert {*statuses(path)} <= ({1} if kind == "refused" else {0, 1, 3}), changes
        for name in ("out.csv", "drift.json"):
            (tmp_path / name).unlink(missing_ok=True)


NO_FILES = [Path.mkdir, os.mkfifo, lambda path: path.symlink_to("/dev/zero"), lambda path: None]


@pytest.mark.parametrize("content", [*FILES.values(), *NO_FILES])
def test_a_file_that_holds_none_is_refused(tmp_path, statuses, content):
    path = tmp_path / "calibration.json"
    content(path) if callable(content) else path.write_bytes(content)
    assert statuses(path) == (1, 1, 1)
