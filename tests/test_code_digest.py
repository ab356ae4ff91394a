"""The digest changes with the packages that a stage uses, and with nothing else."""

import ast
import re
import shutil

import pytest

from imuloop import code_digest as module
from imuloop.code_digest import code_digest

# file of the library to which something is added, and whether the segmentation runs again
CHANGES = {
    "segment/segment.py": "X = 1\n",
    "segment/within/new.py": "X = 1\n",
    "segment/names.yaml": "x: 1\n",
    "core/files.py": "X = 1\n",
    "chain.py": "X = 1\n",
}
NO_CHANGES = {
    "segment/segment.py": "# a comment\n\n",
    # what chain.py imports is of its other stages
    "report/report.py": "X = 1\n",
    "new/new.py": "X = 1\n",
}


@pytest.mark.parametrize(
    ("file", "text", "again"),
    [(*item, True) for item in CHANGES.items()] + [(*item, False) for item in NO_CHANGES.items()],
)
def test_a_stage_depends_on_its_packages_alone(repository, tmp_path, file, text, again):
    script, unused = repository / "scripts/segment.py", shutil.ignore_patterns("__pycache__")
    library = shutil.copytree(repository / "workflow/lib/imuloop", tmp_path / "lib", ignore=unused)
    (library / file).parent.mkdir(exist_ok=True)
    with open(library / file, "a") as added:
        added.write(text)
    assert (code_digest(script, library=library) != code_digest(script)) == again


def test_modules_that_a_job_does_not_use_do_not_count(repository, tmp_path):
    library = shutil.copytree(repository / "workflow/lib/imuloop", tmp_path / "lib")
    with open(library / "ingest/ros.py", "a") as added:
        added.write("X = 1\n")
    script = repository / "scripts/ingest.py"
    for without, again in (((), True), (("phone",), True), (("ros",), False)):
        edited = code_digest(script, without=without, library=library)
        assert (edited != code_digest(script, without=without)) == again


def test_an_update_of_a_package_that_is_used_reruns_the_job(repository, monkeypatch):
    """Protects: results of an older numpy are not kept with results of a newer one."""
    script, version = repository / "scripts/segment.py", module._version
    before = code_digest(script)
    for name, again in (("matplotlib", False), ("numpy", True)):
        monkeypatch.setattr(module, "_version", lambda item, n=name: item == n or version(item))
        assert (code_digest(script) != before) == again


def test_each_rule_names_the_packages_that_its_stage_imports(repository):
    tree = ast.parse((repository / "workflow/lib/imuloop/chain.py").read_text())
    used = {node.name: names_in(node) for node in tree.body if isinstance(node, ast.FunctionDef)}
    rules = "".join(path.read_text() for path in repository.glob("workflow/rules/*.smk"))
    scripts = re.findall(r'code\("(\w+)\.py"((?:, "\w+")*)[,)]', rules)
    assert len(scripts) == len([*repository.glob("scripts/*.py")]) - 1  # not of ingest_fetch
    for stem, named in scripts:
        waiting, seen = names_in(ast.parse((repository / f"scripts/{stem}.py").read_text())), set()
        while waiting - seen:
            seen |= waiting
            waiting = set().union(*(used.get(name, ()) for name in waiting))
        needed = {name.split(".")[1] for name in seen if name.startswith("imuloop.")}
        beside = {stem, "core", "chain", "job_log"}
        assert needed - beside <= set(re.findall(r"\w+", named)), stem


def names_in(tree):
    """Return the names that code reads, and the modules that it imports."""
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return names | {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
