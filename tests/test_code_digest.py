"""The digest changes with the packages that a stage uses, and with nothing else."""

import ast
import re
from itertools import count

import pytest

from imuloop import code_digest as module
from imuloop.code_digest import code_digest

CHAIN = """def every():
    from imuloop.stage import f
    from imuloop.other import g
"""
STAGE = """def f(x):
    'Old.'
    from imuloop.lazy.late import h

    return h(x) + 1
"""
FILES = {
    "lib/chain.py": CHAIN,
    "lib/core/files.py": "c = 1\n",
    "lib/stage/__init__.py": '"""A package."""\n',
    "lib/stage/a.py": STAGE,
    "lib/stage/b.py": "y = 1\n",
    "lib/lazy/late.py": "import numpy.linalg\n\n\ndef h(x):\n    return 2 * x in {'a', 'b'}\n",
    "lib/named/d.py": "d = 1\n",
    "lib/other/e.py": "import imuloop.stage.a\n\ne = 1\n",
    "stage.py": '"""A script."""\nfrom imuloop.chain import stage\n\nstage(1)\n',
}
# text that is appended to a file, or a new file
SAME = [
    ("lib/stage/b.py", "# a comment\n\n"),
    # what chain.py imports is of its other stages
    ("lib/other/e.py", "e = 2\n"),
    ("lib/new/n.py", "n = 1\n"),
]
OTHER = [
    ("stage.py", "x = 1\n"),
    ("lib/chain.py", "x = 1\n"),
    ("lib/core/files.py", "x = 1\n"),
    ("lib/stage/b.py", "x = 1\n"),
    ("lib/stage/within/new.py", "x = 1\n"),
    ("lib/lazy/late.py", "x = 1\n"),
    ("lib/named/d.py", "x = 1\n"),
    ("lib/stage/names.yaml", "x: 1\n"),
]


@pytest.fixture
def digest(tmp_path):
    """Return a function: digest of the stage in a fresh copy of FILES, some of them changed."""
    serial = count()

    def of(changes=()):
        found = tmp_path / str(next(serial))
        for name, text in {**FILES, **dict(changes)}.items():
            (found / name).parent.mkdir(parents=True, exist_ok=True)
            (found / name).write_text(text)
        return code_digest(found / "stage.py", "named", library=found / "lib")

    return of


def test_a_stage_depends_on_its_packages_alone(digest):
    def after(file, text):
        return digest({file: FILES.get(file, "") + text})

    assert {after(*change) for change in SAME} == {digest()}
    changed = {after(*change) for change in OTHER}
    assert len(changed) == len(OTHER) and digest() not in changed


def test_an_update_of_a_package_that_is_used_reruns_the_job(digest, monkeypatch):
    """Protects: results of an older numpy are not kept with results of a newer one."""
    before, version = digest(), module._version
    for name in ("scipy", "numpy"):
        updated = {name: "0.0.1"}
        monkeypatch.setattr(
            module, "_version", lambda each, of=updated: of.get(each, version(each))
        )
        assert (digest() == before) is (name == "scipy")


def test_each_rule_names_the_packages_that_its_stage_imports(repository):
    tree = ast.parse((repository / "workflow/lib/imuloop/chain.py").read_text())
    used = {node.name: names_in(node) for node in tree.body if isinstance(node, ast.FunctionDef)}
    rules = "".join(path.read_text() for path in repository.glob("workflow/rules/*.smk"))
    scripts = re.findall(r'code\("(\w+)\.py"((?:, "\w+")*)\)', rules)
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
    found = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return found | {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
