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

# most columns of a matrix of samples, as wider ones are images or spectra; also the most levels of
# groups inside groups, as libraries are slow or fail in deeper ones
_WIDEST = _DEEPEST = 64
_SINCE = re.compile(r"\s*(\w+)\s+since\s+(\d.*)", re.IGNORECASE)
# fields of the array that SciPy returns for an object of MATLAB, and why an object is not read
_OBJECT = ("s0", "s1", "s2", "arr")
_OF_MATLAB = "a MATLAB {}, which only MATLAB reads: save its columns as variables"


# --- Arrow tables: all columns have the same length, and each may have any type


def read_parquet(paths, columns=None):
    """Return the RawLog of a Parquet table; `columns` are the declared columns by quantity."""
    with pq.ParquetFile(paths["log"]) as file:
        return _arrow_log(file.schema_arrow, file.read, columns)


def read_feather(paths, columns=None):
    """Return the RawLog of a Feather file of version 2, which is an Arrow file.

    `columns` are the declared columns by quantity.
    """
    table = pa.ipc.open_file(paths["log"]).read_all()
    # offsets in a damaged file may point beyond its end
    table.validate(full=True)
    return _arrow_log(table.schema, table.select, columns)


def _arrow_log(schema, read, columns):
    """Return the RawLog of an Arrow table.

    `schema` is the schema of the table. ``read(columns=names)`` returns the table with only the
    columns of these names. `columns` are the declared columns by quantity. The RawLog takes
    ``simulated`` and ``units`` from the project's own metadata in the schema.
    """
    names, said = schema.names, own_metadata(schema.metadata or {})
    refuse_calibrated(names, said)
    chosen = resolve(names, columns)
    used = [*dict.fromkeys(names[i] for i in chosen.raw().values())]
    table = read(columns=used)
    # if a name repeats, the table has all its columns, in the order of the file
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
    """Yield the name, ``GROUP.NAME``, and the value of each leaf of a dict of dicts and arrays.

    `prefix` is the name of the group that the dict `tree` stands for. Each field of a structured
    array counts as a leaf.
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
    """Return the columns of arrays, a dict of arrays of shape (n,) by name of the column.

    `arrays` is a dict of arrays by name. The longer side of a matrix is time. An array is left out
    if it does not hold numbers or dates, or has more than two dimensions, less than two rows, or
    more than `_WIDEST` columns.
    """
    series = {}
    for name, array in arrays.items():
        # members of an archive that are not arrays are bytes
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
    """Return the RawLog of arrays by name.

    An array of shape (n,), (n, 1) or (1, n) is a column. One of shape (n, 3) or (3, n) has the
    columns ``NAME.x``, ``NAME.y`` and ``NAME.z``. Another matrix has the columns ``NAME.0``,
    ``NAME.1`` and so on. The table has the columns that are as long as the columns of the sensors.

    Parameters
    ----------
    arrays : dict
        Arrays by name. A text in place of an array is the reason why it is not read.
    columns : dict
        Declared columns by quantity; a sensor may also be declared by the name of one array.
    units : dict, optional
        Unit of each array by the name of the array, as the file writes it.

    Raises
    ------
    RejectedLog
        If no array holds numbers over time.
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
    # the file holds a single matrix: its columns have numbers, not names
    alone = len({name.rpartition(".")[0] for name in names}) == 1 and names[0][-1].isdigit()
    headed = names[0] != "0"
    names = _of_one_length(series, resolve(names, columns, headed))
    chosen = resolve(names, columns, headed)
    held = [_column(series[names[i]]) for i in chosen.raw().values()]
    stated = stated_units(chosen, [texts[name] for name in names])
    log = table_log(names, chosen, held, headed and not alone, notes=notes, units=stated)
    if unread:
        # a sensor that is not found may be in a variable that is not read
        log.columns, log.unread = f"{log.columns}; {unread}", log.unread + len(AXES)
    return log


def _of_one_length(series, chosen):
    """Return the names of the columns that are as long as the columns of sensors or reference.

    `series` are all columns by name, and `chosen` are the Columns that were found among them. If
    these have no sensor and no reference, the longest columns are returned. An ImuloopError is
    raised if columns of the sensors and the reference differ in length.
    """
    names, raw = [*series], chosen.raw()
    asked = [names[at] for key, at in raw.items() if key not in (STAMP, TEMPERATURE)]
    lengths = {len(series[name]): name for name in asked or names}
    if asked and len(lengths) > 1:
        both = " and ".join(f"{name} has {n} rows" for n, name in lengths.items())
        raise ImuloopError(f"{both}: name variables of one length in columns")
    return [name for name in names if len(series[name]) == max(lengths)]


