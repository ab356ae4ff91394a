"""What made a report: commit, command, versions, resolved config."""

import platform
import re
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from urllib.parse import urlsplit

# packages whose numbers or pictures are in a report
PACKAGES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "vqf")


def provenance(release, repository, command, config):
    """Return what is needed to make a report again: commit, command, versions and config.

    Takes imuloop's version, the folder of the workflow, the command that was run, the resolved
    config of all devices. `repository` is there where the checkout's origin has a web page.
    """
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    made = {"imuloop": release, "commit": commit(repository), "command": command}
    if page := web_page(origin(repository)):
        made["repository"] = page
    return made | {"versions": found, "config": config}


def commit(repository):
    """Return the commit of a checkout, marked if files differ from it, or the version installed."""
    if not (Path(repository) / "Snakefile").exists():
        try:
            return f"imuloop {version('imuloop')}, installed"
        except PackageNotFoundError:
            return "not known"
    try:
        found = run_git(repository, "rev-parse", "HEAD")
        changed = run_git(repository, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return "not known: no git checkout"
    return f"{found} with local changes" if changed else found


def origin(repository):
    """Return the address that a checkout was cloned from, empty where it has none."""
    if not (Path(repository) / ".git").exists():
        return ""
    try:
        return run_git(repository, "remote", "get-url", "origin")
    except (OSError, subprocess.CalledProcessError):
        return ""


def web_page(address):
    """Return the web page of a git address without name and password, None for a path."""
    # git's short form of ssh: user@host:owner/name.git
    short = re.fullmatch(r"[\w.-]+@([\w.-]+):([^/].*)", address)
    try:
        parts = urlsplit("ssh://{}/{}".format(*short.groups()) if short else address)
        port = parts.port
    except ValueError:
        return None
    if parts.scheme not in ("http", "https", "ssh") or not parts.hostname:
        return None
    host = f"{parts.hostname}:{port}" if port and parts.scheme != "ssh" else parts.hostname
    scheme = "https" if parts.scheme == "ssh" else parts.scheme
    return f"{scheme}://{host}{parts.path.rstrip('/').removesuffix('.git')}"


def run_git(repository, *command):
    """Return what a git command prints of a checkout, one of another user's too."""
    git = ["git", "-c", f"safe.directory={repository}", "-C", str(repository)]
    done = subprocess.run([*git, *command], check=True, capture_output=True, text=True)
    return done.stdout.strip()
