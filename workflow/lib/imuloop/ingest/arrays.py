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
from imuloop.core.samples import CHANNELS, own_metadata, refuse_calibrated
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest import delimited
from imuloop.ingest.columns import STAMP, resolve
from imuloop.ingest.damage import check_unpacked, reject_damage
from imuloop.ingest.spellings import AXES, SENSORS, stated_unit
from imuloop.ingest.stamps import YEARS
from imuloop.ingest.tables import HEAD_ROWS, table_log

# a matrix of samples has no more columns: wider ones are images or spectra
_WIDEST = 64
# share of gravity by which the median force in a matrix may differ from it
_NEAR = 0.2
# MATLAB puts its own text, of so many bytes, before HDF5; and where that of version 5 ends
_HDF5, _HDF5_AT, _ORDER_AT = b"\x89HDF\r\n\x1a\n", (0, 512), slice(126, 128)
_SINCE = re.compile(r"\s*(\w+?)s?\s+since\s+(\d.*)", re.IGNORECASE)
# units of CF times to those of pandas
_CF_UNITS = {"nanosecond": "ns", "microsecond": "us", "millisecond": "ms", "second": "s"}
_CF_UNITS |= {"sec": "s", "s": "s", "minute": "m", "hour": "h", "day": "D"}


# --- Arrow: columns have one length, and any type


@reject_damage
def read_parquet(paths, columns=None):
    """Read a Parquet table; ``simulated`` and ``units`` of the project's metadata are passed on."""
    with pq.ParquetFile(paths["log"]) as file:
        names = file.schema_arrow.names
        said = own_metadata(file.schema_arrow.metadata or {})
        units = {quantity: str(unit) for quantity, unit in said.get("units", {}).items()}
        refuse_calibrated(names, said)
        chosen = resolve(names, columns)
        used = list(dict.fromkeys(names[i] for i in chosen.raw().values()))
        # columns are read by name: of one that repeats all come, in the order of the file
        given = [i for name in used for i, other in enumerate(names) if other == name]
        table = file.read(columns=used)
    held = [table.column(given.index(i)) for i in chosen.raw().values()]
    simulated = bool(said.get("simulated", False))
    return table_log(names, chosen, held, units=units, simulated=simulated)


@reject_damage
def read_feather(paths, columns=None):
    """Read a Feather file of version 2, which is an Arrow file."""
    table = pa.ipc.open_file(paths["log"]).read_all()
    # offsets of a damaged file may lead out of it
    table.validate(full=True)
    names = table.schema.names
    refuse_calibrated(names, {})
    chosen = resolve(names, columns)
    return table_log(names, chosen, [table.column(at) for at in chosen.raw().values()])


# --- arrays of one or two dimensions, of any length


def _log(arrays, columns, units=None, unread=""):
    """Return the RawLog of arrays by name.

    An array of shape (n,), (n, 1) or (1, n) is a column; (n, 3) or (3, n) are the columns
    ``NAME.x``, ``NAME.y`` and ``NAME.z``; other matrices have ``NAME.0`` and on. Columns with the
    length of the sensors' are the table.

    Parameters
    ----------
    columns : dict
        As declared; a sensor may also be the name of one array.
    units : dict, optional
        Name of an array to what the file says of its unit.
    unread : str, optional
        What else the file holds, and why it is not read.
    """
    series, texts = {}, {}
    for name, array in arrays.items():
        if array.ndim not in (1, 2) or array.dtype.kind not in "biufM":
            continue
        # the longer side is time
        rows = np.atleast_2d(array)
        rows = rows.T if rows.shape[0] < rows.shape[1] else rows
        if len(rows) < 2 or rows.shape[1] > _WIDEST:
            continue
        labels = {1: [""], len(AXES): AXES}.get(rows.shape[1], map(str, range(rows.shape[1])))
        for label, column in zip(labels, rows.T, strict=True):
            whole = ".".join(filter(None, (name, label)))
            series[whole], texts[whole] = column, (units or {}).get(name, "")
    if not series:
        why = "the file has no variables of numbers over time"
        raise RejectedLog("; ".join(filter(None, (why, unread))))
    names = [*series]
    columns = dict(columns or {})
    for quantity in SENSORS:
        if isinstance(columns.get(quantity), str):
            columns[quantity] = [f"{columns[quantity]}.{axis}" for axis in AXES]
    notes = [f"left out: {unread}"] if unread else []
    # a matrix that is all of the file: its columns have numbers
    stems, _, labels = zip(*(name.rpartition(".") for name in names), strict=True)
    alone = len({*stems}) == 1 and labels[-1].isdigit()
    if alone and not {*SENSORS, "time"} & {*columns} and (order := _seven(series)):
        columns |= order
        notes.append(f"a matrix of seven columns, which gravity tells apart: {order}")
    headed = names[0] != "0"
    names = _of_one_length(series, resolve(names, columns, headed))
    chosen = resolve(names, columns, headed)
    stated = {}
    for quantity, found in chosen.found(names).items():
        said = {texts[name] for name in np.atleast_1d(found)} - {""}
        if said and quantity != "pps" and not (quantity == "time" and _since(min(said))):
            summed = quantity in chosen.increments
            known = {stated_unit(quantity, text, summed) or text for text in said}
            stated[quantity] = " and ".join(sorted(known))
    held = [_column(series[names[i]], texts[names[i]]) for i in chosen.raw().values()]
    log = table_log(names, chosen, held, headed and not alone, notes=notes, units=stated)
    if unread:
        # a sensor that is not found may be in there
        log.columns, log.unread = f"{log.columns}; {unread}", log.unread + len(AXES)
    return log


