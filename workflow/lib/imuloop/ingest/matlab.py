"""MATLAB files of version 5 (`-v6`, `-v7`) and 7.3: variables of one length as columns."""

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog, one_line
from imuloop.ingest import delimited
from imuloop.ingest.columns import SENSORS, lacking, listed, resolve
from imuloop.ingest.guarded import guarded
from imuloop.ingest.hdf5 import check_hdf5
from imuloop.ingest.tables import by_axis, column_names, table_log

ENDINGS = (".mat",)

_HDF5 = b"\x89HDF\r\n\x1a\n"
# MATLAB puts a text of its own before HDF5
_HDF5_AT = (0, 512)


@guarded
def read(paths, columns=None, batch_rows=1 << 16):
    """Read a MATLAB file; one that is text is read as a table.

    A variable of shape (n, 1) or (1, n) is a column, one of (n, 3) or (3, n) the columns `NAME.x`,
    `NAME.y` and `NAME.z`, other matrices `NAME.0` and on; a struct's are `STRUCT.FIELD`. In
    `columns` a sensor is one variable, or three.
    """
    path = paths["log"]
    if _is_text(path):
        log = delimited.read(paths, columns, batch_rows)
        log.notes.append("the file is text, no MATLAB file: read as a table")
        return log
    series, unread = variables(path)
    try:
        names = list(series)
        chosen = resolve(names, by_axis(columns))
        sensors = {q: [names[i] for i in getattr(chosen, q) or ()] for q in SENSORS}
        first = next((name for of in sensors.values() for name in of), None)
        for quantity, each in sensors.items():
            for name in each:
                if len(series[name]) != len(series[first]):
                    raise ImuloopError(
                        f"columns.{quantity}: {name} has {len(series[name])} rows, {first} has "
                        f"{len(series[first])}; name variables of one length"
                    )
        # a time and a temperature of another length are none of theirs
        rows = len(series[first]) if first else 0
        names = [name for name in names if len(series[name]) == rows]
        chosen = resolve(names, by_axis(columns))
        for quantity in SENSORS if unread else ():
            if getattr(chosen, quantity) is None:
                raise lacking(quantity, listed(names))
    except ImuloopError as error:
        raise type(error)(f"{error}{unread}") from error
    held = [pa.array(series[names[i]]) for i in chosen.raw().values()]
    parts = range(0, rows, batch_rows)
    batches = ([column.slice(begin, batch_rows) for column in held] for begin in parts)
    return table_log(names, chosen, batches, notes=[f"left out: {unread[2:]}"] if unread else [])


def _is_text(path):
    with open(path, "rb") as file:
        head = file.read(_HDF5_AT[-1] + len(_HDF5))
    known = head.startswith(b"# Created by Octave") or head[126:128] in (b"IM", b"MI")
    return bool(head) and b"\0" not in head and not known


def variables(path):
    """Return the columns of a MATLAB file by name, and what it holds that only MATLAB reads."""
    with open(path, "rb") as file:
        head = file.read(_HDF5_AT[-1] + len(_HDF5))
    arrays, objects = {}, {}
    if any(head[at:].startswith(_HDF5) for at in _HDF5_AT):
        # takes long to import
        import h5py

        check_hdf5(path)
        with h5py.File(path, "r") as file:
            _gather_73(file, "", arrays, objects)
    elif head[126:128] in (b"IM", b"MI"):
        from scipy.io import loadmat

        # integers as MATLAB has them, however few bytes they were packed into
        _gather_5(loadmat(path, mat_dtype=True, struct_as_record=False), "", arrays, objects)
    elif head.startswith(b"# Created by Octave"):
        raise RejectedLog("Octave's text format is not read; save with -v7")
    else:
        raise RejectedLog("the file is no MATLAB file of version 5 or 7.3")
    unread = "".join(
        f"; {name} is a MATLAB {what}, which only MATLAB reads: save its columns as variables"
        for name, what in [*objects.items()][:3]
    )
    series = {}
    for name, array in arrays.items():
        # the longer side is time
        rows = array if array.shape[0] >= array.shape[1] else array.T
        if len(rows) > 1 and (labels := column_names(name, rows.shape[1])):
            native = rows.astype(rows.dtype.newbyteorder("="), copy=False)
            series |= dict(zip(labels, native.T, strict=True))
    if not series:
        raise RejectedLog(f"the file has no variables of numbers over time{unread}")
    return series, unread


def _gather_5(variables, prefix, arrays, objects):
    """Put what SciPy read into `arrays` of numbers and `objects`, a struct's fields one by one."""
    from scipy.io.matlab import MatlabOpaque

    for key, value in variables.items():
        name = prefix + one_line(key)
        if isinstance(value, MatlabOpaque):
            name, what = (one_line(value[0][i].decode(errors="replace")) for i in ("s0", "s2"))
            objects[prefix + name] = what
        elif isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "biuf":
            arrays[name] = value
        elif getattr(value, "shape", None) == (1, 1) and hasattr(value[0, 0], "_fieldnames"):
            struct = value[0, 0]
            fields = {field: getattr(struct, field) for field in struct._fieldnames}
            _gather_5(fields, f"{name}.", arrays, objects)


def _gather_73(group, prefix, arrays, objects):
    """Put the datasets of a group and those below it into `arrays` of numbers and `objects`."""
    import h5py

    for key in group:
        # other links are second names
        if key.startswith("#") or type(group.get(key, getlink=True)) is not h5py.HardLink:
            continue
        item, name = group[key], prefix + one_line(key)
        if "MATLAB_object_decode" in item.attrs:
            what = item.attrs.get("MATLAB_class", b"object")
            objects[name] = one_line(bytes(what).decode(errors="replace"))
        elif isinstance(item, h5py.Group) and "MATLAB_sparse" not in item.attrs:
            _gather_73(item, f"{name}.", arrays, objects)
        elif isinstance(item, h5py.Dataset) and item.ndim == 2 and item.dtype.kind in "iuf":
            text = item.attrs.get("MATLAB_class") == b"char" or "MATLAB_empty" in item.attrs
            if not text:
                # HDF5 lists MATLAB's dimensions backwards
                arrays[name] = item[()].T
