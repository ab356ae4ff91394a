"""Result files, written to a temporary file and renamed: a kill leaves none half-written."""

import errno
import json
import math
import os
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from imuloop.core.errors import ImuloopError, MachineFault

# no room on the disk, in the quota, in the limit of the process
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def replaced(path):
    """Yield a temporary path beside `path`, which replaces it when the block succeeds.

    It is removed if the block raises; one that a kill left is the next writer's. A MachineFault if
    the disk is full.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.partial")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        if error.errno not in _FULL:
            raise
        raise MachineFault(f"{path} cannot be written: {os.strerror(error.errno)}") from error
    finally:
        temporary.unlink(missing_ok=True)


def refuse_overwriting(targets, sources):
    """Refuse to overwrite an input, also by way of a link, a folder or another case.

    The ImuloopError names both.
    """
    read = {key: each for source in sources for key, each in _files_at(source).items()}
    for target in targets:
        for key, each in _files_at(target).items():
            if key in read:
                same = f" ({each} is the same file)" if str(each) != str(target) else ""
                raise ImuloopError(
                    f"{target}: writing there would destroy {read[key]}, which is read: "
                    f"give another name{same}"
                )


def _files_at(path):
    """Return each file at a path, of a folder all below, by what tells files apart."""
    files, folders, waiting = {}, set(), [Path(path)]
    for each in waiting:
        # what is not there, or may not be looked into, cannot be read either
        with suppress(OSError):
            state = each.stat()
            key = state.st_dev, state.st_ino
            if not each.is_dir():
                files[key] = each
            elif key not in folders:
                # a link may lead back up
                folders.add(key)
                waiting += each.iterdir()
    return files


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


def read_json(path, most=None):
    """Return the content of a JSON file of at most `most` bytes.

    An ImuloopError if it is no regular file, is larger, or is no JSON: no UTF-8, nested too deep,
    with a key given twice or NaN; a FileNotFoundError if it is not there.
    """
    path = Path(path)
    size = path.stat().st_size
    # a pipe would be waited for, a device read for ever
    if not path.is_file():
        raise ImuloopError(f"{path}: not a regular file")
    if most and size > most:
        raise ImuloopError(f"{path}: {size} bytes, more than the {most} of any such file")
    try:
        return json.loads(
            path.read_text(encoding="utf-8"), object_pairs_hook=_object, parse_constant=_constant
        )
    except (ValueError, RecursionError) as error:
        raise ImuloopError(f"{path}: no JSON: {error}") from error


def _object(pairs):
    content = {}
    for name, value in pairs:
        if name in content:
            raise ValueError(f"the key '{name}' is given twice")
        content[name] = value
    return content


def _constant(name):
    raise ValueError(f"{name} is no number")
