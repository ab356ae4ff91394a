"""The licences of what `make setup-dev` installs: ``make licences`` writes build/licences.md.

Names come from the lock files, licences from the metadata of the installed packages.
"""

import re
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOCKS = ("locks/build.lock", "locks/users.lock", "locks/dev.lock")
NOT_STATED = "not stated"
NOT_INSTALLED = "not installed on this platform"
HEAD = "# Licences of the packages in .venv\n\n| licence | packages |\n|---|---|\n"


def pins(text):
    """Return the name of each package of a lock file."""
    return re.findall(r"^([\w.-]+)==", text, re.M)


def licence(name):
    """Return the licence that a distribution states, in a few words."""
    try:
        package = distribution(name)
    except PackageNotFoundError:
        return NOT_INSTALLED
    if expression := package.metadata.get("License-Expression"):
        return expression
    classifiers = package.metadata.get_all("Classifier") or []
    if named := [c.rpartition(" :: ")[2] for c in classifiers if c.startswith("License :: ")]:
        return ", ".join(name.removesuffix(" License") for name in named)
    files = [f for f in package.files or () if re.match("licen[cs]e|copying", f.name, re.I)]
    texts = [package.metadata.get("License") or "", *(f.read_text() for f in files)]
    lines = [line.strip() for text in texts for line in text.strip().splitlines()[:1]]
    stated = [line for line in lines if re.match(r"[A-Za-z]", line) and len(line) < 60]
    return next(iter(stated), NOT_STATED).removesuffix(" License")


def licences():
    """Return the licence of each package of the lock files, by name."""
    names = {name for lock in LOCKS for name in pins((ROOT / lock).read_text())}
    return {name: licence(name) for name in sorted(names)}


def table(licences):
    """Return the page: one line per licence."""
    lines = [
        f"| {stated} | {', '.join(name for name in licences if licences[name] == stated)} |\n"
        for stated in sorted(set(licences.values()))
    ]
    return HEAD + "".join(lines)


if __name__ == "__main__":
    path = ROOT / "build/licences.md"
    path.parent.mkdir(exist_ok=True)
    path.write_text(table(licences()), encoding="utf-8")
    print(path)
