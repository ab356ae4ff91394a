"""MATLAB, NumPy and NetCDF files: variables over time, a sensor's axes as one or three."""

import os
import re
import zipfile
from functools import partial

import numpy as np
import pandas as pd
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog, one_line
from imuloop.core.samples import TEMPERATURE
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest import delimited
from imuloop.ingest.columns import lacking, listed, resolve
from imuloop.ingest.damage import check_unpacked, reject_damage
from imuloop.ingest.spellings import AXES, SENSORS, stated_unit
from imuloop.ingest.stamps import YEARS
from imuloop.ingest.tables import HEAD_ROWS, table_log

MATLAB_ENDINGS = (".mat",)
NETCDF_ENDINGS = (".nc", ".nc4", ".cdf", ".netcdf")
NUMPY_ENDINGS = (".npy", ".npz")

# more columns than a matrix of samples has
_WIDEST = 64
# share of gravity by which the force in a matrix may differ from it
_NEAR = 0.2
# MATLAB puts its own text before HDF5
_HDF5, _HDF5_AT = b"\x89HDF\r\n\x1a\n", (0, 512)
_OCTAVE = b"# Created by Octave"
_SINCE = re.compile(r"\s*(\w+?)s?\s+since\s+(\d.*)", re.IGNORECASE)
# units of CF times to those of pandas
_CF_UNITS = {"nanosecond": "ns", "microsecond": "us", "millisecond": "ms", "second": "s"}
_CF_UNITS |= {"sec": "s", "s": "s", "minute": "m", "hour": "h", "day": "D"}


