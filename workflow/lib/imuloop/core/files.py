"""Result files: written beside and renamed, so that a kill leaves nothing half-written."""

import json
import math
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np


@contextmanager
def replaced(path):
    """Give a temporary path beside `path` that takes its place when the block succeeds.

    Parameters
    ----------
    path : path-like
        File to write.

    Yields
    ------
    Path
        Where to write meanwhile; removed if the block raises.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp is private by default; results are for everybody who may read the folder
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def plain(value):
    """Return `value` as JSON can hold it: arrays as lists, not-a-number and infinity as null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_json(path, content):
    """Write `content` as JSON in one step."""
    with replaced(path) as temporary:
        temporary.write_text(json.dumps(plain(content), indent=1, allow_nan=False) + "\n")


def read_json(path):
    """Return the content of a JSON file."""
    return json.loads(Path(path).read_text())
