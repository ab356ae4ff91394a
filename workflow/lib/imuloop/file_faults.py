"""Faults of the files that a config names: bad paths and missing files.

The contents of the files are not read.
"""

import os
import re
from pathlib import Path

from imuloop.config import is_stored
from imuloop.core.errors import nearest

# path of the log that the rule simulate writes for a replica, relative to the working folder
SIMULATED = re.compile(r"data/simulated/([^/]+)/([^/]+)\.parquet")


def path_fault(path):
    """Return the fault that makes a path unusable for Snakemake, or None."""
    if not path.isprintable() or path != path.strip():
        return f"{path!a} has a blank at an end or what cannot be printed; rename it"
    if re.search(r"\{.*\}", path):
        return f"{path}: in place of braces Snakemake puts the name of a device; rename it"
    return None


def prior_fault(path, replicas):
    """Return the fault of the file of a prior as text, or None; `replicas` is not used."""
    return path_fault(path) or _local_fault(path, remedy="copy it to another folder")


def file_fault(path, replicas):
    """Return the fault of a file with marks or a reference as text, or None.

    `replicas` has the sessions of each simulated device that the workflow can make, by device.
    """
    return log_fault(path, replicas, folder=False)


def log_fault(path, replicas, folder=True):
    """Return the fault of a log's path as text, or None.

    Parameters
    ----------
    path : str
    replicas : dict of str to list of str
        Sessions of each simulated device that the workflow can make.
    folder : bool, optional
        Whether the path may be a folder of files.
    """
    if (text := path_fault(path)) or is_stored(path):
        return text
    return _local_fault(path, "name the log that it came from", replicas, folder)


def _local_fault(path, remedy, replicas=None, folder=False):
    """Return the fault of a local path that cannot be an input, text, or None.

    `remedy` is the advice for a path that is a result of the workflow. `replicas` has the sessions
    of each simulated device that the workflow can make, by device. If `folder` is true, the path
    may be a folder, whose files are inputs.
    """
    if Path(os.path.normpath(path)).parts[:1] == ("results",):
        return f"{path} is a result of this workflow; {remedy}"
    try:
        if folder and Path(path).is_dir():
            inside = filter(None, map(path_fault, sorted(os.listdir(path))))
            return next((f"in {path}, {text}" for text in inside), None)
        if not Path(path).is_file():
            return _missing(path, replicas or {})
    except OSError as error:
        # a name too long, a folder that may not be entered
        return f"cannot be read: {error.strerror}"
    return None if os.access(path, os.R_OK) else f"{path} cannot be read: permission denied"


def _missing(path, replicas):
    """Return the fault of a path without a regular file, or None if the workflow makes the file.

    `replicas` has the sessions of each simulated device that the workflow can make, by device.
    """
    if simulated := SIMULATED.fullmatch(os.path.normpath(path)):
        replica, session = simulated.groups()
        if replica not in replicas:
            return f"there is no replica '{replica}'{nearest(replica, replicas, 0.6)}"
        if session not in replicas[replica]:
            known = replicas[replica]
            return f"{replica} has no session '{session}'{nearest(session, known, 0.6)}"
        return None
    if Path(path).is_dir():
        return f"{path} is a folder, not a file"
    if Path(path).is_symlink() and not Path(path).exists():
        return f"{path} is a link that leads to no file"
    return f"{path} is not a regular file" if Path(path).exists() else f"there is no file {path}"
