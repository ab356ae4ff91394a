"""What made a report: commit, command, versions, resolved config."""

import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version

# packages whose numbers or pictures are in a report
PACKAGES = ("numpy", "scipy", "pandas", "pyarrow", "allantools", "PyWavelets", "matplotlib")


def provenance(repository, command, config):
    """Return what is needed to make a report again.

    Parameters
    ----------
    repository : path-like
        Folder of the workflow.
    command : str
        Command that was run.
    config : dict
        Resolved config of all devices.

    Returns
    -------
    dict
        ``commit``, ``command``, ``versions`` and ``config``.
    """
    return {
        "commit": commit(repository),
        "command": command,
        "versions": {"python": platform.python_version(), **versions(PACKAGES)},
        "config": config,
    }


def commit(repository):
    """Return the commit of a checkout, marked if files differ from it."""
    try:
        found = _git(repository, "rev-parse", "HEAD")
        changed = _git(repository, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return "not known: no git checkout"
    return f"{found} with local changes" if changed else found


def _git(repository, *arguments):
    # a checkout of another user's is read all the same
    trust = ["-c", f"safe.directory={repository}"]
    command = ["git", *trust, "-C", str(repository), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def versions(packages):
    """Return the version of each package that is installed."""
    found = {}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