def _of_one_length(series, chosen):
    """Return the names of the columns that are as long as those of the sensors.

    Without sensors they are as long as those of a reference, else as the time.
    """
    names, raw = [*series], chosen.raw()
    asks = ([names[raw[key]] for key in keys if key in raw] for keys in (CHANNELS, chosen.others))
    asked = next(filter(None, asks), [names[at] for key, at in raw.items() if key == STAMP])
    lengths = {len(series[name]): name for name in asked or names}
    rows = max(lengths)
    if asked and len(lengths) > 1:
        both = " and ".join(f"{name} has {n} rows" for n, name in lengths.items())
        raise ImuloopError(f"{both}: name variables of one length in columns")
    return [name for name in names if len(series[name]) == rows]


def _since(text):
    """Return the unit of pandas and the date of `seconds since 2024-01-01`, or None."""
    match = _SINCE.fullmatch(text)
    unit = match and _CF_UNITS.get(match[1].lower())
    return (unit, match[2].replace("UTC", "").strip()) if unit else None


def _column(values, text):
    """Return a column of an array, which may be masked; dates if `text` is `seconds since ...`."""
    data, mask = np.ma.getdata(values), np.ma.getmaskarray(values)
    if not (since := _since(text)):
        # Arrow has no longer numbers, and none of the other byte order
        kind = data.dtype.newbyteorder("=") if data.dtype.itemsize <= 8 else float
        return pa.array(data.astype(kind, copy=False), mask=mask)
    unit, date = since
    try:
        origin = pd.Timestamp(date)
        origin = (origin.tz_localize("UTC") if origin.tz is None else origin).as_unit("ns")
        dates = origin + pd.to_timedelta(data, unit=unit)
    except (ValueError, OverflowError) as error:
        raise RejectedLog(f"the stamps, {text}, are no dates of the years {YEARS}") from error
    return pa.array(dates.tz_convert(None), mask=mask)


def _seven(series):
    """Return the columns of a matrix of seven, time first: gravity is in one of two triples.

    Empty if the first column is no time, or if gravity, in m/s^2, is in none or both.
    """
    if len(series) != 1 + 2 * len(AXES):
        return {}
    t, *axes = (np.asarray(column[:HEAD_ROWS], dtype=float) for column in series.values())
    sizes = [np.median(np.linalg.norm(three, axis=0)) for three in (axes[:3], axes[3:])]
    down = [bool(abs(size / STANDARD_GRAVITY - 1) < _NEAR) for size in sizes]
    if not (np.diff(t) > 0).all() or sum(down) != 1:
        return {}
    triples = [1, 2, 3], [4, 5, 6]
    return {"time": 0, "acceleration": triples[down[1]], "angular_rate": triples[down[0]]}


# --- NumPy


@reject_damage
def read_numpy(paths, columns=None):
    """Read an array of NumPy (.npy), or several by name (.npz).

    A structured array has a column per field. Pickled objects are never loaded.
    """
    path, arrays, objects = paths["log"], {}, []
    if zipped := zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            check_unpacked(os.path.getsize(path), sum(x.file_size for x in archive.infolist()))
    with np.load(path, allow_pickle=False) if zipped else nullcontext([""]) as archive:
        for name in archive:
            try:
                array = archive[name] if zipped else np.load(path, "r", allow_pickle=False)
            except ValueError as error:
                if not re.search("pickle|Python objects", str(error)):
                    raise
                objects.append(one_line(name))
                continue
            # what an archive holds beside arrays is bytes
            for field in (isinstance(array, np.ndarray) and (array.dtype.names or [""])) or ():
                # an array that is all of the file gives its fields no name
                label = [one_line(name)] * (len(archive) > 1 or not field) + [one_line(field)]
                arrays[".".join(filter(None, label))] = array[field] if field else array
    whose = f" in {', '.join(objects[:3])}" if any(objects) else ""
    unread = f"the pickled objects{whose} are not loaded: save numbers" if objects else ""
    return _log(arrays, columns, unread=unread)


# --- MATLAB


