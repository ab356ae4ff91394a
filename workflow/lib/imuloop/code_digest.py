"""The param `code` of each rule: a job reruns when code that its script reaches changes."""

import ast
import hashlib
from functools import cache
from importlib.metadata import packages_distributions, version
from importlib.util import resolve_name
from pathlib import Path

_LIBRARY = Path(__file__).resolve().parent
_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
# reads the metadata of all that is installed, for a quarter of a second
_distributions = cache(packages_distributions)


def code_digest(script, library=_LIBRARY):
    """Return the SHA-256 of a script, of what it reaches in the library, and of others' versions.

    Reached is what is imported, inside functions too, and the functions and classes that this names
    in its own module; what stands outside of these in a module that is reached, and in its
    packages; every module of a package that walks its own folder; and the schemas that are named.
    Comments and docstrings do not count. `library` is the folder of the package.
    """
    paths, above = Path(library).rglob("*.py"), Path(library).parent
    files = {".".join(each.relative_to(above).with_suffix("").parts): each for each in paths}
    files = {"": Path(script)} | {k.removesuffix(".__init__"): path for k, path in files.items()}
    schemas = {path.name: path for path in Path(library).glob("schemas/*.yaml")}
    found, others, waiting = {}, set(), [("", "*")]
    while waiting:
        module, name = waiting.pop()
        if module in schemas:
            found[module, ""] = hashlib.sha256(schemas[module].read_bytes()).hexdigest()
        elif module not in files:
            others.update(_distributions().get(module.partition(".")[0], ()))
        elif f"{module}.{name}" in files:
            waiting += [(module, ""), (f"{module}.{name}", "*")]
        elif (module, name) not in found:
            parts = [p for p in _parts(files[module], module) if name in ("*", p[0]) or not p[0]]
            reached = [each for *_, own in parts for each in own]
            found[module, name] = [digest for _, digest, _ in parts]
            waiting += [*reached, (module.rpartition(".")[0], "")]
            if "pkgutil" in dict(reached):
                waiting += [(each, "*") for each in files if each.rpartition(".")[0] == module]
    content = sorted(found.items()), [(each, version(each)) for each in sorted(others)]
    return hashlib.sha256(repr(content).encode()).hexdigest()


@cache
def _parts(path, module):
    """Return name, empty but of definitions, digest, and (module, name) used of each statement."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    tree, parts = ast.parse(path.read_bytes(), filename=str(path)), []
    defined = {node.name for node in tree.body if isinstance(node, _DEFINITIONS)}
    for node in tree.body[ast.get_docstring(tree) is not None :]:
        used = []
        for each in ast.walk(node):
            if isinstance(each, _DEFINITIONS) and ast.get_docstring(each) is not None:
                del each.body[0]
            elif isinstance(each, ast.Name) and isinstance(each.ctx, ast.Load):
                used += [(module, each.id)] * (each.id in defined)
            elif isinstance(each, ast.Constant) and str(each.value).endswith(".schema.yaml"):
                used.append((each.value, ""))
            elif isinstance(each, ast.Import):
                used += [(alias.name, "*") for alias in each.names]
            elif isinstance(each, ast.ImportFrom):
                source = resolve_name("." * each.level + (each.module or ""), package)
                used += [(source, alias.name) for alias in each.names]
        digest = hashlib.sha256(ast.dump(node).encode()).hexdigest()
        parts.append((node.name if isinstance(node, _DEFINITIONS) else "", digest, used))
    return parts
