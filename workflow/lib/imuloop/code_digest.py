"""Digest of the code that a job runs, the param `code` of its rule: an edit reruns its reach."""

import ast
import hashlib
import re
from functools import cache
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import NamedTuple

_LIBRARY = Path(__file__).resolve().parent
_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
# a name that is read, in a syntax tree as text
_READ = re.compile(r"Name\(id='(\w+)'(?!, ctx=(?:Store|Del))")


def code_digest(script, library=_LIBRARY):
    """Return the SHA-256 of a script and of all code of the library that it reaches.

    Hashed are the syntax trees without docstrings and positions. Followed are all ``import``
    statements, those inside functions too. Of a module from which names are imported, those
    functions and classes count, what they name in the module, and what stands outside of functions
    and classes. A module counts with the ``__init__`` of its packages, and a package whose
    ``__init__`` walks its own folder (``pkgutil``) counts with every module in it. Of the packages
    of others that are imported on the way the installed versions are hashed.

    `library` is the folder of the package, whose name is the package's.
    """
    library = Path(library)
    own = _parts(Path(script), "")
    found = {("", place): part.digest for place, part in enumerate(own)}
    reached, waiting = set(), [each for part in own for each in part.imports]
    others = set()
    while waiting:
        module, name = waiting.pop()
        if name and _module_path(library, f"{module}.{name}"):
            # what is imported from a package is a module
            waiting += [(module, ""), (f"{module}.{name}", None)]
            continue
        path = _module_path(library, module)
        if path is None:
            others.add(module.partition(".")[0])
            continue
        if (module, name) in reached:
            continue
        reached.add((module, name))
        is_package, parent = path.name == "__init__.py", module.rpartition(".")[0]
        waiting.append((parent, ""))
        for place, part in enumerate(_parts(path, module if is_package else parent)):
            if name is None or part.name in (None, name):
                found[module, place] = part.digest
                waiting += [*part.imports, *((module, used) for used in part.uses)]
                if is_package and "pkgutil" in {source for source, _ in part.imports}:
                    beside = path.parent.glob("[!_]*.py")
                    waiting += [(f"{module}.{each.stem}", None) for each in beside]
    content = (sorted(found.items()), _versions(others))
    return hashlib.sha256(repr(content).encode()).hexdigest()


def _versions(packages):
    """Return the installed version of each package that is not Python's own, by distribution."""
    found = {each for name in packages for each in _distributions().get(name, ())}
    return [(each, version(each)) for each in sorted(found)]


# reads the metadata of all that is installed, for a quarter of a second
_distributions = cache(packages_distributions)


class _Part(NamedTuple):
    """A function or class of a module by its name, or what stands outside of them, name None."""

    name: str | None
    digest: str
    imports: tuple
    uses: frozenset


@cache
def _module_path(library, name):
    """Return the file of a module by its dotted name; None outside the library."""
    first, *rest = name.split(".")
    if first != library.name:
        return None
    path = library.joinpath(*rest)
    candidates = (path / "__init__.py", path.with_suffix(".py"))
    return next((candidate for candidate in candidates if candidate.is_file()), None)


@cache
def _parts(path, package):
    """Return the parts of a file: digest of the tree, (module, name) imported, names used."""
    tree = ast.parse(path.read_bytes(), filename=str(path))
    defined = {node.name for node in tree.body if isinstance(node, _DEFINITIONS)}
    parts = []
    for node in tree.body[bool(tree.body and _is_text(tree.body[0])) :]:
        imports = []
        for each in _statements(node):
            if isinstance(each, _DEFINITIONS) and _is_text(each.body[0]):
                del each.body[0]
            elif isinstance(each, ast.Import):
                imports += [(alias.name, None) for alias in each.names]
            elif isinstance(each, ast.ImportFrom):
                parents = package.split(".")
                start = parents[: len(parents) - each.level + 1] if each.level else []
                module = ".".join(filter(None, [*start, each.module]))
                imports += [(module, alias.name) for alias in each.names]
        name = node.name if isinstance(node, _DEFINITIONS) else None
        code = ast.dump(node)
        uses = defined.intersection(_READ.findall(code)) - {name}
        digest = hashlib.sha256(code.encode()).hexdigest()
        parts.append(_Part(name, digest, tuple(imports), frozenset(uses)))
    return tuple(parts)


def _statements(node):
    """Yield a statement and all that stand inside it; imports and definitions are statements."""
    yield node
    for block in ("body", "handlers", "cases", "orelse", "finalbody"):
        inside = getattr(node, block, ())
        if isinstance(inside, list):
            for each in inside:
                yield from _statements(each)


def _is_text(node):
    return isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str)
