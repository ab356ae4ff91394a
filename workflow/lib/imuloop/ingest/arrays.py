"""Readers of logs in files of named arrays: Parquet, Feather, NumPy, MATLAB and NetCDF."""

import os
import re

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
from imuloop.ingest.tables import table_log

# most columns of a matrix of samples, as wider ones are images or spectra; also the most levels of
# groups inside groups, as libraries are slow or fail in deeper ones
_WIDEST = _DEEPEST = 64
_SINCE = re.compile(r"\s*(\w+)\s+since\s+(\d.*)", re.IGNORECASE)


# --- Arrow tables: all columns have the same length, and each may have any type


def read_parquet(paths, columns=None):
    """Return the RawLog of a Parquet table, the log as it was read.

    ``paths["log"]`` is the path of the file. `columns` are the declared columns by quantity, such
    as ``acceleration``, or None.
    """
    with pq.ParquetFile(paths["log"]) as file:
        return _arrow_log(file.schema_arrow, file.read, columns)


def read_feather(paths, columns=None):
    """Return the RawLog of a Feather file (version 2, an Arrow file), the log as it was read.

    ``paths["log"]`` is the path of the file. `columns` are the declared columns by quantity, such
    as ``acceleration``, or None.
    """
    table = pa.ipc.open_file(paths["log"]).read_all()
    # offsets in a damaged file may point beyond its end
    table.validate(full=True)
    return _arrow_log(table.schema, table.select, columns)


def _arrow_log(schema, read, columns):
    """Return the RawLog of an Arrow table, as Parquet and Feather files hold it.

    `schema` is the schema of the table. ``read(columns=names)`` returns the table with only the
    columns of these names. `columns` are the declared columns by quantity, or None. The RawLog
    takes ``simulated`` and ``units`` from the metadata that imuloop itself wrote into the schema.
    """
    names, stated = schema.names, own_metadata(schema.metadata or {})
    refuse_calibrated(names, stated)
    chosen = resolve(names, columns)
    used = [*dict.fromkeys(names[at] for at in chosen.raw.values())]
    table = read(columns=used)
    # if a name repeats, the table has all its columns, in the order of the file
    order = [at for name in used for at, other in enumerate(names) if other == name]
    return table_log(
        names,
        chosen,
        [table.column(order.index(at)) for at in chosen.raw.values()],
        units={quantity: str(unit) for quantity, unit in stated.get("units", {}).items()},
        simulated=bool(stated.get("simulated", False)),
    )


# --- named arrays, of any length


def _log(tree, columns, units=None):
    """Return the RawLog of a tree of named arrays, as a file of NumPy, MATLAB or NetCDF holds them.

    Only columns as long as the columns of the sensors are read; `_columns` finds them.

    Parameters
    ----------
    tree : dict
        Arrays, and dicts of them, by name.
    columns : dict
        Declared columns by quantity; a sensor may also be declared by the name of one array.
    units : dict, optional
        Unit of each array by the name of the array, as the file writes it.

    Raises
    ------
    RejectedLog
        If no array holds numbers over time.
    """
    series, units, columns = _columns("", tree), units or {}, dict(columns or {})
    if not series:
        raise RejectedLog(
            "the file has no variables of numbers over time; objects such as MATLAB's tables are "
            "not read: save their columns as variables"
        )
    for quantity in SENSORS:
        if isinstance(columns.get(quantity), str):
            columns[quantity] = [f"{columns[quantity]}.{axis}" for axis in AXES]
    stems = {name: name.rpartition(".")[0] for name in series}
    # the columns of a single matrix have numbers, not names
    headed = len({*stems.values()}) > 1 or not next(iter(series))[-1].isdigit()
    names = _of_one_length(series, resolve([*series], columns, headed))
    texts = [units.get(name) or units.get(stems[name], "") for name in names]
    chosen = resolve(names, columns, headed, texts)
    arrays = [_column(series[names[at]]) for at in chosen.raw.values()]
    return table_log(names, chosen, arrays, headed)


