"""The origin of a report: the data by which it can be made again."""

import platform
import subprocess
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

# packages whose numbers or pictures are in a report
PACKAGES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "vqf")


def provenance(release, repository, command, config):
    """Return the origin of a report, by which it can be made again, a dict.

    Its keys are ``imuloop``, ``commit``, ``command``, ``versions`` (of Python and of packages) and
    ``config``. `release` is the version of imuloop, `repository` the folder of the workflow,
    `command` the command that was run, and `config` the resolved config of all devices.
    """
    versions = {"python": platform.python_version()}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    program = {"imuloop": release, "commit": commit(repository), "command": command}
    return program | {"versions": versions, "config": config}


def commit(repository):
    """Return the git commit of the workflow as text, or the version of imuloop if it is installed.

    `repository` is the folder of the workflow. The text says if files differ from the commit, and
    if the commit is not known.
    """
    if not (Path(repository) / "Snakefile").exists():
        try:
            return f"imuloop {version('imuloop')}, installed"
        except PackageNotFoundError:
            return "not known"
    try:
        head = run_git(repository, "rev-parse", "HEAD")
        changed = run_git(repository, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return "not known: no git checkout"
    return f"{head} with local changes" if changed else head


def run_git(repository, *command):
    """Return the output of a git command, text.

    `repository` is the folder of a checkout, which may belong to another user, and `command` are
    the words after ``git``. Raises a CalledProcessError if git fails.
    """
    git = ["git", "-c", f"safe.directory={repository}", "-C", str(repository)]
    done = subprocess.run([*git, *command], check=True, capture_output=True, text=True)
    return done.stdout.strip()
