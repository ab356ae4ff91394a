"""The licences of what `make setup` installs: ``make licences`` writes the table of licences.md.

Names are those of the lock files, licences those of the installed packages' metadata. What is not
installed here, as it is for another platform, keeps what the document says.
"""

import re
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

HERE = Path(__file__).resolve().parent
LOCKS = ("requirements-build.lock", "requirements.lock")
NOT_STATED = "not stated"
RULE = "|---|---|\n"


def pins(text):
    """Return the name of each package of a lock file."""
    return re.findall(r"^([\w.-]+)==", text, re.M)


def licence(found):
    """Return the licence that a distribution states, in a few words."""
    if expression := found.metadata.get("License-Expression"):
        return expression
    classifiers = found.metadata.get_all("Classifier") or []
    if named := [c.rpartition(" :: ")[2] for c in classifiers if c.startswith("License :: ")]:
        return ", ".join(name.removesuffix(" License") for name in named)
    files = [f for f in found.files or () if re.match("licen[cs]e|copying", f.name, re.I)]
    texts = [found.metadata.get("License") or "", *(f.read_text() for f in files)]
    lines = [line.strip() for text in texts for line in text.strip().splitlines()[:1]]
    stated = [line for line in lines if re.match(r"[A-Za-z]", line) and len(line) < 60]
    return next(iter(stated), NOT_STATED).removesuffix(" License")


def licences(locks, before):
    """Return the licence of each package of lock files.

    Parameters
    ----------
    locks : sequence of str
        Their texts.
    before : dict of str to str
        Licences as they were, for what is not installed here.
    """
    found = {}
    for name in sorted({name for text in locks for name in pins(text)}):
        found[name] = before.get(name, NOT_STATED)
        with suppress(PackageNotFoundError):
            found[name] = licence(distribution(name))
    return found


def parsed(document):
    """Return what stands before the document's table, and the licence of each package."""
    head, rule, table = document.partition(RULE)
    lines = [line.strip("| ").split(" | ") for line in table.splitlines()]
    return head + rule, {name: stated for stated, names in lines for name in names.split(", ")}


def table(found):
    """Return the table's lines, one per licence."""
    lines = [
        f"| {stated} | {', '.join(name for name in found if found[name] == stated)} |\n"
        for stated in sorted(set(found.values()))
    ]
    return "".join(lines)


if __name__ == "__main__":
    path = HERE / "licences.md"
    head, old = parsed(path.read_text())
    locks = [(HERE.parent / name).read_text() for name in LOCKS]
    path.write_text(head + table(licences(locks, old)))