def _column(values):
    """Return an array of shape (n,), which may be masked, as a column of Arrow with nulls."""
    data, mask = np.ma.getdata(values), np.ma.getmaskarray(values)
    # Arrow has no numbers of more than 8 bytes, and none in a foreign byte order
    kind = data.dtype.newbyteorder("=") if data.dtype.itemsize <= 8 else float
    return pa.array(data.astype(kind, copy=False), mask=mask)


def read_numpy(paths, columns=None):
    """Return the RawLog of an array of NumPy (.npy), or of several arrays by name (.npz).

    `columns` are the declared columns by quantity. Each field of a structured array is a column.
    Pickled objects are never loaded.
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
        # the columns of a structured array that is alone have the names of its fields
        arrays = {name.removeprefix(f"{one_line(*tree)}."): x for name, x in arrays.items()}
    return _log(arrays, columns)


def read_matlab(paths, columns=None):
    """Return the RawLog of a MATLAB file of version 5 (`-v6`, `-v7`) or 7.3.

    `columns` are the declared columns by quantity. The field of a struct is the column
    ``STRUCT.FIELD``. A file that is text is read as a text table.
    """
    with open(path := paths["log"], "rb") as file:
        head = file.read(LONGEST_LINE)
    if b"\x89HDF\r\n\x1a\n" in head:
        return _log(_matlab_73(path), columns)
    # in a file of version 5 these bytes show the byte order
    if head[126:128] in (b"IM", b"MI"):
        return _log(_matlab_5(path), columns)
    if not head or b"\0" in head:
        raise RejectedLog("the file is not a MATLAB file of version 5 or 7.3")
    log = delimited.read(paths, columns)
    log.notes.append("the file is text, not MATLAB's: read as a table")
    return log


def _matlab_5(path):
    """Return the arrays of a MATLAB file of version 5, a dict by name.

    In place of an array that cannot be read, the dict has a text with the reason.
    """
    from scipy.io import loadmat

    arrays = {}
    # `mat_dtype`: numbers have the type as in MATLAB, even if the file packs them into fewer bytes
    for name, value in _leaves(loadmat(path, mat_dtype=True, simplify_cells=True)):
        if isinstance(value, np.ndarray) and value.dtype.names:
            own, _, kind, _ = np.ravel(value)[0]
            arrays[own.decode(errors="replace")] = _OF_MATLAB.format(kind.decode(errors="replace"))
        elif isinstance(value, np.ndarray):
            arrays[name] = value
    return arrays


def _matlab_73(path):
    """Return the arrays of a MATLAB file of version 7.3, which is HDF5, a dict by name.

    In place of an array that cannot be read, the dict has a text with the reason.
    """
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
    """Return the RawLog of a NetCDF file; the coordinate of its longest dimension is the time.

    `columns` are the declared columns by quantity; a declared time comes first.
    """
    # both take long to import
    import h5py
    import netCDF4

    if h5py.is_hdf5(path := paths["log"]):
        with h5py.File(path, "r") as file:
            # reading the list rejects a file that refers to other files
            list(_datasets(file))
    arrays, units = {}, {}
    # the library could take a relative path for an address on the network
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
    """Return times as dates, a masked array of shape (n,), or None if they are not dates.

    `values` are numbers, (n,), which are dates if their unit `text` is such as ``seconds since
    2024-01-01``. A RejectedLog is raised for dates outside of `YEARS`.
    """
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
    """Raise a RejectedLog if a file announces more data than it can hold.

    `path` is the path of the file, `arrays` are the arrays that were read so far, by name, and
    `size` is the announced size of the next array, bytes.
    """
    held = sum(x.nbytes for x in arrays.values() if isinstance(x, np.ndarray))
    check_unpacked(os.path.getsize(path), held + size)


def _datasets(group, prefix="", met=None):
    """Yield the path and the object of each dataset in an HDF5 group, each dataset once.

    A RejectedLog is raised for values in another file, as this may be any file of the machine.
    Only hard links are followed: a soft link leads to an object of the same file, which is met in
    any case. `prefix` is the path of the group, and `met` is the set of the addresses in the file
    of all objects that were met before.
    """
    import h5py

    met = set() if met is None else met
    if prefix.count("/") > _DEEPEST:
        raise RejectedLog(f"groups lie in each other, more than {_DEEPEST}: save one table")
    for key in group:
        kind = group.id.links.get_info(key.encode(errors="surrogateescape")).type
        if kind == h5py.h5l.TYPE_SOFT:
            continue
        # links of all other kinds, which a user may define, too, lead out of the file
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
