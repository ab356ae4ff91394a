"""Documents: their links exist, their examples work, and they have every key of the config."""

import importlib
import json
import os
import re
import runpy
import shlex
import shutil
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import imuloop
from export.devices import C_HEADER
from export.devices import device as exported_device
from imuloop import Calibration
from imuloop.__main__ import main
from imuloop.config_faults import config_faults
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit
from imuloop.export.export import FORMATS
from imuloop.model.effect import Effect
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.report.findings import UNTESTED
from quick import hurry
from workflow.run import run_fork

REPOSITORY = Path(__file__).resolve().parents[1]
DOCUMENTS = [
    *(REPOSITORY / name for name in ("README.md", "CHANGELOG.md", "data/README.md")),
    *sorted(REPOSITORY.glob("docs/*.md")),
]
# folders that a path in a document may be relative to
ROOTS = [REPOSITORY, REPOSITORY / "workflow/lib", REPOSITORY / "workflow/lib/imuloop"]
# folders that a run makes
MADE = ("build/", "results/", "data/simulated", "data/cache", ".venv")
# files that an export writes
EXPORTS = [form.file for form in FORMATS]


def each_document():
    return pytest.mark.parametrize(
        "document", DOCUMENTS, ids=lambda path: str(path.relative_to(REPOSITORY))
    )


def blocks(document, language):
    return re.findall(rf"^ *```{language}\n(.*?)^ *```", document.read_text(), re.M | re.S)


def all_blocks(language):
    return [
        pytest.param(block, id=f"{path.name}-{number}")
        for path in DOCUMENTS
        for number, block in enumerate(blocks(path, language))
    ]


def anchors(document):
    headings = re.findall(r"^#+ (.+)$", document.read_text(), re.M)
    plain = [re.sub(r"[^\w -]", "", heading).strip().lower() for heading in headings]
    return [heading.replace(" ", "-") for heading in plain]


@each_document()
def test_links_lead_somewhere(document):
    for target in re.findall(r"\]\(([^)\s]+)\)", document.read_text()):
        if target.startswith("https://"):
            continue
        # pages of the repository other than its files
        workflow = re.fullmatch(r"../../actions/workflows/([\w.]+)(/badge.svg)?", target)
        if workflow:
            target = f".github/workflows/{workflow[1]}"
        path, _, anchor = target.partition("#")
        there = (document.parent / path).resolve() if path else document
        assert there.exists(), target
        assert not anchor or anchor in anchors(there), target
    # pictures have a text about them
    for alt in re.findall(r"!\[([^]]*)\]\((?!\S+/badge.svg)", document.read_text()):
        assert len(alt.split()) > 8, alt


@each_document()
def test_paths_exist(document):
    text = re.sub(r"```.*?```", "", document.read_text(), flags=re.S)
    # what lies in repositories and packages of others
    text = re.sub(r"^\| [^|]+ \| [^|]+ \| (GitHub|wheel) .*$", "", text, flags=re.M)
    for quoted in re.findall(
        r"`([\w.-]+(?:/[\w.-]+)+|[\w-]+\.(?:py|md|yaml|toml|lock))`", text, re.A
    ):
        unit = re.fullmatch(r"\w+/(s|h)", quoted)
        made_or_named_by_the_user = quoted.startswith(MADE) or "NAME" in quoted
        there = any((root / quoted).exists() for root in ROOTS) or quoted in EXPORTS
        assert there or unit or made_or_named_by_the_user, quoted


@each_document()
def test_modules_exist_and_nothing_of_one_machine_is_named(document):
    for quoted in re.findall(r"`(imuloop(?:\.\w+)+)", document.read_text()):
        module, _, name = quoted.rpartition(".")
        try:
            importlib.import_module(quoted)
        except ModuleNotFoundError:
            assert hasattr(importlib.import_module(module), name), quoted
    paths = re.findall(r"(?:^|[\s`(\"'])(/(?:home|work|tmp|root|Users)/\S*)", document.read_text())
    assert paths == []


