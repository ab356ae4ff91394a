"""Digest of the code that a job runs, so that an edit reruns what it reaches and nothing else."""

import ast
import hashlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_LIBRARY = Path(__file__).resolve().parent
_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


def code_digest(script, library=_LIBRARY):
    """Return the SHA-256 of a script and of all code of the library that it reaches.

    Hashed are the syntax trees without docstrings and positions: a comment, a docstring or the
    layout changes nothing. Followed are all ``import`` statements, those inside functions too. Of a
    module from which names are imported, those functions and classes count, what they name in the
    module, and what stands outside of functions and classes. A module counts with the ``__init__``
    of its packages, and a package whose ``__init__`` walks its own folder (``pkgutil``) counts with
    every module in it.

    Parameters
    ----------
    script : path-like
        Python file of the job.
    library : path-like, optional
        Folder of the package; its name is the package's name.

    Returns
    -------
    str
        Hexadecimal digest.
    """
    library = Path(library)
    own = _parts(Path(script), "")
    digest = hashlib.sha256("\n".join(part.code for part in own).encode())
    reached, waiting = {}, [each for part in own for each in part.imports]
    while waiting:
        module, name = waiting.pop()
        if name and _module_path(library, f"{module}.{name}"):
            # what is imported from a package is a module
            waiting += [(module, ""), (f"{module}.{name}", None)]
            continue
        path = _module_path(library, module)
        if path is None or (module, name) in reached:
            continue
        is_package = path.name == "__init__.py"
        parent = module.rpartition(".")[0]
        parts = [
            part
            for part in _parts(path, module if is_package else parent)
            if part.name in (None, name) or name is None
        ]
        reached[module, name] = parts
        waiting += [(parent, ""), *(each for part in parts for each in part.imports)]
        waiting += [(module, used) for part in parts for used in part.uses]
        if is_package and "pkgutil" in {source for part in parts for source, _ in part.imports}:
            waiting += [(f"{module}.{each.stem}", None) for each in path.parent.glob("[!_]*.py")]
    code = {
        (module, part.place): part.code for (module, _), parts in reached.items() for part in parts
    }
    for key in sorted(code):
        digest.update(f"\n{key}\n{code[key]}".encode())
    return digest.hexdigest()


@dataclass(frozen=True)
class _Part:
    """A function or class of a module by its name, or what stands outside of them, name None."""

    name: str | None
    place: int
    code: str
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
    """Return the parts of a file: their syntax trees as text, what they import, what they name."""
    body = ast.parse(path.read_bytes(), filename=str(path)).body
    defined = {node.name for node in body if isinstance(node, _DEFINITIONS)}
    parts = []
    for place, node in enumerate(body):
        if place == 0 and _is_text(node):
            continue
        words, imports, names = _read(node, package)
        name = node.name if isinstance(node, _DEFINITIONS) else None
        parts.append(_Part(name, place, words, imports, frozenset(names & defined - {name})))
    return tuple(parts)


def _read(tree, package):
    """Return a syntax tree as text without docstrings, the (module, name) it imports, its names."""
    words, imports, names = [], [], set()

    def visit(node):
        words.append(type(node).__name__)
        if isinstance(node, ast.Import):
            imports.extend((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = _absolute(node, package)
            imports.extend((module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            names.add(node.id)
        for field in _said(type(node)):
            value = getattr(node, field)
            if isinstance(value, list):
                words.append("[")
                docstring = field == "body" and value and _is_text(value[0])
                for item in value[1:] if docstring else value:
                    visit(item) if isinstance(item, ast.AST) else words.append(repr(item))
                words.append("]")
            elif isinstance(value, ast.AST):
                visit(value)
            else:
                words.append(repr(value))

    visit(tree)
    return " ".join(words), tuple(imports), names


@cache
def _said(kind):
    """Return the fields of a kind of node but those that its place tells, or nothing does."""
    return [field for field in kind._fields if field not in ("ctx", "type_comment", "kind")]


def _absolute(node, package):
    """Return the dotted name of the module that an import statement names."""
    parents = package.split(".")
    start = parents[: len(parents) - node.level + 1] if node.level else []
    return ".".join([*start, *([node.module] if node.module else [])])


def _is_text(node):
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
