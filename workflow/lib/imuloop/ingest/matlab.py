"""MATLAB files of version 5 (`-v6`, `-v7`) and 7.3: variables of one length as columns.

Version 5 is decoded here and not by scipy.io.loadmat, which is not made for hostile files: cells
nested in cells end the process, and 184 bytes that announce a large cell take gigabytes.
"""

import os
import struct
import zlib

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest import delimited
from imuloop.ingest.columns import AXES, listed, resolve
from imuloop.ingest.hdf5 import check_hdf5
from imuloop.ingest.packed import MOST_HELD, MOST_TIMES, check_unpacked
from imuloop.ingest.raw_log import STAMP, RawLog
from imuloop.ingest.stamps import stamp_array

ENDINGS = (".mat",)

_HDF5 = b"\x89HDF\r\n\x1a\n"
# MATLAB puts a text of its own before HDF5
_HDF5_AT = (0, 512)
_HEADER = 128
# elements of version 5: numbers by type, and those that hold others
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"}
_NUMBERS |= {12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED = 14, 15
# classes of its arrays
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4"}
_CLASSES |= {14: "i8", 15: "u8"}
_STRUCT, _OPAQUE = 2, 17
_COMPLEX = 0x800
# structs in structs are followed so far
_DEPTH = 8
# more columns than a matrix of samples has
_WIDEST = 64


# not-a-number of a broken file can be of a kind that warns
@np.errstate(invalid="ignore")
def read(paths, columns=None, batch_rows=1 << 16):
    """Read a MATLAB file; one that is text is read as a table.

    A variable of shape (n, 1) or (1, n) is a column, one of (n, 3) or (3, n) the columns `NAME.x`,
    `NAME.y` and `NAME.z`, other matrices `NAME.0` and on; a struct's are `STRUCT.FIELD`.

    Parameters
    ----------
    paths : dict
        ``{"log": path}``.
    columns : dict, optional
        Quantity to columns. A sensor is one variable of three columns, or three.
    batch_rows : int
        Rows given at once.

    Raises
    ------
    ImuloopError
        If a declared column is not there, or those chosen differ in length.
    RejectedLog
        If the file is not one of MATLAB's, or not whole.
    """
    path = paths["log"]
    with open(path, "rb") as file:
        head = file.read(_HDF5_AT[-1] + len(_HDF5))
    if any(head[at:].startswith(_HDF5) for at in _HDF5_AT):
        arrays, objects = _hdf5(path)
    elif head[126:128] in (b"IM", b"MI"):
        arrays, objects = _version_5(path, "<" if head[126:128] == b"IM" else ">")
    elif head.startswith(b"# Created by Octave"):
        raise RejectedLog("Octave's text format is not read; save with -v7")
    elif head and b"\0" not in head:
        log = delimited.read(paths, columns, batch_rows)
        log.notes.append("the file is text, no MATLAB file: read as a table")
        return log
    else:
        raise RejectedLog("the file is no MATLAB file of version 5 or 7.3")
    unread = "".join(
        f"; {name} is a MATLAB {what}, which only MATLAB reads: save its columns as variables"
        for name, what in list(objects.items())[:3]
    )
    series = _series(arrays)
    if not series:
        raise RejectedLog(f"the file has no variables of numbers over time{unread}")
    declared = {
        quantity: [f"{value}.{letter}" for letter in AXES]
        if isinstance(value, str) and quantity in ("acceleration", "angular_rate")
        else value
        for quantity, value in (columns or {}).items()
    }
    try:
        series = _of_one_length(series, declared)
        names = list(series)
        chosen = resolve(names, declared)
    except ImuloopError as error:
        raise ImuloopError(f"{error}{unread}") from error
    keys = [names[i] for i in chosen.positions()]
    held = [series[key].astype(float) for key in keys[: len(CHANNELS)]]
    table = dict(zip(CHANNELS, held, strict=True))
    if chosen.time is not None:
        stamps = series[names[chosen.time]]
        table[STAMP] = stamp_array(pa.array(stamps))
    if chosen.temperature is not None:
        table[TEMPERATURE] = series[names[chosen.temperature]].astype(float)
    table |= {name: series[names[i]].astype(float) for name, i in chosen.others.items()}

    def batches():
        for begin in range(0, len(held[0]), batch_rows):
            part = slice(begin, begin + batch_rows)
            yield pa.RecordBatch.from_pydict({n: pa.array(x[part]) for n, x in table.items()})

    return RawLog(
        batches=batches(),
        temperature=chosen.temperature is not None,
        found=chosen.found(names),
        units=chosen.units,
        columns=listed(names),
        notes=[f"left out: {unread[2:]}"] if unread else [],
    )


def _series(arrays):
    """Return name -> values of all columns, the longer side of each array being time."""
    series = {}
    for name, array in arrays.items():
        rows = array if array.shape[0] >= array.shape[1] else array.T
        length, width = rows.shape
        if length < 2 or width > _WIDEST:
            continue
        labels = AXES if width == len(AXES) else range(width)
        keys = [name] if width == 1 else [f"{name}.{label}" for label in labels]
        series |= dict(zip(keys, rows.T, strict=True))
    return series


def _of_one_length(series, declared):
    """Return the series that are as long as the acceleration."""
    names = list(series)
    found = resolve(names, declared).found(names)
    first = found["acceleration"][0]
    for quantity in {**declared, "acceleration": None, "angular_rate": None}:
        where = found.get(quantity) or []
        for name in where if isinstance(where, list) else [where]:
            if len(series[name]) != len(series[first]):
                raise ImuloopError(
                    f"columns.{quantity}: {name} has {len(series[name])} rows, {first} has "
                    f"{len(series[first])}; name variables of one length"
                )
    return {name: x for name, x in series.items() if len(x) == len(series[first])}


def _version_5(path, order):
    """Return name -> array of two dimensions, and name -> class of what is no array."""
    with open(path, "rb") as file:
        data = memoryview(file.read())
    arrays, objects, unpacked = {}, {}, 0
    try:
        for kind, content in _elements(data[_HEADER:], order):
            if kind == _COMPRESSED:
                most = min(MOST_TIMES * len(data), MOST_HELD) - unpacked
                inflate = zlib.decompressobj()
                # a byte more than is allowed
                content = memoryview(inflate.decompress(content, most + 1))
                unpacked += len(content)
                check_unpacked(len(data), unpacked, held=True)
                if not inflate.eof:
                    raise ValueError("a variable is cut short")
                kind, content = next(_elements(content, order))
            if kind == _MATRIX:
                _matrix(content, order, "", arrays, objects)
    except (struct.error, zlib.error, ValueError, LookupError, StopIteration) as error:
        raise RejectedLog("the file is not a whole MATLAB file") from error
    return arrays, objects


def _elements(data, order):
    """Give (type, content) of the elements of version 5 in `data`."""
    at = 0
    while at < len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        begin = at + 8
        if kind >> 16:
            # up to four bytes lie in the tag itself
            kind, size, begin = kind & 0xFFFF, kind >> 16, at + 4
        if size > len(data) - begin:
            raise ValueError("an element is cut short")
        yield kind, data[begin : begin + size]
        at = begin + size
        if kind != _COMPRESSED:
            at += -at % 8


def _matrix(content, order, prefix, arrays, objects):
    """Put a matrix of version 5 into `arrays` or `objects`, a struct's fields one by one."""
    if not content:
        return
    parts = _elements(content, order)
    (flags, *_) = np.frombuffer(next(parts)[1], f"{order}u4")
    kind = flags & 0xFF
    if kind == _OPAQUE:
        name, _, what = (_text(next(parts)[1]) for _ in range(3))
        objects[prefix + name] = what
        return
    shape = np.frombuffer(next(parts)[1], f"{order}i4")
    name = prefix + _text(next(parts)[1])
    if kind == _STRUCT and (shape == 1).all() and prefix.count(".") < _DEPTH:
        (width,) = np.frombuffer(next(parts)[1], f"{order}i4")
        names = next(parts)[1]
        starts = range(0, len(names), int(width))
        for start, (_, part) in zip(starts, parts, strict=True):
            field = _text(names[start : start + width])
            _matrix(part, order, f"{name}.{field}", arrays, objects)
    elif kind in _CLASSES and not flags & _COMPLEX and name and len(shape) == 2:
        number, values = next(parts)
        values = np.frombuffer(values, f"{order}{_NUMBERS[number]}")
        arrays[name] = values.reshape(shape, order="F").astype(_CLASSES[kind])


def _text(content):
    """Return a name of the file in one line."""
    text = bytes(content).partition(b"\0")[0].decode("utf-8", "replace")
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _hdf5(path):
    """Return name -> array of two dimensions, and name -> class of what is no array."""
    # takes long to import, and most runs need none
    import h5py

    arrays, objects, seen = {}, {}, set()
    size, unpacked = os.path.getsize(path), 0
    try:
        check_hdf5(path)
        with h5py.File(path, "r") as file:
            groups = [("", file)]
            while groups:
                prefix, group = groups.pop(0)
                for key in group:
                    # other links are second names
                    if key[0] == "#" or type(group.get(key, getlink=True)) is not h5py.HardLink:
                        continue
                    item, name = group[key], prefix + _text(key.encode(errors="replace"))
                    address = h5py.h5o.get_info(item.id).addr
                    if address in seen:
                        continue
                    seen.add(address)
                    if "MATLAB_object_decode" in item.attrs:
                        what = item.attrs.get("MATLAB_class")
                        objects[name] = _text(what) if isinstance(what, bytes) else "object"
                    elif isinstance(item, h5py.Group) and "MATLAB_sparse" not in item.attrs:
                        groups.append((f"{name}.", item))
                    elif isinstance(item, h5py.Dataset) and _is_matrix(item):
                        chunk = np.prod(item.chunks or (0,), dtype=float) * item.dtype.itemsize
                        unpacked += max(item.nbytes, chunk)
                        check_unpacked(size, unpacked, held=True)
                        made = item.id.get_create_plist()
                        for code, *_ in map(made.get_filter, range(made.get_nfilters())):
                            if not h5py.h5z.filter_avail(code):
                                raise RejectedLog(
                                    f"{name} cannot be read: it is packed by filter {code} of "
                                    "HDF5, which is not known here"
                                )
                        # HDF5 lists MATLAB's dimensions backwards
                        arrays[name] = item[()].T
    except RejectedLog:
        raise
    except Exception as error:
        raise RejectedLog("the file is not a whole MATLAB file") from error
    return arrays, objects


def _is_matrix(item):
    """Tell whether a dataset holds numbers."""
    return (
        item.dtype.kind in "iuf"
        and item.ndim == 2
        and "MATLAB_empty" not in item.attrs
        and item.attrs.get("MATLAB_class") != b"char"
    )