def _columns(name, value):
    """Return the columns in a variable of a file, arrays of shape (n,) by name of the column.

    The variable has the `name`, and its `value` is an array or a dict. An array of shape (n,), (n,
    1) or (1, n) is one column of n samples. One of shape (n, 3) or (3, n) has the columns
    ``NAME.x``, ``NAME.y`` and ``NAME.z``. Another matrix has the columns ``NAME.0``, ``NAME.1`` and
    so on; its longer side is time. A field of a structured array, or a member of a dict, is a
    variable ``NAME.FIELD``. The dict is empty for a variable that cannot be samples: text, a single
    number, or an array of more than two axes or of more than `_WIDEST` columns.
    """
    if isinstance(value, np.ndarray) and value.dtype.names:
        value = {field: value[field] for field in value.dtype.names}
    if isinstance(value, dict):
        columns = {}
        for key, member in value.items():
            columns |= _columns(".".join(filter(None, (name, one_line(key)))), member)
        return columns
    # members of an archive that are not arrays are bytes
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biufM":
        return {}
    rows = np.atleast_2d(value)
    rows = rows.T if rows.shape[0] < rows.shape[1] else rows
    if value.ndim not in (1, 2) or len(rows) < 2 or rows.shape[1] > _WIDEST:
        return {}
    labels = {1: [""], len(AXES): AXES}.get(rows.shape[1], map(str, range(rows.shape[1])))
    names = [".".join(filter(None, (name, label))) for label in labels]
    return dict(zip(names, rows.T, strict=True))


def _of_one_length(series, chosen):
    """Return the names of the columns that are as long as the columns of sensors or reference.

    Only such columns fit into one table.

    `series` are all columns of a file by name, and `chosen` are the Columns, which tell where the
    columns of sensors and reference are among these. If `chosen` has no sensor and no reference,
    the names of the longest columns are returned. Raises an ImuloopError if columns of sensors and
    reference differ in length.
    """
    names = [*series]
    read = [names[at] for key, at in chosen.raw.items() if key not in (STAMP, TEMPERATURE)]
    lengths = {len(series[name]): name for name in read or names}
    if read and len(lengths) > 1:
        both = " and ".join(f"{name} has {n} rows" for n, name in lengths.items())
        raise ImuloopError(f"{both}: name variables of one length in columns")
    return [name for name in names if len(series[name]) == max(lengths)]


def _column(values):
    """Return an array, `values`, (n,), as an Arrow array; masked values become null."""
    # Arrow has no numbers of more than 8 bytes, and none in a foreign byte order
    kind = values.dtype.newbyteorder("=") if values.dtype.itemsize <= 8 else float
    return pa.array(values.astype(kind, copy=False))


def read_numpy(paths, columns=None):
    """Return the RawLog of a NumPy file: an array, .npy, or several arrays, .npz.

    ``paths["log"]`` is the path of the file. `columns` are the declared columns by quantity, or
    None. Each field of a structured array is a column. Pickled objects are never loaded.
    """
    archive = np.load(path := paths["log"], mmap_mode="r", allow_pickle=False)
    if isinstance(archive, np.ndarray):
        return _log({"": archive}, columns)
    check_unpacked(os.path.getsize(path), sum(x.file_size for x in archive.zip.infolist()))
    tree, notes = {}, []
    for name in archive:
        try:
            tree[name] = archive[name]
        except ValueError as error:
            if "allow_pickle" not in str(error):
                raise
            notes.append(f"{one_line(name)} left out: Python objects are not loaded, save numbers")
    if len(tree) == 1 and getattr(*tree.values(), "dtype", np.dtype(float)).names:
        # the columns of a structured array that is alone have the names of its fields
        tree = {"": tree.popitem()[1]}
    log = _log(tree, columns)
    log.notes += notes
    return log


def read_matlab(paths, columns=None):
    """Return the RawLog of a MATLAB file of version 5 (-v6, -v7) or 7.3.

    ``paths["log"]`` is the path of the file. `columns` are the declared columns by quantity, or
    None. The field of a struct is the column ``STRUCT.FIELD``. A file that is text is read as a
    text table.
    """
    with open(path := paths["log"], "rb") as file:
        head = file.read(LONGEST_LINE)
    if b"\x89HDF\r\n\x1a\n" in head:
        return _log(_matlab_73(path), columns)
    # in a file of version 5 these bytes show the byte order
    if head[126:128] in (b"IM", b"MI"):
        from scipy.io import loadmat

        # numbers have the type as in MATLAB, even if the file packs them into fewer bytes
        return _log(loadmat(path, mat_dtype=True, simplify_cells=True), columns)
    if not head or b"\0" in head:
        raise RejectedLog("the file is not a MATLAB file of version 5 or 7.3")
    log = delimited.read(paths, columns)
    log.notes.append("the file is text, not MATLAB's: read as a table")
    return log


