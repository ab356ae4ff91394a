"""Tables in Markdown, shares with their intervals, and the artefact that a tool leaves."""

import os
import platform
import re
import subprocess
from pathlib import Path

import numpy as np
import scipy
from scipy.stats import beta

REPOSITORY = Path(__file__).resolve().parents[1]
# not in the repository: figures are of the commit that made them
ARTEFACTS = REPOSITORY / "build/bench"


def table(header, rows):
    """Return a table in Markdown; columns after the first are numbers."""
    lines = ["| " + " | ".join(map(str, line)) + " |" for line in (header, *rows)]
    lines.insert(1, "|---|" + "--:|" * (len(header) - 1))
    return "\n".join(lines)


def share(part, whole):
    """Return a share with its 95 % interval after Clopper and Pearson."""
    if not whole:
        return "–"
    low = beta.ppf(0.025, part, whole - part + 1) if part else 0.0
    high = beta.ppf(0.975, part + 1, whole - part) if part < whole else 1.0
    return f"{part / whole:.0%} ({part} of {whole}; {low:.0%} to {high:.0%})"


def bound_text(good):
    """Return whether a bound is met, as text; None where nothing is required."""
    return "–" if good is None else "yes" if good else "**no**"


def commit():
    """Return the short hash of the code's commit, and whether the code was changed since."""

    def git(*words):
        run = subprocess.run(["git", *words], capture_output=True, text=True, cwd=REPOSITORY)
        return run.stdout.strip()

    made_of = git("rev-parse", "--short", "HEAD") or "unknown"
    return f"{made_of}, changed" if git("status", "--porcelain", "-uno") else made_of


def machine():
    """Return the machine and what computes on it, in a line; neither its name nor a path."""
    models = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    return (
        f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores, {memory:.0f} GB, "
        f"{platform.system()}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"scipy {scipy.__version__}"
    )


def publish(name, title, text, made_of=None):
    """Print figures and write them to ``build/bench/<name>.md``; its first line has the commit."""
    whole = f"# {title}: commit {made_of or commit()}\n\n{machine()}.\n\n{text.strip()}\n"
    print(whole, flush=True)
    ARTEFACTS.mkdir(parents=True, exist_ok=True)
    (ARTEFACTS / f"{name}.md").write_text(whole, encoding="utf-8")
