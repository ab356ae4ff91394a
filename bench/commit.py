"""The commit that figures are made of."""

import subprocess
from pathlib import Path

FOLDER = Path(__file__).parent


def commit(folder=FOLDER):
    """Return the short hash of the code's commit, and whether the code was changed since.

    The documents that figures are written into are none of it.
    """

    def git(*words):
        made = subprocess.run(
            ["git", *words], capture_output=True, text=True, cwd=folder, check=False
        )
        return made.stdout.strip()

    made_of = git("rev-parse", "--short", "HEAD") or "unknown"
    edited = git("status", "--porcelain", "--untracked-files=no", "--", ":/", ":(top,exclude)docs")
    return f"{made_of}, changed" if edited else made_of
