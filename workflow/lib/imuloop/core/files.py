"""Files: results are written to a temporary file, then renamed, so that none is incomplete."""

import errno
import json
import math
import os
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import yaml

from imuloop.core.errors import ImuloopError, MachineFault

# errors of a full disk, an exhausted quota, and a file larger than the process may write
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def replaced(path):
    """Yield a temporary path in the folder of `path`; a file that is written there replaces `path`.

    The file is replaced at the end of the ``with`` block. If the block raises an error, the
    temporary file is removed and `path` stays as it was. If the process is killed, the temporary
    file stays, and the next writer overwrites it. Raises a MachineFault if the disk is full.
    """
    # of a link the file is replaced that it leads to
    target = Path(path).resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name}.partial")
    try:
        yield temporary
        temporary.replace(target)
    except OSError as error:
        if error.errno not in _FULL:
            raise
        raise MachineFault(f"{path} cannot be written: {os.strerror(error.errno)}") from error
    finally:
        temporary.unlink(missing_ok=True)


def make_folder(path):
    """Make the folder `path` and all folders above it, if they do not exist.

    Raises an ImuloopError if the path, or a folder above, is a file.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise ImuloopError(f"{path}: a file, where a folder is asked for") from error


def refuse_overwriting(targets, sources):
    """Raise an ImuloopError if a file that is to be written is one that is read.

    `targets` are the paths to write, and `sources` the paths to read. A folder stands for all files
    in it. Links, and names in another case, are recognised. The message names both files.
    """
    # files by device and inode, which are the same for all names of a file
    read = {key: path for source in sources for key, path in _files_at(source).items()}
    for target in targets:
        for key, path in _files_at(target).items():
            if key in read:
                same = f" ({path} is the same file)" if str(path) != str(target) else ""
                raise ImuloopError(
                    f"{target}: writing there would destroy {read[key]}, which is read: "
                    f"give another name{same}"
                )


def _files_at(path):
    """Return the file at a path, or all files in the folder there, a dict.

    The keys are pairs of device and inode, which are the same for all names of a file; the values
    are paths. `path` need not exist; the dict is then empty.
    """
    files, folders, waiting = {}, set(), [Path(path)]
    for place in waiting:
        # a file that does not exist, or may not be accessed, cannot be an input
        with suppress(OSError):
            state = place.stat()
            key = state.st_dev, state.st_ino
            if not place.is_dir():
                files[key] = place
            elif key not in folders:
                # a link may lead back up
                folders.add(key)
                waiting += place.iterdir()
    return files


def plain(value):
    """Return a value in a form that JSON can hold.

    `value` is a number, a text, an array, or a dict, list or tuple of such values. Arrays and
    tuples become lists. A number of NumPy becomes a number of Python. Not-a-number and infinity
    become None. The keys of a dict become texts. Any other value stays as it is.
    """
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
    """Write `content`, such as a dict, as a JSON file at `path`.

    Another program sees the old file or the whole new one. Arrays become lists; not-a-number and
    infinity become null.
    """
    with replaced(path) as temporary:
        temporary.write_text(json.dumps(plain(content), indent=1, allow_nan=False) + "\n")


def read_json(path, most=None):
    """Return the content of the JSON file at `path`, such as a dict.

    `most` is the largest size of the file, bytes; by default any size is read. Raises an
    ImuloopError if the file is not a regular file, is larger, or is not valid: not in UTF-8, nested
    too deep, with a repeated key or with NaN. Raises a FileNotFoundError if there is no such file.
    """
    path = Path(path)
    size = path.stat().st_size
    # reading a pipe would wait, reading a device would not end
    if not path.is_file():
        raise ImuloopError(f"{path}: not a regular file")
    if most and size > most:
        raise ImuloopError(f"{path}: {size} bytes, more than the {most} of any such file")
    try:
        return json.loads(
            path.read_text(encoding="utf-8"), object_pairs_hook=_object, parse_constant=_refuse
        )
    except (ValueError, RecursionError) as error:
        raise ImuloopError(f"{path}: no JSON: {error}") from error


def read_yaml(path):
    """Return the content of a YAML file of the package, such as a dict, from its `path`.

    PyYAML's parser in C is used if it is installed.
    """
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return yaml.load(Path(path).read_text(encoding="utf-8"), loader)


def _object(pairs):
    """Return the dict of a JSON object from its `pairs`, a list of (key, value).

    Raises a ValueError if a key is repeated.
    """
    content = {}
    for name, value in pairs:
        if name in content:
            raise ValueError(f"the key '{name}' is given twice")
        content[name] = value
    return content


def _refuse(name):
    """Raise a ValueError: `name` is NaN, Infinity or -Infinity, which JSON does not allow."""
    raise ValueError(f"{name} is no number")
