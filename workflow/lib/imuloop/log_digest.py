"""The param `logs` of the ingest: a log is read again when its content is another."""

import hashlib
from contextlib import suppress
from functools import cache
from pathlib import Path

from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json, write_json


def log_digests(paths, record):
    """Return the SHA-256 of each file; only a file whose state changed since the last call is read.

    The state is size, times and inode. It alone cannot tell a changed log from a copied one.

    Parameters
    ----------
    paths : list of path-like
        Files, relative to the working folder.
    record : path-like
        JSON file with the state and the SHA-256 of each file.
    """
    known, changed = _known(record), False
    for path in map(str, paths):
        found = Path(path).stat()
        state = [found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino]
        if known.get(path, [])[:-1] != state:
            with open(path, "rb") as file:
                known[path] = [*state, hashlib.file_digest(file, "sha256").hexdigest()]
            changed = True
    if changed:
        # in a folder that may not be written the files are read each time
        with suppress(OSError, ImuloopError):
            write_json(record, known)
    return [known[str(path)][-1] for path in paths]


@cache
def _known(record):
    with suppress(OSError, ImuloopError):
        return read_json(record)
    return {}