@reject_damage
def read_matlab(paths, columns=None):
    """Read a MATLAB file of version 5 (`-v6`, `-v7`) or 7.3; one that is text is read as a table.

    The fields of a struct are ``STRUCT.FIELD``.
    """
    with open(path := paths["log"], "rb") as file:
        head = file.read(_HDF5_AT[-1] + len(_HDF5))
    arrays, objects = {}, {}
    if any(head[at:].startswith(_HDF5) for at in _HDF5_AT):
        _gather_73(path, arrays, objects)
    elif head[_ORDER_AT] in (b"IM", b"MI"):
        from scipy.io import loadmat

        # integers as MATLAB has them, however few bytes they were packed into
        _gather_5(loadmat(path, mat_dtype=True, simplify_cells=True), "", arrays, objects)
    elif head and b"\0" not in head:
        log = delimited.read(paths, columns)
        log.notes.append("the file is text, no MATLAB file: read as a table")
        return log
    else:
        raise RejectedLog("the file is no MATLAB file of version 5 or 7.3")
    unread = "; ".join(
        f"{name} is a MATLAB {what}, which only MATLAB reads: save its columns as variables"
        for name, what in [*objects.items()][:3]
    )
    return _log(arrays, columns, unread=unread)


def _gather_5(variables, prefix, arrays, objects):
    """Put what SciPy read into `arrays` and `objects` by name, a struct's fields one by one."""
    for key, value in variables.items():
        if isinstance(value, dict):
            _gather_5(value, f"{prefix}{one_line(key)}.", arrays, objects)
        elif isinstance(value, np.ndarray) and value.dtype.names == ("s0", "s1", "s2", "arr"):
            name, _, what, _ = np.ravel(value)[0]
            objects[prefix + one_line(name.decode(errors="replace"))] = one_line(
                what.decode(errors="replace")
            )
        elif isinstance(value, np.ndarray):
            arrays[prefix + one_line(key)] = value


def _gather_73(path, arrays, objects):
    """Put the datasets of an HDF5 file into `arrays` and `objects` by name."""
    import h5py

    check_hdf5(path)

    def put(place, item):
        name, attributes = one_line(place.replace("/", ".")), item.attrs
        if place.startswith("#"):
            return
        if "MATLAB_object_decode" in attributes:
            what = bytes(attributes.get("MATLAB_class", b"object"))
            objects[name] = one_line(what.decode(errors="replace"))
        elif isinstance(item, h5py.Dataset) and item.ndim == 2 and item.dtype.kind in "iuf":
            if attributes.get("MATLAB_class") != b"char" and "MATLAB_empty" not in attributes:
                _check_announced(path, arrays, item.nbytes)
                # HDF5 lists MATLAB's dimensions backwards
                arrays[name] = item[()].T

    with h5py.File(path, "r") as file:
        file.visititems(put)


# --- NetCDF


@reject_damage
def read_netcdf(paths, columns=None):
    """Read a NetCDF file; the coordinate of its longest dimension is the time."""
    # takes long to import
    import netCDF4

    check_hdf5(path := paths["log"])
    arrays, units = {}, {}
    # a path that begins otherwise could be an address to the library
    with netCDF4.Dataset(os.path.abspath(path)) as data:
        for name, variable in data.variables.items():
            if getattr(variable.dtype, "kind", "O") in "iuf" and variable.ndim in (1, 2):
                _check_announced(path, arrays, float(variable.size) * variable.dtype.itemsize)
                arrays[name] = variable[:]
                units[name] = str(getattr(variable, "units", "")).strip()
        longest = max((max(array.shape) for array in arrays.values()), default=0)
        for name, array in arrays.items():
            if data[name].dimensions == (name,) and len(array) == longest:
                columns = {"time": name} | (columns or {})
    return _log(arrays, columns, units)


# --- HDF5, which NetCDF-4 and MATLAB 7.3 are


def _check_announced(path, arrays, size):
    """Refuse arrays whose announced size is too large, whatever is in the file."""
    check_unpacked(os.path.getsize(path), sum(array.nbytes for array in arrays.values()) + size)


def check_hdf5(path):
    """Reject an HDF5 file that has other files opened: they may be any file of the machine.

    A file that is no HDF5 passes. Hard links alone are followed, into each object once. That meets
    all that a soft link can lead to, as such a link is a path of links of the same file.
    """
    # takes long to import
    import h5py

    if not h5py.is_hdf5(path):
        return

    def links(name, link):
        # all other kinds, those of a user's own too, lead out of the file
        inside = link.type in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT)
        return None if inside else (name.decode(errors="replace"), "an external link")

    def storage(name, item):
        if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
            return name, "external storage" if item.external else "a virtual dataset"
        return None

    with h5py.File(path, "r") as file:
        found = file.id.links.visit(links, info=True) or file.visititems(storage)
    if found:
        name, what = found
        raise RejectedLog(
            f"{one_line(name)} is {what}, whose values lie in another file, which is not read: "
            "save the values themselves in one file"
        )
