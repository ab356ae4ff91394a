"""The param `logs` of the rule ingest: a log is ingested again if its content has changed."""

import hashlib
import json
from contextlib import suppress
from functools import cache
from pathlib import Path


def log_digests(paths, record):
    """Return the SHA-256 of each file of a log, a list of text.

    Only files whose state has changed since the last call are read. The state is size, times and
    inode. It changes with the content, and also if the same log is copied again.

    Parameters
    ----------
    paths : list of path-like
        Files, relative to the working folder.
    record : path-like
        File that remembers the results: a line for each file that was read, with its path, state
        and SHA-256, as JSON. A later line replaces an earlier one. It is made if it does not exist.
    """
    digests = _read_record(record)
    for path in map(str, paths):
        status = Path(path).stat()
        state = [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
        if digests.get(path, [])[:-1] != state:
            with open(path, "rb") as file:
                digests[path] = [*state, hashlib.file_digest(file, "sha256").hexdigest()]
            # in a folder that may not be written the files are read each time
            with suppress(OSError):
                Path(record).parent.mkdir(parents=True, exist_ok=True)
                with open(record, "a") as file:
                    file.write(json.dumps([path, digests[path]]) + "\n")
    return [digests[str(path)][-1] for path in paths]


@cache
def _read_record(record):
    """Return the states and digests in a record of `log_digests`, a dict by path of a log file.

    A value is a list: the state, four numbers, and the SHA-256. `record` is the path of the record.
    Without this file the dict is empty.
    """
    digests = {}
    with suppress(OSError):
        for line in Path(record).read_text().splitlines():
            # a run that was killed may have left half a line
            with suppress(ValueError):
                digests.update([json.loads(line)])
    return digests
