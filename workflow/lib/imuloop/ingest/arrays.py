"""Files of named arrays, whose columns are a log: Parquet, Feather, NumPy, MATLAB and NetCDF."""

import os
import re
import zipfile
from contextlib import nullcontext

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, RejectedLog, one_line
from imuloop.core.samples import TEMPERATURE, own_metadata, refuse_calibrated
from imuloop.ingest import delimited
from imuloop.ingest.columns import STAMP, resolve
from imuloop.ingest.damage import LONGEST_LINE, check_unpacked
from imuloop.ingest.spellings import AXES, SENSORS, stated_unit
from imuloop.ingest.stamps import YEARS
from imuloop.ingest.tables import stated_units, table_log

# a matrix of samples has no more columns, nor a file of logs groups in each other: wider ones are
# images or spectra, and libraries are slow or fail in deeper ones
_WIDEST = _DEEPEST = 64
_SINCE = re.compile(r"\s*(\w+)\s+since\s+(\d.*)", re.IGNORECASE)
# fields by which SciPy gives an object of MATLAB, and why it is not read
_OBJECT = ("s0", "s1", "s2", "arr")
_OF_MATLAB = "a MATLAB {}, which only MATLAB reads: save its columns as variables"


# --- Arrow: columns have one length, and any type


def read_parquet(paths, columns=None):
    """Read a Parquet table."""
    with pq.ParquetFile(paths["log"]) as file:
        return _arrow_log(file.schema_arrow, file.read, columns)


def read_feather(paths, columns=None):
    """Read a Feather file of version 2, which is an Arrow file."""
    table = pa.ipc.open_file(paths["log"]).read_all()
    # offsets of a damaged file may lead out of it
    table.validate(full=True)
    return _arrow_log(table.schema, table.select, columns)


def _arrow_log(schema, read, columns):
    """Return the RawLog of a table, of which ``read(columns=names)`` gives columns by name.

    ``simulated`` and ``units`` of the project's metadata in the `schema` are passed on.
    """
    names, said = schema.names, own_metadata(schema.metadata or {})
    refuse_calibrated(names, said)
    chosen = resolve(names, columns)
    used = [*dict.fromkeys(names[i] for i in chosen.raw().values())]
    table = read(columns=used)
    # of a name that repeats all columns come, in the order of the file
    given = [i for name in used for i, other in enumerate(names) if other == name]
    return table_log(
        names,
        chosen,
        [table.column(given.index(i)) for i in chosen.raw().values()],
        units={quantity: str(unit) for quantity, unit in said.get("units", {}).items()},
        simulated=bool(said.get("simulated", False)),
    )


# --- trees of named arrays, of any length


def _leaves(tree, prefix=""):
    """Give the name, ``GROUP.NAME``, and the value of each leaf of a dict of dicts and arrays.

    The fields of a structured array are leaves.
    """
    for key, value in tree.items():
        name = ".".join(filter(None, (prefix, one_line(key))))
        fields = isinstance(value, np.ndarray) and value.dtype.names
        if fields and fields != _OBJECT:
            value = {field: value[field] for field in fields}
        if isinstance(value, dict):
            yield from _leaves(value, name)
        else:
            yield name, value


def _columns(arrays):
    """Return name -> column, shape (n,), of arrays by name: the longer side of a matrix is time."""
    series = {}
    for name, array in arrays.items():
        # other members of an archive are bytes
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "biufM":
            continue
        rows = np.atleast_2d(array)
        rows = rows.T if rows.shape[0] < rows.shape[1] else rows
        if array.ndim not in (1, 2) or len(rows) < 2 or rows.shape[1] > _WIDEST:
            continue
        labels = {1: [""], len(AXES): AXES}.get(rows.shape[1], map(str, range(rows.shape[1])))
        names = (".".join(filter(None, (name, label))) for label in labels)
        series |= zip(names, rows.T, strict=True)
    return series


