"""The param `code` of each Snakemake rule: a job reruns if code that its stage uses changes."""

import hashlib
import marshal
import re
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import CodeType

import yaml

_LIBRARY = Path(__file__).resolve().parent
# an import: of a package of the library, of a module next to these packages, or of another package
_IMPORT = re.compile(r"^ *(?:from|import) (?:imuloop\.)?(\w+)[\w.]*(?= import | as |$)", re.M)


def code_digest(script, *packages, without=(), library=_LIBRARY):
    """Return the SHA-256 of the code that a stage uses, text: it changes only if this code does.

    `script` is the path of the script of the workflow that runs the stage. `packages` are the names
    of further packages of the library imuloop, whose folder is `library`. The digest covers:

    - the script;
    - all modules and YAML tables of these packages: the one with the name of the script, core,
      `packages`, and each package that the script or one of these packages imports;
    - imported modules next to the packages, such as chain.py;
    - the versions of packages that are not part of the library.

    Comments, the text of docstrings, and assertions do not count, nor do modules in the package of
    the script whose names are in `without`.
    """
    script, library = Path(script), Path(library)
    digests, waiting = {"": _digest(script)}, {script.stem, "core", *packages, *_imports(script)}
    while waiting:
        name = waiting.pop()
        if paths := sorted((library / name).rglob("*.py")):
            paths = [p for p in paths if name != script.stem or p.stem not in without]
            paths += sorted((library / name).rglob("*.yaml"))
            digests[name] = [(path.name, _digest(path)) for path in paths]
            waiting.update(*map(_imports, paths))
        elif (path := library / f"{name}.py").is_file():
            # the imports of such a module do not count: chain.py imports all stages
            digests[name] = _digest(path)
        else:
            digests[name] = _version(name)
        waiting -= {*digests}
    return hashlib.sha256(repr(sorted(digests.items())).encode()).hexdigest()


@cache
def _imports(path):
    """Return the names of the packages and modules that a Python file imports, a set.

    `path` is the path of the file. A module of a package of imuloop counts as this package.
    """
    return {*_IMPORT.findall(path.read_text(encoding="utf-8"))}


@cache
def _digest(path):
    """Return a text that changes with the content of a YAML file, or the code of a Python file.

    `path` is the path of the file. Comments and docstrings of Python do not count.
    """
    if path.suffix == ".yaml":
        return repr(yaml.safe_load(path.read_text(encoding="utf-8")))
    code = compile(path.read_bytes(), "", "exec", dont_inherit=True, optimize=2)
    return hashlib.sha256(marshal.dumps(_without_lines(code), 2)).hexdigest()


def _without_lines(code):
    """Return a copy of the code object `code` of Python without its line numbers.

    A new comment moves the lines below it, and must not change the digest.
    """
    inner = tuple(_without_lines(c) if isinstance(c, CodeType) else c for c in code.co_consts)
    return code.replace(co_consts=inner, co_linetable=b"", co_firstlineno=1)


@cache
def _version(package):
    """Return the version of an installed package, text, or None if no such package is installed.

    `package` is the name by which it is imported. The modules of Python itself give None.
    """
    try:
        return version({"yaml": "pyyaml"}.get(package, package))
    except PackageNotFoundError:
        return None