def write_log(path, columns):
    wanted = {"time": "t", "acceleration": CHANNELS[:3], "angular_rate": CHANNELS[3:]} | columns
    if isinstance(wanted["acceleration"][0], int):
        path.write_text("0 0 9.8 0 0 0\n" * 400)
        return
    axes = [*wanted["acceleration"], *wanted["angular_rate"]]
    log = pd.DataFrame({wanted["time"]: np.arange(400) / 100})
    log[axes] = np.random.default_rng(0).normal([0, 0, 9.8, 0, 0, 0], 0.01, (400, 6))
    if "temperature" in wanted:
        log[wanted["temperature"]] = 20.0
    log.to_csv(path, index=False)


@pytest.mark.parametrize("block", all_blocks("yaml"))
def test_configs_have_no_fault(tmp_path, monkeypatch, block):
    config = yaml.safe_load(block)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    for device in config["devices"].values():
        for session in device["sessions"].values():
            if "://" not in session["file"]:
                write_log(tmp_path / session["file"], session.get("columns", {}))
    (tmp_path / "config.yaml").write_text(block)
    assert config_faults(config, {"config.yaml": "config.yaml"}, {}) == []


@pytest.fixture
def results(tmp_path, monkeypatch):
    """Stand in a folder with the results that the documents' commands read."""
    monkeypatch.chdir(tmp_path)
    values = {"T": np.eye(3), "K": np.ones(3), "b": np.array([0.1, 0.2, 0.3])}
    values |= {"names": ("b0", "b1", "b2"), "covariance": 0.01 * np.eye(3), "method": "static"}
    calibration = Calibration(
        "my_imu",
        9.80665,
        SensorCalibration(RawUnit("m/s^2", 1.0), **values),
        SensorCalibration(RawUnit("rad/s", 1.0), **values),
    )
    sensors = {"accelerometer": {"poses": UNTESTED}}
    for device in ("my_imu", "xsens_mti", "thermal_chamber", "cats_tag", "mpu9150_1", "broad"):
        folder = tmp_path / "results" / device
        folder.mkdir(parents=True)
        calibration.to_json(folder / "calibration.json")
        (folder / "diagnosis.json").write_text(json.dumps({"device": device, "sensors": sensors}))
    write_log(tmp_path / "log.csv", {})
    samples = pd.read_csv("log.csv")
    samples.to_csv("night.csv", index=False)
    (tmp_path / "results/my_imu/poses").mkdir()
    samples.to_parquet("results/my_imu/poses/samples.parquet")
    return samples


@pytest.mark.usefixtures("blank_figures")
@pytest.mark.parametrize(
    "block", [b for b in all_blocks("python") if "def read(" not in b.values[0]]
)
def test_python_runs(results, monkeypatch, block):
    # an effect of an example joins no other test's library
    monkeypatch.setattr(Effect, "library", dict(Effect.library))
    block = block.replace('"data/replicas/', f'"{REPOSITORY}/data/replicas/')
    # the same code with fewer poses
    block = block.replace("(1, 6, 12, 40)", "(1, 12)")
    names = {}
    with hurry("my_imu"):
        exec(compile(block, "document", "exec"), names)
    if "calibrated" in names:
        bias = (results - names["calibrated"])[list(CHANNELS)]
        np.testing.assert_allclose(bias, [[0.1, 0.2, 0.3] * 2] * len(results), atol=1e-12)


def test_the_c_example_compiles_and_runs(tmp_path):
    """With the header that is exported for a device, it prints six calibrated values."""
    compiler = shutil.which("cc") or pytest.skip("no C compiler `cc` on this machine")
    header = C_HEADER.text(replace(exported_device(), device="device"))
    (tmp_path / C_HEADER.file).write_text(header, encoding="utf-8")
    (example,) = blocks(REPOSITORY / "docs/exports.md", "c")
    (tmp_path / "main.c").write_text(example)
    command = [compiler, "-std=c99", "-Wall", "-Werror", "main.c", "-o", "main"]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    assert len(re.findall(r"-?\d+\.\d+", done.stdout)) == 6


RESTING = "devices: {my_imu: {sessions: {rest: {kind: static, file: log.csv}}}}"