def _log(arrays, columns, units=None):
    """Return the RawLog of arrays by name; in place of one may be a text why it is not read.

    An array of shape (n,), (n, 1) or (1, n) is a column; (n, 3) or (3, n) are the columns
    ``NAME.x``, ``NAME.y`` and ``NAME.z``; other matrices have ``NAME.0`` and on. Columns with the
    length of the sensors' are the table.

    Parameters
    ----------
    columns : dict
        As declared; a sensor may also be the name of one array.
    units : dict, optional
        Name of an array to its unit as the file writes it.
    """
    series, units = _columns(arrays), units or {}
    unread = [f"{one_line(name)} is {why}" for name, why in arrays.items() if isinstance(why, str)]
    unread = one_line("; ".join(unread[:3]))
    if not series:
        why = "the file has no variables of numbers over time"
        raise RejectedLog("; ".join(filter(None, (why, unread))))
    names, notes = [*series], [f"left out: {unread}"] if unread else []
    texts = {name: units.get(name) or units.get(name.rpartition(".")[0], "") for name in names}
    columns = dict(columns or {})
    for quantity in SENSORS:
        if isinstance(columns.get(quantity), str):
            columns[quantity] = [f"{columns[quantity]}.{axis}" for axis in AXES]
    # a matrix that is all of the file: its columns have numbers
    alone = len({name.rpartition(".")[0] for name in names}) == 1 and names[0][-1].isdigit()
    headed = names[0] != "0"
    names = _of_one_length(series, resolve(names, columns, headed))
    chosen = resolve(names, columns, headed)
    held = [_column(series[names[i]]) for i in chosen.raw().values()]
    stated = stated_units(chosen, [texts[name] for name in names])
    log = table_log(names, chosen, held, headed and not alone, notes=notes, units=stated)
    if unread:
        # a sensor that is not found may be in there
        log.columns, log.unread = f"{log.columns}; {unread}", log.unread + len(AXES)
    return log


def _of_one_length(series, chosen):
    """Return the names of the columns that are as long as the columns of sensors or reference."""
    names, raw = [*series], chosen.raw()
    asked = [names[at] for key, at in raw.items() if key not in (STAMP, TEMPERATURE)]
    lengths = {len(series[name]): name for name in asked or names}
    if asked and len(lengths) > 1:
        both = " and ".join(f"{name} has {n} rows" for n, name in lengths.items())
        raise ImuloopError(f"{both}: name variables of one length in columns")
    return [name for name in names if len(series[name]) == max(lengths)]


def _column(values):
    """Return a column of an array, which may be masked."""
    data, mask = np.ma.getdata(values), np.ma.getmaskarray(values)
    # Arrow has no longer numbers, and none of the other byte order
    kind = data.dtype.newbyteorder("=") if data.dtype.itemsize <= 8 else float
    return pa.array(data.astype(kind, copy=False), mask=mask)


def read_numpy(paths, columns=None):
    """Read an array of NumPy (.npy), or several by name (.npz).

    A structured array has a column per field. Pickled objects are never loaded.
    """
    path, tree = paths["log"], {}
    if zipped := zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            check_unpacked(os.path.getsize(path), sum(x.file_size for x in archive.infolist()))
    with np.load(path, allow_pickle=False) if zipped else nullcontext([""]) as archive:
        for name in archive:
            try:
                tree[name] = archive[name] if zipped else np.load(path, "r", allow_pickle=False)
            except ValueError as error:
                if not re.search("pickle|Python objects", str(error)):
                    raise
                tree[name] = "a pickled object, which is not loaded: save numbers"
    arrays = dict(_leaves(tree))
    if len(tree) == 1 < len(arrays):
        # the fields of a structured array that is alone are columns by their own names
        arrays = {name.removeprefix(f"{one_line(*tree)}."): x for name, x in arrays.items()}
    return _log(arrays, columns)


def read_matlab(paths, columns=None):
    """Read a MATLAB file of version 5 (`-v6`, `-v7`) or 7.3; one that is text is read as a table.

    The fields of a struct are ``STRUCT.FIELD``.
    """
    with open(path := paths["log"], "rb") as file:
        head = file.read(LONGEST_LINE)
    if b"\x89HDF\r\n\x1a\n" in head:
        return _log(_matlab_73(path), columns)
    # the order of bytes of version 5
    if head[126:128] in (b"IM", b"MI"):
        return _log(_matlab_5(path), columns)
    if not head or b"\0" in head:
        raise RejectedLog("the file is not a MATLAB file of version 5 or 7.3")
    log = delimited.read(paths, columns)
    log.notes.append("the file is text, not MATLAB's: read as a table")
    return log


def _matlab_5(path):
    """Return name -> array of a MATLAB file, or why it is not read."""
    from scipy.io import loadmat

    arrays = {}
    # integers as MATLAB has them, however few bytes they were packed into
    for name, value in _leaves(loadmat(path, mat_dtype=True, simplify_cells=True)):
        if isinstance(value, np.ndarray) and value.dtype.names:
            own, _, kind, _ = np.ravel(value)[0]
            arrays[own.decode(errors="replace")] = _OF_MATLAB.format(kind.decode(errors="replace"))
        elif isinstance(value, np.ndarray):
            arrays[name] = value
    return arrays


