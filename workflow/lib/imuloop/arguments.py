"""What `imuloop.calibrate` and `imuloop.read` are given, checked before anything is read."""

import operator
import re
from collections.abc import Mapping
from dataclasses import fields
from numbers import Integral, Real
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.errors import ImuloopError, nearest
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TEMPERATURE, TIME
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.ingest.formats import PAIR
from imuloop.ingest.spellings import UNITS
from imuloop.local_gravity import HEIGHTS, LATITUDES, STRONGEST, WEAKEST, normal_gravity
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.settings import SegmentSettings
from imuloop.sensors import LARGEST

STAGES = {
    "segment": SegmentSettings,
    "noise": NoiseSettings,
    "calibrate": CalibrateSettings,
    "diagnose": DiagnoseSettings,
}
# limits of a setting: how they compare, in words
LIMITS = {
    "gt": (operator.gt, "above"),
    "ge": (operator.ge, "at least"),
    "lt": (operator.lt, "below"),
    "le": (operator.le, "at most"),
}
# types of a path
FILE = (str, PathLike)
# the arrays of a log in their order, and the columns that they become
ARRAYS = {
    "t": TIME,
    "acceleration": ACCELERATION,
    "angular_rate": ANGULAR_RATE,
    "temperature": TEMPERATURE,
}


def gravity_of(gravity):
    """Return local gravity, m/s^2, of a number or of ``{"latitude": …, "height": …}``."""
    if isinstance(gravity, Mapping):
        if {*gravity} != {"latitude", "height"} or not all(map(_is_number, gravity.values())):
            raise ImuloopError(
                f"gravity: {dict(gravity)} is no place: give {{'latitude': degrees, 'height': m}}"
            )
        for name, (low, high) in (("latitude", LATITUDES), ("height", HEIGHTS)):
            if not (_is_number(gravity[name]) and low <= gravity[name] <= high):
                raise ImuloopError(
                    f"gravity: {name} {gravity[name]!r} is not a number from {low} to {high}"
                )
        return normal_gravity(gravity["latitude"], gravity["height"])
    if not _is_number(gravity):
        raise ImuloopError(
            f"gravity: {gravity!r} is not a number, m/s^2; for a place give "
            "{'latitude': degrees, 'height': m}"
        )
    if not WEAKEST <= gravity <= STRONGEST:
        raise ImuloopError(
            f"gravity: {gravity:g} m/s^2 is no local gravity, {WEAKEST:g} to {STRONGEST:g}; of a "
            "place it is computed from latitude and height"
        )
    return float(gravity)


def check_name(name):
    """Raise an ImuloopError for a name that no device may have."""
    if not isinstance(name, str) or not re.fullmatch("[A-Za-z][A-Za-z0-9_-]{0,63}", name):
        raise ImuloopError(
            f"name: {name!r} is not a letter and up to 63 letters, digits, _ or -; label may be "
            "any text"
        )


def check_settings(settings):
    """Raise an ImuloopError for a stage, a setting or a value that cannot be."""
    for stage, given in _mapping("settings", settings).items():
        if stage not in STAGES:
            raise ImuloopError(f"settings: '{stage}' is not a stage{nearest(str(stage), STAGES)}")
        known = {field.name: field for field in fields(STAGES[stage])}
        for name, value in _mapping(f"settings.{stage}", given).items():
            if name not in known:
                raise ImuloopError(
                    f"settings.{stage}: '{name}' is not a setting{nearest(str(name), known)}"
                )
            if fault := _setting_fault(known[name], value):
                raise ImuloopError(f"settings.{stage}.{name}: {value!r} is not {fault}")


def _setting_fault(field, value):
    """Return what the value of a setting of numbers would have to be; None if it is right."""
    if isinstance(field.default, bool) or not isinstance(field.default, Real):
        return None
    whole = isinstance(field.default, int)
    if not _is_number(value) or (whole and not isinstance(value, Integral)):
        return "a whole number" if whole else "a number"
    for key, (holds, words) in LIMITS.items():
        if key in field.metadata and not holds(value, field.metadata[key]):
            return f"{words} {field.metadata[key]:g}"
    return None


def _is_number(value):
    return isinstance(value, Real) and not isinstance(value, bool)


def _mapping(name, given):
    """Return what is given; an ImuloopError if it is no mapping."""
    if not isinstance(given, Mapping):
        raise ImuloopError(f"{name}: {given!r} is not a mapping")
    return given


