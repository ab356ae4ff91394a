"""What may import what: stages point one way, and every package imported is declared."""

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pandas as pd
import pytest
import yaml
from scipy.io import savemat

from calibrated import calibrated_device

# packages that a stage may import from
ARROWS = yaml.safe_load(Path(__file__).with_name("imports.yaml").read_text("utf-8"))
# import name of packages that are called otherwise
DISTRIBUTIONS = {"yaml": "pyyaml"}
# packages that a light installation lacks
EXTRAS = "report workflow matlab netcdf ros ulog".split()


def imports_of(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def stage(name):
    return name.removeprefix("imuloop.").partition(".")[0]


@pytest.mark.parametrize("of", ARROWS)
def test_arrows_go_one_way(repository, of):
    library = repository / "workflow/lib/imuloop"
    files = [
        p for p in library.rglob("*.py") if p.relative_to(library).parts[0] in (of, f"{of}.py")
    ]
    allowed = {*ARROWS[of], of, "core"}
    names = {(p.name, name) for p in files for name in imports_of(p) if name.startswith("imuloop")}
    assert files and not {pair for pair in names if stage(pair[1]) not in allowed}


def test_every_package_imported_is_declared(repository):
    declared = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    needed = {
        name.partition(".")[0]
        for path in (repository / "workflow/lib").rglob("*.py")
        for name in imports_of(path)
    }
    needed -= {"imuloop", *sys.stdlib_module_names}
    needed = {DISTRIBUTIONS.get(name, name).lower() for name in needed}
    of = declared["optional-dependencies"]
    every = [*declared["dependencies"], *(d for extra in EXTRAS for d in of[extra])]
    every = {re.match(r"[\w-]+", d)[0].lower() for d in every}
    # the workflow manager runs the rules, and its report needs the other
    assert every - needed == {"snakemake", "pygments"}
    assert needed <= every
    assert of["all"] == [f"imuloop[{','.join(EXTRAS)}]"]


def test_the_package_holds_all_templates_schemas_and_tables(repository):
    tool = tomllib.loads((repository / "pyproject.toml").read_text())["tool"]
    library = repository / "workflow/lib/imuloop"
    packed = {
        path
        for pattern in tool["setuptools"]["package-data"]["imuloop"]
        for path in library.glob(pattern)
        if path.is_file()
    }
    needed = [p for name in ("templates", "schemas") for p in (library / name).resolve().rglob("*")]
    needed = {path for path in needed if path.is_file()}
    needed |= {library / "sensors/sensors.yaml", library / "ingest/names.yaml"}
    assert needed and needed <= {path.resolve() for path in packed}


def test_who_reads_a_calibration_has_the_library_of_effects(repository):
    # each in its own process, as a job is, that has the packages of others already
    code = """if True:
        import os, sys, pyarrow.parquet, pandas, scipy.optimize, scipy.signal
        for module in sys.argv[1:]:
            if not (child := os.fork()):
                __import__(f"imuloop.{module}")
                from imuloop.model.effect import Effect
                os._exit(len(Effect.library) <= 20)
            assert os.waitpid(child, 0)[1] == 0, module
    """
    modules = "diagnose.diagnose export.export report.section simulate.truth".split()
    modules += ["commands.apply", "commands.check", "commands.info"]
    path = {"PYTHONPATH": str(repository / "workflow/lib")}
    command = [sys.executable, "-c", code, *modules]
    done = subprocess.run(command, env=path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# as on Windows: modules that it lacks are removed before a process begins, a reader's too
ELSEWHERE = """if True:
    import os, signal, sys
    sys.modules |= dict.fromkeys("fcntl grp pwd resource termios".split())
    del os.fork, signal.alarm, signal.setitimer, signal.SIGALRM, signal.SIGXCPU
"""


def test_a_device_is_calibrated_without_any_extra_and_what_windows_lacks(repository, tmp_path):
    calibrated_device(tmp_path, 8, 10.0, 1)
    samples = pd.read_csv(tmp_path / "1.csv")
    # of a format whose reader has its own process
    savemat(tmp_path / "1.mat", {name: samples[name].to_numpy() for name in samples})
    (tmp_path / "torn.mat").write_bytes((tmp_path / "1.mat").read_bytes()[:5000])
    (tmp_path / "sitecustomize.py").write_text(ELSEWHERE)
    code = """if True:
        import os, sys
        sys.modules |= dict.fromkeys(sys.argv[1:])
        assert not hasattr(os, "fork") and sys.modules["resource"] is None
        from imuloop.__main__ import main
        print(main(["calibrate", "1.csv", "-o", "csv"]), main(["calibrate", "1.mat", "-o", "mat"]))
        print(main(["report", "1.csv", "-o", "1.html"]), main(["info", "torn.mat"]))
    """
    optional = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    called = {distribution: name for name, distribution in DISTRIBUTIONS.items()}
    extras = (d for extra in EXTRAS for d in optional["optional-dependencies"][extra])
    packages = {called.get(d.lower(), d.partition(">")[0]) for d in extras}
    path = f"{tmp_path}{os.pathsep}{repository / 'workflow/lib'}"
    # a file is read in the encoding in which it was written, with any encoding of the machine; and
    # without a package that has no wheel for each Python and processor
    command = [sys.executable, "-X", "utf8=0", "-c", code, *packages, "vqf"]
    environment = {"PYTHONPATH": path, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert re.findall(r"^\d \d$", done.stdout, re.M) == ["0 0", "1 1"], done.stderr
    assert "accelerometer, poses" in done.stdout and "pip install '.[all]'" in done.stderr
    assert (tmp_path / "csv/exports/kalibr_imu.yaml").is_file()
    biases = [
        json.loads((tmp_path / form / "calibration.json").read_text())["gyroscope"]["b"]
        for form in ("csv", "mat")
    ]
    assert biases[0] == biases[1]
    assert "rejected: torn.mat is damaged, or not of the format matlab" in done.stdout