def _matlab_73(path):
    """Return the variables of a MATLAB file of version 7.3, which is HDF5, arrays by name.

    `path` is the path of the file. Variables that are not numbers are left out.
    """
    import h5py

    _check_links(path)
    tree, unread = {}, {"MATLAB_object_decode", "MATLAB_empty"}

    def add(name, item):
        """Add an item of the file to the variables if it is an array of numbers.

        `name` is its path in the file, and `item` the object of h5py.
        """
        if isinstance(item, h5py.Dataset) and not name.startswith("#refs#"):
            if unread.isdisjoint(item.attrs) and item.attrs.get("MATLAB_class") != b"char":
                _check_announced(path, tree, item.nbytes)
                # HDF5 lists MATLAB's dimensions backwards
                tree[name.replace("/", ".")] = item[()].T

    with h5py.File(path, "r") as file:
        file.visititems(add)
    return tree


def read_netcdf(paths, columns=None):
    """Return the RawLog of a NetCDF file, the log as it was read.

    ``paths["log"]`` is the path of the file. `columns` are the declared columns by quantity, or
    None. The time is the coordinate variable of the longest dimension in the file, unless a time is
    declared.
    """
    # both take long to import
    import h5py
    import netCDF4

    if h5py.is_hdf5(path := paths["log"]):
        _check_links(path)
    arrays, units = {}, {}
    # the library could take a relative path for an address on the network
    with netCDF4.Dataset(os.path.abspath(path)) as data:
        for name, variable in data.variables.items():
            if variable.ndim in (1, 2):
                size = np.dtype(variable.dtype).itemsize
                _check_announced(path, arrays, float(variable.size) * size)
                values, unit = variable[:], str(getattr(variable, "units", "")).strip()
                dates = _dates(values, unit) if variable.ndim == 1 else None
                arrays[name], units[name] = (values, unit) if dates is None else (dates, "")
        longest = max((max(array.shape) for array in arrays.values()), default=0)
        for name, array in arrays.items():
            if data[name].dimensions == (name,) and len(array) == longest:
                columns = {"time": name} | (columns or {})
    return _log(arrays, columns, units)


def _check_announced(path, arrays, size):
    """Raise a RejectedLog if the file at `path` announces more data than it can hold.

    `arrays` are the arrays that were read from the file so far, by name, and `size` is the size of
    the next array as the file announces it, bytes.
    """
    check_unpacked(os.path.getsize(path), sum(x.nbytes for x in arrays.values()) + size)


def _check_links(path):
    """Raise a RejectedLog if an HDF5 file has links by which values of another file would be read.

    That could be any file of the user.

    `path` is the path of the HDF5 file. Soft links are allowed, as they stay inside of the file.
    Hard links are allowed unless the dataset at their end keeps its values in other files. All
    other kinds of links are refused, and so are groups that lie too deep in each other.
    """
    import h5py

    def fault(name, link):
        """Return the reason, text, if a link of the file is refused, else None.

        `name` is the path of the link in the file, bytes, and `link` describes its type. The
        library calls this function for each link, and stops at the first reason. An exception
        raised here would get lost in the library.
        """
        if name.count(b"/") > _DEEPEST:
            return f"groups lie in each other, more than {_DEEPEST}: save one table"
        if link.type == h5py.h5l.TYPE_SOFT:
            return None
        item = file[name] if link.type == h5py.h5l.TYPE_HARD else None
        if item is None or getattr(item, "external", None) or getattr(item, "is_virtual", False):
            return (
                f"the values of {one_line(name.decode(errors='replace'))} lie in another file, "
                "which is not read: save the values themselves in one file"
            )
        return None

    with h5py.File(path, "r") as file:
        if reason := file.id.links.visit(fault, info=True):
            raise RejectedLog(reason)


def _dates(values, text):
    """Return the dates for which the numbers of a NetCDF variable stand, a masked array, or None.

    `values` are the n numbers, (n,), and `text` is their unit. They are dates if the unit is such
    as ``seconds since 2024-01-01``; otherwise the result is None. The array has the shape (n,). A
    RejectedLog is raised for dates outside of `YEARS`.
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