def check_declared(given, known):
    """Raise an ImuloopError for what cannot be declared of a log, `known` what can be."""
    for name in given:
        if name not in known:
            raise ImuloopError(f"'{name}' cannot be declared of a log{nearest(name, known)}")
    for name in ("units", "columns", "range", "nominal"):
        quantities = PAIR if name in ("range", "nominal") else UNITS
        for quantity in _mapping(name, given.get(name) or {}):
            # columns are checked with the log
            if name != "columns" and quantity not in quantities:
                raise ImuloopError(
                    f"{name}: '{quantity}' is not a quantity{nearest(str(quantity), quantities)}"
                )
    for quantity, counts in (given.get("nominal") or {}).items():
        known = ("scale", "offset", "tolerance")
        for name in _mapping(f"nominal.{quantity}", counts):
            if name not in known:
                raise ImuloopError(f"nominal.{quantity}: '{name}' is unknown{nearest(name, known)}")
        where, largest = f"nominal.{quantity}.tolerance", vars(LARGEST)
        for name, value in _mapping(where, counts.get("tolerance") or {}).items():
            if name not in largest:
                raise ImuloopError(f"{where}: '{name}' is unknown{nearest(name, largest)}")
            if not (_is_number(value) and 0 < value <= largest[name]):
                raise ImuloopError(
                    f"{where}.{name}: {value!r} is not a number above 0 and up to {largest[name]:g}"
                )
    rate = given.get("rate")
    if rate is not None and not (_is_number(rate) and 0 < rate < np.inf):
        raise ImuloopError(f"rate: {rate!r} is not a number of samples per second above 0")


def log_of(log, columns=None, name="log"):
    """Return a log as a path or a DataFrame, or as a mapping of the two sensors to one each.

    `columns` are those that are declared, `name` is what the log is called in messages. Raises an
    ImuloopError for what is no log.
    """
    if isinstance(log, FILE):
        if not Path(log).exists():
            raise ImuloopError(f"{log}: there is no such file")
        return log if isinstance(log, str) else Path(log)
    if isinstance(log, pd.DataFrame):
        return _storable(_with_index(log), name)
    if isinstance(log, Mapping):
        parts = [k for k, v in log.items() if isinstance(v, (*FILE, pd.DataFrame, Mapping))]
        if parts and {*log} != {*PAIR}:
            raise ImuloopError(
                f"{name}: a table or file each under {', '.join(map(str, log))}; name them "
                f"{' and '.join(PAIR)}"
            )
        if parts:
            for quantity in {*PAIR} - {*parts}:
                raise ImuloopError(
                    f"{quantity}: without t it is a path or a DataFrame with its own stamps"
                )
            return {quantity: log_of(log[quantity], columns, quantity) for quantity in PAIR}
        if not {*PAIR} <= {*log} <= {*ARRAYS}:
            try:
                return _storable(pd.DataFrame(dict(log)), name)
            except ValueError as error:
                raise ImuloopError(f"{name}: {error}") from error
        log = tuple(map(log.get, ARRAYS))
    if isinstance(log, (tuple, list)) and len(log) in (3, 4) and not isinstance(log[0], FILE):
        return _storable(_of_arrays(*log), name)
    if isinstance(log, np.ndarray) and log.ndim == 2 and columns:
        return _storable(pd.DataFrame(log), name)
    what, remedy = f"a {type(log).__name__}", ""
    if isinstance(log, (tuple, list)):
        what += f" of {len(log)}"
    elif isinstance(log, np.ndarray):
        what = f"an array of shape {log.shape}"
        if log.ndim == 2:
            remedy = " without columns by number, {'time': 0, 'acceleration': [1, 2, 3], …}"
    raise ImuloopError(
        f"{name}: {what} is no log{remedy}; a log is a path, a DataFrame or (t, acceleration, "
        "angular_rate[, temperature]) of arrays; of two files {'acceleration': path, "
        "'angular_rate': path}"
    )


def _of_arrays(*arrays):
    """Return a log of arrays as a table; an ImuloopError for an array of another shape."""
    given = {k: _array(k, v) for k, v in zip(ARRAYS, arrays, strict=False) if v is not None}
    for quantity in PAIR:
        if quantity not in given:
            raise ImuloopError(f"{quantity}: none is given")
    first, table = next(iter(given)), {}
    n = len(np.atleast_1d(given[first]))
    for name, values in given.items():
        shape = (n, 3) if name in PAIR else (n,)
        if values.shape != shape:
            raise ImuloopError(
                f"{name}: an array of shape {values.shape}; as many rows as {first} has, {shape}, "
                "are needed"
            )
        named = ARRAYS[name] if name in PAIR else (ARRAYS[name],)
        table |= dict(zip(named, np.atleast_2d(values.T), strict=True))
    return pd.DataFrame(table)


def _array(name, values):
    """Return array_like values as an array, masked ones as nan."""
    if isinstance(values, np.ma.MaskedArray):
        return values.astype(float).filled(np.nan)
    try:
        return np.asarray(values)
    except ValueError as error:
        raise ImuloopError(f"{name}: its rows differ in length") from error


def _with_index(table):
    """Return a table with its index, if that has times or a name, as a column."""
    name = table.index.name
    if name is None and isinstance(table.index, pd.DatetimeIndex):
        name = TIME
    return table if name is None or name in table else table.rename_axis(name).reset_index()


def _storable(table, name):
    """Return a table that a Parquet file can hold: other columns become float64, or else text."""
    if not table.columns.is_unique:
        [twice, *_] = table.columns[table.columns.duplicated()]
        raise ImuloopError(f"{name}: two columns are named {twice}")
    kinds = {}
    for column in table:
        try:
            pa.array(table[column])
        except pa.ArrowException:
            kinds[column] = float if table[column].dtype.kind in "iuf" else str
    return table.astype(kinds)
