"""What may import what: stages point one way, and every package imported is declared."""

import ast
import subprocess
import sys
import tomllib

import pytest

# what a stage may take from, itself and core left out
ARROWS = {
    "core": set(),
    "effects": set(),
    "ingest": set(),
    "segment": {"ingest"},
    "noise": {"effects", "ingest", "segment"},
    "calibrate": {"ingest", "segment"},
    "diagnose": {"effects", "ingest", "segment", "noise", "calibrate"},
    "discover": {"effects", "calibrate", "diagnose"},
    "validate": {"effects", "calibrate", "diagnose"},
    "plan": {"segment", "noise", "calibrate", "diagnose"},
    "board": {"calibrate", "effects", "ingest"},
    "simulate": {"effects"},
    "export": {"effects", "noise", "diagnose"},
    "report": {"effects", "ingest", "segment", "noise", "calibrate", "diagnose", "plan", "export"},
}
# import name of packages that are called otherwise
DISTRIBUTIONS = {"pywt": "pywavelets", "yaml": "pyyaml"}


def imported(path):
    """Return the dotted names that a file imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def stage(name):
    """Return the stage of a dotted name of the library."""
    return name.removeprefix("imuloop.").partition(".")[0]


@pytest.mark.parametrize("of", ARROWS)
def test_arrows_go_one_way(repository, of):
    library = repository / "workflow/lib/imuloop"
    files = [
        path
        for path in library.rglob("*.py")
        if stage(".".join(path.relative_to(library).with_suffix("").parts)) == of
    ]
    assert files
    allowed = ARROWS[of] | {of, "core"}
    against = {
        (path.name, name)
        for path in files
        for name in imported(path)
        if name.startswith("imuloop") and stage(name) not in allowed
    }
    assert not against


def test_every_package_imported_is_declared(repository):
    declared = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    needed = {
        name.partition(".")[0]
        for path in (repository / "workflow/lib").rglob("*.py")
        for name in imported(path)
    }
    needed -= {"imuloop", *sys.stdlib_module_names}
    names = {d.partition(">")[0].lower() for d in declared["dependencies"]}
    optional = declared["optional-dependencies"]
    readers = {optional[name][0].partition(">")[0] for name in ("dataflash", "ros", "ulog")}
    assert {DISTRIBUTIONS.get(name, name).lower() for name in needed} <= names | readers
    # the workflow manager runs the rules: nothing else is idle
    idle = names - {DISTRIBUTIONS.get(name, name).lower() for name in needed}
    assert idle == {"snakemake"}


def test_who_reads_a_calibration_has_the_library_of_effects(repository):
    # each in a process of its own, as a job is, that has the packages of others already
    code = """if True:
        import os, sys, pyarrow.parquet, pandas, scipy.optimize, scipy.signal
        for module in sys.argv[1:]:
            if not (child := os.fork()):
                __import__(f"imuloop.{module}")
                from imuloop.core.effect import Effect
                os._exit(len(Effect.library) <= 20)
            assert os.waitpid(child, 0)[1] == 0, module
    """
    modules = [
        "board.board",
        "diagnose.diagnose",
        "export.export",
        "report.section",
        "simulate.truth",
    ]
    modules += ["commands.apply", "commands.check", "commands.info"]
    path = {"PYTHONPATH": str(repository / "workflow/lib")}
    command = [sys.executable, "-c", code, *modules]
    done = subprocess.run(command, env=path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
