"""Files of arrays: functions of a path, the log and options, which write it."""

import json

import netCDF4
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.samples import METADATA_KEY
from ingest.written import ACCELERATION, RATE, matlab_5, matlab_7, matlab_73

SAVE = {"5": matlab_5, "7.3": matlab_73}


def parts(log, names=("t", "acc", "gyro")):
    every = {"t": log.t.to_numpy(), "acc": log[ACCELERATION].to_numpy()}
    every["gyro"] = log[RATE].to_numpy()
    return {name: every[name] for name in names}


def structs(path, log, version):
    """Columns in structs, with variables that are not columns or have another length."""
    acc, gyro = parts(log, ["acc", "gyro"]).values()
    SAVE[version](path, {
        "imu": {"acc": acc, "note": "still", "more": {"gyro": gyro}},
        "clock": {"elapsed": log.t.to_numpy(), "rate": 100.0},
        "t": np.arange(7.0), "temp": 20.0, "image": np.zeros((200, 300)),
        "empty": np.empty((0, 0)), "remark": "t" * 500,
    })  # fmt: skip


def pickled_too(path, log):
    np.savez(path, **log, about=np.array({}, dtype=object))


def lengths(path, log):
    arrays = parts(log)
    matlab_7(path, arrays | {"gyro": arrays["gyro"][:400], "omega": arrays["gyro"]})


def empty_matlab(path, _):
    path.write_bytes(b"MATLAB 5.0".ljust(124) + b"\0\1IM")


def netcdf(path, log, units="seconds since 2021-09-20 08:52:00", order=("time", "axis"), day=1):
    """Write vectors with an axis, units, a date, and a temperature of which one is missing."""
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", len(log))
        data.createDimension("axis", 3)
        for name, columns, unit in (
            ("acceleration", ACCELERATION, "m/s2"),
            ("angular_velocity", RATE, "mrad/s"),
            ("magnetic_density", RATE, "uT"),
        ):
            values = log[columns].to_numpy()
            variable = data.createVariable(name, "f8", order)
            variable[:], variable.units = values if order[0] == "time" else values.T, unit
        stamps = log.t.to_numpy() / day if day else np.arange(len(log))
        variable = data.createVariable("time", stamps.dtype, ("time",), fill_value=False)
        variable[:], variable.units = stamps, units
        temperature = data.createVariable("temperature", "f8", ("time",))
        temperature[:] = np.ma.masked_where(log.index == 9, 20.0 + log.t)
        temperature.units = "C"


def coordinate(path, log):
    """A coordinate of no usual name, and six columns in one variable."""
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("obs", len(log))
        data.createDimension("channel", 6)
        data.createVariable("obs", "f8", ("obs",))[:] = log.t.to_numpy()
        data.createVariable("imu", "f8", ("obs", "channel"))[:] = log.iloc[:, 1:].to_numpy()
        data.createVariable("note", str, ("obs",))
        data.createGroup("raw")


def parquet(path, log, second=False, about=None, **changed):
    """Write columns, some of another kind, after a second ax, with metadata of samples."""
    kinds = {"text": pa.array([f"{i / 100:.2f}" for i in range(500)]).dictionary_encode()}
    kinds["large"] = pa.array(np.uint64(2**63) + np.arange(500, dtype=np.uint64))
    kinds |= {"words": pa.array(["text"] * 500), "lists": pa.array([[0.0]] * 500)}
    columns = {name: pa.array(x) for name, x in log.items()}
    columns |= {name: kinds[kind] for name, kind in changed.items()}
    names, arrays = ["ax"] * second + [*columns], [pa.array(-log.ax)] * second
    table = pa.Table.from_arrays([*arrays, *columns.values()], names=names)
    metadata = {METADATA_KEY: json.dumps(about).encode()} if about is not None else None
    pq.write_table(table.replace_schema_metadata(metadata), path)


def moments(path, log, unit, zone=None):
    dates = pd.Timestamp("2024-03-01T12:00:00", tz="UTC") + pd.to_timedelta(log.t, unit="s")
    dates = pd.Series(dates).dt.round("ms").dt.as_unit(unit)
    parquet(path, log.assign(t=dates.dt.tz_convert(zone) if zone else dates.dt.tz_localize(None)))


def matrix(path, log, wide=False):
    """Seven columns of time and the sensors, or ten."""
    table = [log.t, log[ACCELERATION + RATE], np.zeros((len(log), 3 * wide))]
    table = np.column_stack(table)
    if path.suffix == ".mat":
        SAVE["7.3" if "73" in path.name else "5"](path, {"data": table})
    else:
        (np.save if path.suffix == ".npy" else np.savez)(path, table)