def _matlab_73(path):
    """Return name -> array of a MATLAB file that is HDF5, or why it is not read."""
    import h5py

    arrays = {}
    with h5py.File(path, "r") as file:
        for place, item in _datasets(file):
            name, attributes = one_line(place.replace("/", ".")), item.attrs
            kind = bytes(attributes.get("MATLAB_class", b""))
            if "MATLAB_object_decode" in attributes:
                arrays[name] = _OF_MATLAB.format(kind.decode(errors="replace") or "object")
            elif kind != b"char" and "MATLAB_empty" not in attributes and place[0] != "#":
                if item.ndim == 2 and item.dtype.kind in "iuf":
                    _check_announced(path, arrays, item.nbytes)
                    # HDF5 lists MATLAB's dimensions backwards
                    arrays[name] = item[()].T
    return arrays


def read_netcdf(paths, columns=None):
    """Read a NetCDF file; the coordinate of its longest dimension is the time."""
    # both take long to import
    import h5py
    import netCDF4

    if h5py.is_hdf5(path := paths["log"]):
        with h5py.File(path, "r") as file:
            # rejects what leads out of the file
            list(_datasets(file))
    arrays, units = {}, {}
    # a path that begins otherwise could be an address to the library
    with netCDF4.Dataset(os.path.abspath(path)) as data:
        for name, variable in data.variables.items():
            if getattr(variable.dtype, "kind", "O") in "iuf" and variable.ndim in (1, 2):
                _check_announced(path, arrays, float(variable.size) * variable.dtype.itemsize)
                arrays[name] = variable[:]
                units[name] = str(getattr(variable, "units", "")).strip()
                if variable.ndim == 1 and (dates := _dates(arrays[name], units[name])) is not None:
                    arrays[name], units[name] = dates, ""
        longest = max((max(array.shape) for array in arrays.values()), default=0)
        for name, array in arrays.items():
            if data[name].dimensions == (name,) and len(array) == longest:
                columns = {"time": name} | (columns or {})
    return _log(arrays, columns, units)


def _dates(values, text):
    """Return values as dates if `text` is ``seconds since 2024-01-01``, else None."""
    match = _SINCE.fullmatch(text)
    unit = match and ("D" if match[1].lower() in ("day", "days") else stated_unit("time", match[1]))
    if not unit:
        return None
    try:
        origin = pd.Timestamp(match[2].replace("UTC", "").strip())
        origin = (origin.tz_localize("UTC") if origin.tz is None else origin).as_unit("ns")
        dates = origin + pd.to_timedelta(np.ma.getdata(values), unit=unit)
    except (ValueError, OverflowError) as error:
        raise RejectedLog(f"the stamps, {text}, are not dates of the years {YEARS}") from error
    return np.ma.array(dates.tz_convert(None).to_numpy(), mask=np.ma.getmaskarray(values))


def _check_announced(path, arrays, size):
    """Refuse arrays whose announced size is too large for the file."""
    held = sum(x.nbytes for x in arrays.values() if isinstance(x, np.ndarray))
    check_unpacked(os.path.getsize(path), held + size)


def _datasets(group, prefix="", met=None):
    """Give the path and dataset of each of an HDF5 file, once; reject one that opens other files.

    These may be any file of the machine. Only hard links are followed: a soft link is a path of
    links of the same file, which are all met. `met` are the places of the objects met before.
    """
    import h5py

    met = set() if met is None else met
    if prefix.count("/") > _DEEPEST:
        raise RejectedLog(f"groups lie in each other, more than {_DEEPEST}: save one table")
    for key in group:
        kind = group.id.links.get_info(key.encode(errors="surrogateescape")).type
        if kind == h5py.h5l.TYPE_SOFT:
            continue
        # all other kinds of links, a user's kinds too, lead out of the file
        item = group[key] if kind == h5py.h5l.TYPE_HARD else None
        if item is None or getattr(item, "external", None) or getattr(item, "is_virtual", False):
            raise RejectedLog(
                f"the values of {one_line(prefix + key)} lie in another file, which is not read: "
                "save the values themselves in one file"
            )
        place = h5py.h5o.get_info(item.id).addr
        if place not in met:
            met.add(place)
            if isinstance(item, h5py.Group):
                yield from _datasets(item, f"{prefix}{key}/", met)
            elif isinstance(item, h5py.Dataset):
                yield prefix + key, item