def commands():
    lines = [line for block in all_blocks("sh") for line in block.values[0].splitlines()]
    lines = [line.removeprefix(".venv/bin/") for line in lines]
    # those with plugins for clusters are run where these are: tests/cluster
    return sorted({line for line in lines if line and not line.startswith(("#", ".venv-cluster"))})


@pytest.mark.usefixtures("blank_figures")
@pytest.mark.parametrize("command", commands())
def test_commands_work(results, tmp_path, command):
    words = [word for word in shlex.split(command) if "=" not in word or word.startswith("-")]
    tool, *arguments = words
    if tool == "make":
        targets = re.findall(r"^([\w-]+):", (REPOSITORY / "Makefile").read_text(), re.M)
        assert set(arguments) <= set(targets)
    elif Path(tool).name == "imuloop":
        # a drift that was found, or a log that ended early, is not an error
        assert main(arguments) in ((0, 3) if arguments[0] in ("check", "coach") else (0,))
    elif tool.endswith("snakemake") and "CONFIG" in arguments:
        config = tmp_path / "mine.yaml"
        config.write_text(RESTING)
        places = {"REPO/Snakefile": REPOSITORY / "Snakefile", "WORKDIR": tmp_path, "CONFIG": config}
        arguments = [str(places.get(word, word)) for word in arguments]
        run = run_fork([*arguments, "-n", "--quiet"], tmp_path, os.environ.copy())
        assert run.returncode == 0, run.stderr
    elif tool.endswith("snakemake") or tool == "sbatch":
        # other tests check the configs of the repository, and run the script on a SLURM
        named = [word for word in arguments if word.endswith((".sh", ".yaml"))]
        assert named and all((REPOSITORY / word).exists() for word in named)
    else:
        assert tool.endswith("pytest"), f"no test knows how to run {tool}"
        assert all((REPOSITORY / word).exists() for word in arguments if not word.startswith("-"))


def test_version_is_that_of_the_citation_and_of_the_newest_changes():
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text())
    newest = re.search(r"^## \[(.+?)\]", (REPOSITORY / "CHANGELOG.md").read_text(), re.M)[1]
    assert citation["version"] == newest == imuloop.__version__


def rows(document):
    """Return the rows of all tables of a document by each key in their first cell."""
    cells_of = {}
    for line in document.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|"):
            cells_of |= {key: cells for key in re.findall(r"`([\w.]+)`", cells[0])}
    return cells_of


def test_every_effect_is_reported():
    reported = rows(REPOSITORY / "docs/effects.md")
    for name, effect in Effect.library.items():
        assert reported[name][1] == " ".join(effect.sensors)
        assert reported[name][2] == effect.equation


def test_the_reference_holds_what_users_and_effects_are_called():
    script = runpy.run_path(str(REPOSITORY / "docs/api.py"))
    page = script["page"]()
    for name in {*imuloop.__all__, "Plots"} - {"plot"}:
        assert f"\n### {name}\n" in page, name
    for name, effect in Effect.library.items():
        assert f"\n### {name}\n" in page and effect.equation in page
    # the first line says the purpose of a function
    for module, of in script["modules"]().items():
        for name, thing in script["defined"](of).items():
            assert script["first_line"](thing).endswith("."), f"{module}.{name}"


def test_the_environment_of_the_jobs_is_that_of_the_lock():
    """All packages that pyproject.toml names for users, with the versions of locks/users.lock."""
    script = runpy.run_path(str(REPOSITORY / "docs/environment.py"))
    text = (REPOSITORY / "workflow/envs/imuloop.yaml").read_text()
    assert text == script["environment"](), "run make environment"
    *_, pip = yaml.safe_load(text)["dependencies"]
    pinned = dict(pin.partition(";")[0].split("==") for pin in pip["pip"])
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    users = re.search(r"\[(.*)\]", extras["all"][0])[1].split(",")
    named = [
        *project["dependencies"],
        *(requirement for extra in users for requirement in extras[extra]),
    ]
    assert {re.match(r"[\w-]+", requirement)[0].lower() for requirement in named} <= {*pinned}
    # for snakemake --report
    assert "pygments" in pinned
