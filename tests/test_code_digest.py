"""The digest changes with the code that a script reaches, and with nothing else."""

import shutil
from itertools import count

import pytest

from imuloop import code_digest as module
from imuloop.code_digest import code_digest

FILES = {
    "lib/pack/__init__.py": '"""A package."""\n',
    "lib/pack/a.py": "from pack import b\n\n\ndef f(x):\n    return b.g(x) + 1\n",
    "lib/pack/b.py": "def g(x):\n    from pack.lazy.late import h\n\n    return h(x)\n",
    "lib/pack/lazy/__init__.py": "",
    "lib/pack/lazy/late.py": "def h(x):\n    return 2 * x\n",
    "lib/pack/unused.py": "y = 1\n",
    "lib/pack/found/__init__.py": (
        "from importlib import import_module\n"
        "from pkgutil import iter_modules\n"
        "for _m in iter_modules(__path__):\n"
        "    import_module(f'{__name__}.{_m.name}')\n"
    ),
    "lib/pack/found/one.py": "from . import two\n",
    "lib/pack/found/two.py": "z = 1\n",
    "lib/pack/parts.py": (
        "def used(x):\n    return x\n\n\ndef other(x):\n    return x\n\n\n"
        "class C:\n    other: int\n\n    def m(self):\n        if self.other:\n"
        "            from pack.lazy import late\n        return [used(x) for x in ()]\n"
    ),
    "lib/pack/schemas/one.schema.yaml": "a: 1\n",
    "lib/pack/schemas/two.schema.yaml": "a: 1\n",
    "lib/pack/valid.py": "PATH = 'one.schema.yaml'\n\n\ndef f(x):\n    return PATH\n",
    "valid.py": "from pack.valid import f\n",
    "script.py": '"""A script."""\nimport pack.a\n\nprint(pack.a.f(1))\n',
    "walker.py": "import pack.found\n",
    "part.py": "from pack.parts import C\n",
}


@pytest.fixture
def digest(tmp_path):
    """Return a function: digest of a script in a fresh copy of FILES, some of them changed."""
    serial = count()

    def of(changes=None, script="script.py"):
        folder = tmp_path / str(next(serial))
        for name, text in {**FILES, **(changes or {})}.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        return code_digest(folder / script, folder / "lib/pack")

    return of


def appended(name, text):
    return {name: FILES[name] + text}


SAME = [
    appended("lib/pack/b.py", "# a comment\n"),
    {"lib/pack/a.py": FILES["lib/pack/a.py"].replace("x):\n", 'x):\n    """New."""\n', 1)},
    {"lib/pack/__init__.py": '"""Another sentence."""\n'},
    # not reached
    appended("lib/pack/unused.py", "y = 2\n"),
    {"lib/pack/new.py": "n = 1\n"},
]
OTHER = [
    {"script.py": FILES["script.py"].replace("f(1)", "f(2)")},
    {"lib/pack/a.py": FILES["lib/pack/a.py"].replace("+ 1", "+ 2")},
    # imported inside a function, and the packages on the way
    {"lib/pack/lazy/late.py": "def h(x):\n    return 3 * x\n"},
    appended("lib/pack/lazy/__init__.py", "q = 1\n"),
    appended("lib/pack/__init__.py", "q = 1\n"),
]
# of a package that walks its folder all of it counts
WALKED = [
    {"lib/pack/found/three.py": "w = 1\n"},
    appended("lib/pack/found/one.py", "w = 1\n"),
    appended("lib/pack/found/two.py", "w = 1\n"),
]


def test_the_digest_changes_with_what_reaches_the_job_alone(digest):
    assert {digest(changes) for changes in SAME} == {digest()}
    assert digest() not in {digest(changes) for changes in OTHER}
    assert digest(script="walker.py") not in {digest(changes, "walker.py") for changes in WALKED}


def test_of_a_module_that_counts_which_the_imported_part_reads(digest):
    """Not what has the name of a field; what an import inside a branch reaches."""
    before, source = digest(script="part.py"), FILES["lib/pack/parts.py"]
    other = source.replace("def other(x):\n    return x", "def other(x):\n    return 2 * x")
    used = source.replace("def used(x):\n    return x", "def used(x):\n    return 2 * x")
    assert digest({"lib/pack/parts.py": other}, "part.py") == before
    assert digest({"lib/pack/parts.py": used}, "part.py") != before
    assert digest(appended("lib/pack/lazy/late.py", "q = 1\n"), "part.py") != before


def test_the_schemas_that_a_stage_names_count(digest):
    before = digest(script="valid.py")
    one, two = ("lib/pack/schemas/one.schema.yaml", "lib/pack/schemas/two.schema.yaml")
    assert digest({one: "a: 2\n"}, "valid.py") != before
    assert digest({two: "a: 2\n"}, "valid.py") == before == digest({one: "a: 1\n"}, "valid.py")
    assert digest({one: "a: 2\n"}) == digest()


def test_an_update_of_a_package_that_is_used_reruns_the_job(digest, monkeypatch):
    """Protects: results of an older numpy are not kept beside those of a newer one."""
    uses = {"lib/pack/lazy/late.py": "import numpy.linalg\n\n\ndef h(x):\n    return x\n"}
    without, before, installed = digest(), digest(uses), module.version

    def updated(name):
        return "0.0.1" if name == "numpy" else installed(name)

    monkeypatch.setattr(module, "version", updated)
    assert digest() == without
    assert digest(uses) != before


def test_the_stages_depend_on_their_own_code_only(repository, tmp_path):
    """A change of an effect or of a schema reaches the stages that use it, no other."""
    shutil.copytree(repository / "workflow/lib/imuloop", tmp_path / "imuloop")
    for file in ("effects/other_sensor.py", "schemas/calibration.schema.yaml"):
        with open(tmp_path / "imuloop" / file, "a") as changing:
            changing.write("\nEXTRA: 1\n")

    def changed(stage):
        script = repository / f"scripts/{stage}.py"
        return code_digest(script) != code_digest(script, tmp_path / "imuloop")

    # the calibration validates its result
    assert changed("diagnose") and changed("calibrate")
    assert not any(changed(stage) for stage in ("ingest", "segment", "noise"))
