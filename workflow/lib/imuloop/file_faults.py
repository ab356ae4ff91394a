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
    """Return the reason, text, if Snakemake cannot use `path`, a text; None if it can."""
    if not path.isprintable() or path != path.strip():
        return f"{path!a} has a blank at an end or what cannot be printed; rename it"
    if re.search(r"\{.*\}", path):
        return f"{path}: in place of braces Snakemake puts the name of a device; rename it"
    return None


def file_fault(path, replicas, folder=False):
    """Return the reason, text, if a path cannot be an input of the workflow; None if it can.

    Parameters
    ----------
    path : str
        The path as the config names it.
    replicas : dict of str to list of str
        Names of the sessions of each replica, a simulated device that the workflow can make.
    folder : bool, optional
        Whether the path may be a folder, whose files are inputs.
    """
    if (text := path_fault(path)) or is_stored(path):
        return text
    if Path(os.path.normpath(path)).parts[:1] == ("results",):
        return f"{path} is a result of this workflow; name its source, or copy it out of results"
    if simulated := SIMULATED.fullmatch(os.path.normpath(path)):
        names = [f"{replica}/{session}" for replica in replicas for session in replicas[replica]]
        name = "/".join(simulated.groups())
        return None if name in names else f"there is no replica '{name}'{nearest(name, names)}"
    try:
        if folder and Path(path).is_dir():
            faults = filter(None, map(path_fault, sorted(os.listdir(path))))
            return next((f"in {path}, {text}" for text in faults), None)
        if not Path(path).exists():
            return f"there is no file {path}"
    except OSError as error:
        # a name too long, a folder that may not be entered
        return f"cannot be read: {error.strerror}"
    if not Path(path).is_file():
        return f"{path} is not a regular file"
    return None if os.access(path, os.R_OK) else f"{path} cannot be read: permission denied"
