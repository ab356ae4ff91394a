"""The licences of what `make setup` installs: ``make licences`` writes the table of licences.md.

Names and versions are those of the lock files, licences those of the installed packages' metadata.
What is not installed here, as it is for another platform or Python, keeps what the document says.
"""

import re
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

HERE = Path(__file__).resolve().parent
LOCKS = ("requirements-build.lock", "requirements.lock")
NOT_STATED = "not stated"
RULE = "|---|---|---|\n"


def pins(text):
    """Return (name, version) of each package of a lock file."""
    return re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.M)


def licence(found):
    """Return the licence that a distribution states, in a few words."""
    if expression := found.metadata.get("License-Expression"):
        return expression
    classifiers = found.metadata.get_all("Classifier") or []
    if named := [c.rpartition(" :: ")[2] for c in classifiers if c.startswith("License :: ")]:
        return ", ".join(named)
    files = [f for f in found.files or () if re.match("licen[cs]e|copying", f.name, re.I)]
    texts = [found.metadata.get("License") or "", *(f.read_text() for f in files)]
    lines = [line.strip() for text in texts for line in text.strip().splitlines()[:1]]
    stated = [line for line in lines if re.match(r"[A-Za-z]", line) and len(line) < 60]
    return next(iter(stated), NOT_STATED)


def rows(locks, before=()):
    """Return (package, version, licence) of each package of lock files.

    Parameters
    ----------
    locks : sequence of str
        Their texts.
    before : sequence of tuple
        Rows as they were, for what is not installed here.
    """
    known = {name: stated for name, _, stated in before}
    found = []
    for name, version in sorted({pin for text in locks for pin in pins(text)}):
        stated = known.get(name, NOT_STATED)
        with suppress(PackageNotFoundError):
            installed = distribution(name)
            if installed.version == version or stated == NOT_STATED:
                stated = licence(installed)
        found.append((name, version, stated))
    return found


def parsed(document):
    """Return what stands before the document's table, and the table's rows."""
    head, rule, table = document.partition(RULE)
    return head + rule, [tuple(line.strip("| ").split(" | ")) for line in table.splitlines()]


def table(found):
    """Return rows as the document has them."""
    return "".join(f"| {' | '.join(row)} |\n" for row in found)


if __name__ == "__main__":
    path = HERE / "licences.md"
    head, old = parsed(path.read_text())
    path.write_text(head + table(rows([(HERE.parent / name).read_text() for name in LOCKS], old)))
