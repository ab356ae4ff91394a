"""Digest of the code that a job runs, so that an edit reruns what it reaches and nothing else."""

import ast
import hashlib
from functools import cache
from pathlib import Path

_LIBRARY = Path(__file__).resolve().parent


def code_digest(script, library=_LIBRARY):
    """Return the SHA-256 of a script and of every module of the library that it reaches.

    Hashed are the syntax trees without docstrings and positions: a comment, a docstring or the
    layout changes nothing. Followed are all ``import`` statements, those inside functions too;
    a module counts with the ``__init__`` of its packages, and a package whose ``__init__`` walks
    its own folder (``pkgutil``) counts with every module in it.

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
    tree, imports = _read(Path(script), "")
    digest = hashlib.sha256(tree.encode())
    reached, waiting = {}, list(imports)
    while waiting:
        name = waiting.pop()
        path = _module_path(library, name)
        if path is None or name in reached:
            continue
        is_package = path.name == "__init__.py"
        parent = name.rpartition(".")[0]
        reached[name], imports = _read(path, name if is_package else parent)
        waiting += [*imports, parent]
        if is_package and "pkgutil" in imports:
            waiting += [f"{name}.{module.stem}" for module in path.parent.glob("[!_]*.py")]
    for name in sorted(reached):
        digest.update(f"\n{name}\n{reached[name]}".encode())
    return digest.hexdigest()


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
def _read(path, package):
    """Return a file's syntax tree as text, without docstrings, and the names it imports."""
    words, imports = [], []

    def visit(node):
        words.append(type(node).__name__)
        if isinstance(node, ast.Import):
            imports.extend(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # what is imported from a package may be a module too
            module = _absolute(node, package)
            imports.extend([module, *(f"{module}.{alias.name}" for alias in node.names)])
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

    visit(ast.parse(path.read_bytes(), filename=str(path)))
    return " ".join(words), tuple(imports)


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