def check_hdf5(path):
    """Reject an HDF5 file that has other files opened: they may be any file of the machine.

    NetCDF-4 and MATLAB 7.3 are HDF5; a file that is none passes. Hard links alone are followed,
    into each object once. That meets all that a soft link can lead to, as such a link is a path of
    links of the same file.
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


def _column_names(name, width):
    """Return the names of the columns of a matrix: none of one wider than `_WIDEST`."""
    if width == 1:
        return [name]
    labels = AXES if width == len(AXES) else range(width if width <= _WIDEST else 0)
    return [f"{name}.{label}" if name else str(label) for label in labels]


def _by_axis(columns):
    """Return declared columns with each matrix of a sensor as its three columns."""
    return {
        quantity: [f"{value}.{axis}" for axis in AXES]
        if isinstance(value, str) and quantity in SENSORS
        else value
        for quantity, value in (columns or {}).items()
    }


# --- MATLAB


@reject_damage
def read_matlab(paths, columns=None):
    """Read a MATLAB file of version 5 (`-v6`, `-v7`) or 7.3; one that is text is read as a table.

    A variable of shape (n, 1) or (1, n) is a column, one of (n, 3) or (3, n) the columns `NAME.x`,
    `NAME.y` and `NAME.z`, other matrices `NAME.0` and on; a struct's are `STRUCT.FIELD`. In
    `columns` a sensor is one variable, or three.
    """
    head = _head(paths["log"])
    if head and b"\0" not in head and not (head.startswith(_OCTAVE) or _is_version_5(head)):
        log = delimited.read(paths, columns)
        log.notes.append("the file is text, no MATLAB file: read as a table")
        return log
    return _log(*variables(paths["log"]), columns)


def _log(series, unread, columns):
    """Return the RawLog of columns of numbers by name, of which those of one length are read.

    `unread` says what else the file holds. The columns of a matrix that is all of a file have
    numbers, and need not be declared where it has seven and gravity shows which are a sensor's.
    """
    names, columns = list(series), dict(columns or {})
    # a matrix that is all of the file
    matrices = {re.sub(r"(\A|\.)\d+\Z", "", name) for name in names}
    alone = len(matrices) == 1 and len(names) > len(AXES)
    notes = [f"left out: {unread[2:]}"] if unread else []
    if alone and not {*SENSORS, "time"} & {*columns} and (order := _seven(series)):
        columns |= order
        listing = ", ".join(f"{quantity}: {at}" for quantity, at in order.items())
        notes.append(f"a matrix of seven columns, which gravity tells apart: {listing}")
    headed = names != [*map(str, range(len(names)))]
    try:
        chosen = resolve(names, _by_axis(columns), headed)
        sensors = {q: [names[i] for i in getattr(chosen, q) or ()] for q in SENSORS}
        raw = chosen.raw()
        # of a reference the attitudes say how long it is, and of a time alone the time
        others = [names[i] for key, i in [*raw.items()][::-1] if key != TEMPERATURE]
        first = next((name for of in (*sensors.values(), others) for name in of), None)
        rows = len(series[first]) if first else max(map(len, series.values()))
        for quantity, each in sensors.items():
            if unread and not each and (columns or {}).get(quantity, "") is not None:
                raise lacking(quantity, listed(names))
            for name in each:
                if len(series[name]) != rows:
                    raise ImuloopError(
                        f"columns.{quantity}: {name} has {len(series[name])} rows, {first} has "
                        f"{rows}; name variables of one length"
                    )
        # a time and a temperature of another length are none of theirs
        names = [name for name in names if len(series[name]) == rows]
        chosen = resolve(names, _by_axis(columns), headed)
    except ImuloopError as error:
        raise type(error)(f"{error}{unread}") from error
    held = [pa.array(series[names[i]]) for i in chosen.raw().values()]
    log = table_log(names, chosen, held, headed, notes=notes)
    if alone:
        log.columns = listed(names, headed=False)
    return log


def _seven(series):
    """Return the columns of a matrix of seven, time first: gravity is in one of two triples.

    Empty if the first column is no time, or if gravity, in m/s^2, is in none or both.
    """
    if len(series) != 1 + 2 * len(AXES):
        return {}
    t, *axes = (np.asarray(column[:HEAD_ROWS], dtype=float) for column in series.values())
    triples = {1: axes[:3], 4: axes[3:]}
    sizes = {at: np.median(np.linalg.norm(three, axis=0)) for at, three in triples.items()}
    down = [at for at, size in sizes.items() if abs(size / STANDARD_GRAVITY - 1) < _NEAR]
    if not (np.diff(t) > 0).all() or len(down) != 1:
        return {}
    places = {"acceleration": down[0], "angular_rate": 5 - down[0]}
    return {"time": 0} | {q: [at, at + 1, at + 2] for q, at in places.items()}


def _head(path):
    with open(path, "rb") as file:
        return file.read(_HDF5_AT[-1] + len(_HDF5))


def _is_version_5(head):
    return head[126:128] in (b"IM", b"MI")


def variables(path):
    """Return the columns of a MATLAB file by name, and what it holds that only MATLAB reads."""
    head, arrays, objects = _head(path), {}, {}
    if any(head[at:].startswith(_HDF5) for at in _HDF5_AT):
        import h5py

        check_hdf5(path)
        with h5py.File(path, "r") as file:
            _gather_73(file, "", arrays, objects)
    elif _is_version_5(head):
        from scipy.io import loadmat

        # integers as MATLAB has them, however few bytes they were packed into
        _gather_5(loadmat(path, mat_dtype=True, struct_as_record=False), "", arrays, objects)
    elif head.startswith(_OCTAVE):
        raise RejectedLog("Octave's text format is not read; save with -v7")
    else:
        raise RejectedLog("the file is no MATLAB file of version 5 or 7.3")
    unread = "".join(
        f"; {name} is a MATLAB {what}, which only MATLAB reads: save its columns as variables"
        for name, what in [*objects.items()][:3]
    )
    return _columns(arrays, unread), unread


def _columns(arrays, unread=""):
    """Return name -> column of two-dimensional arrays by name."""
    series = {}
    for name, array in arrays.items():
        # the longer side is time
        rows = array if array.shape[0] >= array.shape[1] else array.T
        if len(rows) > 1 and (labels := _column_names(name, rows.shape[1])):
            # Arrow has no longer numbers
            kind = rows.dtype.newbyteorder("=") if rows.dtype.itemsize <= 8 else float
            native = rows.astype(kind, copy=False)
            series |= dict(zip(labels, native.T, strict=True))
    if not series:
        raise RejectedLog(f"the file has no variables of numbers over time{unread}")
    return series


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
            _gather_5(vars(value[0, 0]), f"{name}.", arrays, objects)


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
            if item.attrs.get("MATLAB_class") != b"char" and "MATLAB_empty" not in item.attrs:
                # sizes that are announced, whatever is in the file
                held = sum(array.nbytes for array in arrays.values()) + item.nbytes
                check_unpacked(item.file.id.get_filesize(), held)
                # HDF5 lists MATLAB's dimensions backwards
                arrays[name] = item[()].T


# --- NumPy


@reject_damage
def read_numpy(paths, columns=None):
    """Read an array of NumPy (.npy), or several by name (.npz).

    A structured array has a column per field. Pickled objects are never loaded.
    """
    path, given, objects = paths["log"], {}, []
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            check_unpacked(os.path.getsize(path), sum(x.file_size for x in archive.infolist()))
        with np.load(path, allow_pickle=False) as archive:
            for name in archive.files:
                _load(partial(archive.__getitem__, name), one_line(name), given, objects)
    else:
        _load(partial(np.load, path, "r", allow_pickle=False), "", given, objects)
    arrays = {}
    for name, array in given.items():
        for field in array.dtype.names or ("",):
            part = array[field] if field else array
            # an array that is all of the file gives its fields no name
            label = [name] * (len(given) > 1 or not field) + [one_line(field)] * bool(field)
            if part.dtype.kind in "biufM" and part.ndim in (1, 2):
                arrays[".".join(label)] = part[:, None] if part.ndim == 1 else part
    whose = f" in {', '.join(objects[:3])}" if any(objects) else ""
    unread = f"; the pickled objects{whose} are not loaded: save numbers" if objects else ""
    return _log(_columns(arrays, unread), unread, columns)


def _load(load, name, arrays, objects):
    """Put what is loaded into `arrays` by name; if it is pickled, the name into `objects`."""
    try:
        array = load()
    except ValueError as error:
        if "pickle" not in str(error) and "Python objects" not in str(error):
            raise
        objects.append(name)
    else:
        # what an archive holds beside arrays is bytes
        arrays |= {name: array} if isinstance(array, np.ndarray) else {}


# --- NetCDF


@reject_damage
def read_netcdf(paths, columns=None):
    """Read a NetCDF file, whose longest dimension is time.

    In `columns` a sensor is one variable of shape (time, 3), or three.
    """
    # takes long to import
    import netCDF4

    path = paths["log"]
    check_hdf5(path)
    # a path that begins otherwise could be an address to the library
    dataset = netCDF4.Dataset(os.path.abspath(path))
    numeric = [v for v in dataset.variables.values() if getattr(v.dtype, "kind", "O") in "iuf"]
    lengths = {d: len(dataset.dimensions[d]) for v in numeric for d in v.dimensions}
    if not lengths:
        raise RejectedLog("the file has no variables of numbers")
    time = max(lengths, key=lengths.get)
    # name of a column to its variable and the place in it
    series = {}
    for variable in numeric:
        if variable.ndim < 3 and variable.dimensions.count(time) == 1:
            width = variable.size // lengths[time]
            for place, name in enumerate(_column_names(variable.name, width)):
                series[name] = variable, place
    # the coordinate of the time dimension is the time, whatever its name
    if time in series and "time" not in (columns or {}):
        series = {("time" if name == time else name): each for name, each in series.items()}
    names = list(series)
    chosen = resolve(names, _by_axis(columns))
    used = [series[names[i]] for i in chosen.raw().values()]
    # sizes that are announced, whatever is in the file
    held = {variable.name: variable for variable, _ in used}.values()
    check_unpacked(os.path.getsize(path), sum(float(v.size) * v.dtype.itemsize for v in held))

    with dataset:
        rows = {variable.name: _rows(variable, time) for variable in held}
        columns = [_column(rows[v.name][:, place], _units(v)) for v, place in used]
        units = {quantity: chosen.units[quantity] for quantity in chosen.increments}
        for quantity, found in chosen.found(names).items():
            texts = sorted({_units(series[name][0]) for name in np.atleast_1d(found)} - {""})
            if quantity != "pps" and texts and not (quantity == "time" and _since(texts[0])):
                stated = {
                    stated_unit(quantity, text, quantity in chosen.increments) or text
                    for text in texts
                }
                units[quantity] = " and ".join(sorted(stated))
    return table_log(names, chosen, columns, units=units)


def _units(variable):
    return str(getattr(variable, "units", "")).strip()


def _rows(variable, time):
    """Return a variable, time along the first axis; masked."""
    rows = np.ma.asarray(variable[:])
    if variable.dimensions[0] != time:
        return rows.T
    return rows[:, None] if rows.ndim == 1 else rows


def _since(text):
    """Return the unit of pandas and the date of `seconds since 2024-01-01`, or None."""
    match = _SINCE.fullmatch(text)
    unit = match and _CF_UNITS.get(match[1].lower())
    return (unit, match[2].replace("UTC", "").strip()) if unit else None


def _column(values, units):
    """Return a column: dates where its units are `seconds since ...`, else its numbers."""
    mask, data = np.ma.getmaskarray(values), np.ma.getdata(values)
    if not _since(units):
        return pa.array(data, mask=mask)
    unit, date = _since(units)
    try:
        origin = pd.Timestamp(date)
        origin = (origin.tz_localize("UTC") if origin.tz is None else origin).as_unit("ns")
        dates = origin + pd.to_timedelta(data, unit=unit)
    except (ValueError, OverflowError) as error:
        raise RejectedLog(f"the stamps, {units}, are no dates of the years {YEARS}") from error
    return pa.array(dates.tz_convert(None), mask=mask)
